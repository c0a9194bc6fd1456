/**
 * A connection to the server: requests and replies of the stream protocol over a WebSocket, which
 * connects again by itself.
 */

const FIRST_PAUSE_MS = 100;
const MAX_PAUSE_MS = 2000;

/** Rejects a request: with the reason of an error reply, or because the connection was lost. */
class RequestError extends Error {}

/** One WebSocket of the page. Events: "open" and "close", each with this connection. */
export class Connection {
  #url;
  #socket = null;
  #pending = new Map();
  #handlers = { open: [], close: [] };
  #lastId = 0;
  #pause_ms = FIRST_PAUSE_MS;
  #lastFrame = Promise.resolve();

  constructor(url) {
    this.#url = url;
    this.#connect();
  }

  /** Whether requests can be sent at present. */
  get isOpen() {
    return this.#socket?.readyState === WebSocket.OPEN;
  }

  /** Call a function on each "open" or "close" from now on. */
  on(event, handler) {
    this.#handlers[event].push(handler);
  }

  /** Reply to a request {kind, ...}, whose id is chosen here; rejected with RequestError. */
  request(message) {
    if (!this.isOpen) return Promise.reject(new RequestError("there is no connection"));
    this.#lastId += 1;
    const id = this.#lastId;
    return new Promise((resolve, reject) => {
      this.#pending.set(id, { resolve, reject });
      this.#socket.send(JSON.stringify({ ...message, id }));
    });
  }

  /**
   * Frame {header, bytes, received_ms} of the fields of GetFrameRequest, after the frames requested
   * before: the server keeps one pending request.
   */
  requestFrame(message) {
    const frame = this.#lastFrame.then(() => this.request({ ...message, kind: "get_frame" }));
    this.#lastFrame = frame.catch(() => {});
    return frame;
  }

  #connect() {
    const socket = new WebSocket(this.#url);
    socket.binaryType = "arraybuffer";
    socket.addEventListener("open", () => {
      this.#pause_ms = FIRST_PAUSE_MS;
      this.#emit("open");
    });
    socket.addEventListener("message", ({ data }) => this.#receive(data));
    // A failed attempt closes too.
    socket.addEventListener("close", () => {
      this.#disconnected();
      setTimeout(() => this.#connect(), this.#pause_ms);
      this.#pause_ms = Math.min(2 * this.#pause_ms, MAX_PAUSE_MS);
    });
    this.#socket = socket;
  }

  #receive(data) {
    const received_ms = performance.now();
    if (typeof data === "string") {
      const reply = JSON.parse(data);
      this.#settle(reply, reply);
    } else {
      const frame = frameFromBuffer(data);
      this.#settle(frame.header, { ...frame, received_ms });
    }
  }

  #settle(reply, result) {
    const request = this.#pending.get(reply.id);
    this.#pending.delete(reply.id);
    if (reply.kind === "error") {
      // Id 0: the server could not read a request; there is none to reject.
      if (request) request.reject(new RequestError(reply.reason));
      else console.warn(`server: ${reply.reason}`);
    } else {
      request?.resolve(result);
    }
  }

  #disconnected() {
    const pending = [...this.#pending.values()];
    this.#pending.clear();
    for (const { reject } of pending) reject(new RequestError("the connection was lost"));
    this.#emit("close");
  }

  #emit(event) {
    for (const handler of this.#handlers[event]) handler(this);
  }
}

/** Header and image of a binary message: uint32 length, JSON header, image. */
function frameFromBuffer(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { header, bytes: new Uint8Array(buffer, 4 + length) };
}

/** JSON of a path of the server; null for a missing one. @throws {Error} for other faults */
export async function fetchJson(path) {
  const response = await fetch(path);
  if (response.status === 404) return null;
  if (!response.ok) throw new Error(`${path}: ${response.status} ${response.statusText}`);
  return response.json();
}

/** Values as in the file, without colour management. */
export const DECODING = { colorSpaceConversion: "none", premultiplyAlpha: "none" };

/** File of the image of a frame. */
export function fileFromFrame({ header, bytes }) {
  return new Blob([bytes], { type: `image/${header.encoding}` });
}

/** Decode the image of a frame outside the page's thread. @returns {Promise<ImageBitmap>} */
export function decodeFrame(frame) {
  return createImageBitmap(fileFromFrame(frame), DECODING);
}
