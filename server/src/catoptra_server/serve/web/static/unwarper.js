/** The page's side of the worker that unwarps frames (unwarp_worker.js). */

import { resizeCanvas } from "./canvas.js";
import { DECODING } from "./connection.js";

// Measured: 0.15 us per pixel on a processor; a fifth of the pixels keeps frames fluent.
const SOFTWARE_DETAIL = 0.45;
const SOFTWARE_INTERVAL_MS = 200;

/** Unwarps the frame of a camera by its table. */
export class Unwarper {
  /** Why nothing can be unwarped; "" if it can, or while that is not known. */
  fault = "";
  /** Resolution of views in the page, relative to that of the screen. */
  detail = 1;
  /** Least time between two pictures of a view: the camera's own picture comes first. */
  interval_ms = 0;
  #worker = null;
  #onChange;
  #isRunning = false;
  #frame = null;
  #source = null;
  #isSent = false;
  #table = null;
  #lastId = 0;
  #replies = new Map();
  #drawings = new Map();

  /** `onChange()` is called when views must be drawn again. */
  constructor(onChange) {
    this.#onChange = onChange;
    if (!("OffscreenCanvas" in window)) {
      this.fault = "this browser offers no OffscreenCanvas";
      return;
    }
    const url = new URL("unwarp_worker.js", import.meta.url);
    this.#worker = new Worker(url, { type: "module" });
    this.#worker.addEventListener("message", ({ data }) => this.#receive(data));
    this.#worker.addEventListener("error", () => this.#fail("its script cannot be loaded"));
  }

  /** Whether views can be drawn: there are a context, a frame, and the table of its camera. */
  get isReady() {
    const [table, frame] = [this.#table, this.#frame];
    if (!this.#isRunning || table === null || frame === null) return false;
    // After a change of the camera one of them may be older.
    return table.width_px === frame.width && table.height_px === frame.height;
  }

  /**
   * Take the frame to show from now on, a bitmap that stays open until the next one, or null; and
   * the file of the same picture: to decode it again costs less than to copy a bitmap.
   */
  setFrame(bitmap, source = bitmap) {
    this.#frame = bitmap;
    this.#source = source;
    this.#isSent = false;
  }

  /** Take the model of the camera; null for a camera that cannot be unwarped. */
  setTable(table) {
    this.#table = table;
    if (table !== null) this.#worker?.postMessage({ kind: "table", table: table.json });
  }

  /**
   * Draw a view into a canvas as soon as possible, and fit the canvas to it. While a view of the
   * same canvas is rendered, the newest request waits and replaces those before it.
   */
  draw(canvas, view, onDrawn) {
    const drawing = this.#drawings.get(canvas);
    if (drawing) {
      drawing.next = { view, onDrawn };
    } else {
      this.#drawings.set(canvas, { next: null });
      this.#render(canvas, view, onDrawn).finally(() => this.#finish(canvas));
    }
  }

  /** RGBA of a view, rows from the top, by any frame of the camera. @throws {Error} without one */
  async read(view, bitmap = this.#frame) {
    if (this.fault || bitmap === null) throw new Error(this.fault || "there is no picture");
    this.#worker.postMessage({ kind: "frame", source: bitmap, options: DECODING });
    // The worker has the present frame again with the next view of the page.
    this.#isSent = bitmap === this.#frame;
    const { pixels } = await this.#request({ kind: "read", view });
    if (pixels === null) throw new Error("the picture cannot be unwarped at present");
    return pixels;
  }

  async #render(canvas, view, onDrawn) {
    this.#sendFrame();
    if (show(canvas, view, await this.#request({ kind: "draw", view }))) onDrawn();
  }

  /** Start the drawing that has waited for the one before, if any. */
  #finish(canvas) {
    const { next } = this.#drawings.get(canvas);
    this.#drawings.delete(canvas);
    if (next !== null && this.isReady) this.draw(canvas, next.view, next.onDrawn);
  }

  #sendFrame() {
    if (this.#isSent || this.#frame === null) return;
    this.#worker.postMessage({ kind: "frame", source: this.#source, options: DECODING });
    this.#isSent = true;
  }

  #request(message) {
    this.#lastId += 1;
    const id = this.#lastId;
    this.#worker.postMessage({ ...message, id });
    return new Promise((resolve) => this.#replies.set(id, resolve));
  }

  #receive(data) {
    if (data.kind === "reply") {
      this.#replies.get(data.id)?.(data);
      this.#replies.delete(data.id);
    } else if (data.kind === "failed") {
      this.#fail(data.reason);
    } else if (data.kind === "running") {
      this.#isRunning = true;
      this.detail = data.isSoftware ? SOFTWARE_DETAIL : 1;
      this.interval_ms = data.isSoftware ? SOFTWARE_INTERVAL_MS : 0;
      this.#onChange();
    }
  }

  #fail(reason) {
    this.fault = reason;
    this.#isRunning = false;
    for (const resolve of this.#replies.values()) resolve({ bitmap: null, pixels: null });
    this.#replies.clear();
    this.#onChange();
  }
}

/** Show the reply to a request in a canvas of the view's size; false if there is no picture. */
function show(canvas, view, { bitmap, pixels }) {
  if (bitmap === null && pixels === null) return false;
  const width = view.columns ?? view.width_px;
  const height = view.rows ?? view.height_px;
  resizeCanvas(canvas, width, height);
  const pen = canvas.getContext("2d");
  if (bitmap === null) {
    pen.putImageData(new ImageData(pixels, width, height), 0, 0);
  } else {
    pen.drawImage(bitmap, 0, 0);
    bitmap.close();
  }
  return true;
}
