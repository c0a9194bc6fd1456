/**
 * The stream of pictures, states and landmarks: pulled, with one request of each pending, and
 * nothing while the tab is hidden.
 */

import { DECODING, fileFromFrame } from "./connection.js";
import { landmarksWithStatus } from "./landmarks.js";
import { parseReadings } from "./readings.js";

// Sensors report five times a second. Each request costs the server about as much as sending a
// frame, so only a page that drives, or that waits for steps of the clock, asks twice as often.
const STATE_INTERVAL_MS = 200;
const LANDMARKS_INTERVAL_MS = 500;
const RETRY_MS = 500;
const LONGEST_WAIT_MS = 1000;
const NUM_KEPT = 1000;

/** Numbers of the feed. The lists hold the newest 1000. */
export class FeedStatistics {
  frames_drawn = 0;
  /** Age of each frame when it was drawn. */
  ages_ms = [];
  /** When it was drawn, by performance.now(). */
  drawn_ms = [];

  /** Add a frame that has been drawn. */
  add(age_ms, drawn_ms) {
    this.frames_drawn += 1;
    keep(this.ages_ms, age_ms);
    keep(this.drawn_ms, drawn_ms);
  }

  /** Frames per second over the last two seconds. */
  get rate_hz() {
    const since_ms = performance.now() - 2000;
    return this.drawn_ms.filter((time_ms) => time_ms > since_ms).length / 2;
  }
}

function keep(list, value) {
  list.push(value);
  if (list.length > NUM_KEPT) list.shift();
}

/** Start to pull; emits "frame", "state" and "landmarks" on the context. */
export function startFeed(context) {
  const frames = new FramePull(context);
  const states = new Poll(context, STATE_INTERVAL_MS, () => requestState(context));
  const landmarks = new Poll(context, LANDMARKS_INTERVAL_MS, () => requestLandmarks(context));
  const askAll = () => {
    states.ask();
    landmarks.ask();
    frames.ask();
  };
  context.pictures.on("open", askAll);
  document.addEventListener("visibilitychange", askAll);
  context.on("selection", () => {
    landmarks.ask();
    frames.ask();
  });
  context.on("variant", () => frames.ask());
  // Frames too: under lockstep by its time, otherwise after an error.
  context.on("state", () => frames.ask());
  askAll();
}

/** A request that is repeated at an interval, one pending at most. */
class Poll {
  #context;
  #request;
  #isPending = false;

  constructor(context, interval_ms, request) {
    this.#context = context;
    this.#request = request;
    this.#repeat(interval_ms);
  }

  #repeat(interval_ms) {
    const { isDriving, server } = this.#context;
    const isFast = isDriving || server.clock === "lockstep";
    setTimeout(() => {
      this.ask();
      this.#repeat(interval_ms);
    }, isFast ? interval_ms / 2 : interval_ms);
  }

  async ask() {
    if (this.#isPending || document.hidden || !this.#context.pictures.isOpen) return;
    this.#isPending = true;
    try {
      await this.#request();
    } catch (error) {
      this.#context.report(error);
    } finally {
      this.#isPending = false;
    }
  }
}

async function requestState(context) {
  const { robot } = context.selected;
  const reply = await context.pictures.request({ kind: "get_state", robot });
  if (robot !== context.selected.robot) return;
  const readings = parseReadings(reply.reports);
  const notes = new Map(reply.notes.map(({ name, text }) => [name, JSON.parse(text)]));
  context.state = { reply, readings, notes };
  context.emit("state", context.state);
}

async function requestLandmarks(context) {
  const { robot, camera } = context.selected;
  if (!robot || !camera) return;
  const reply = await context.pictures.request({ kind: "get_landmarks", robot, camera });
  if (robot !== context.selected.robot || camera !== context.selected.camera) return;
  context.landmarks = landmarksWithStatus(reply.landmarks, context.state?.notes ?? new Map());
  context.emit("landmarks", context.landmarks);
}

/** Pulls frames of the selected camera: the next one is on its way while this one is drawn. */
class FramePull {
  #context;
  #isPending = false;
  #retryAt_ms = 0;
  #shown = { settings: "", time_s: -1 };
  /** Ends when the newest frame is on the screen. A slow unwarper skips frames by itself. */
  #drawing = Promise.resolve();

  #fail = (error) => {
    this.#retryAt_ms = performance.now() + RETRY_MS;
    this.#context.report(error);
  };

  constructor(context) {
    this.#context = context;
  }

  /** Request a frame, unless one is pending or none is wanted. */
  async ask() {
    if (this.#isPending || !this.#isWanted()) return;
    this.#isPending = true;
    const { robot, camera } = this.#context.selected;
    const settings = this.#settings;
    try {
      const request = { robot, camera, encoding: "jpeg", ...this.#context.variantRequest };
      const frame = await this.#context.pictures.requestFrame(request);
      await this.#drawing;
      this.#shown = { settings, time_s: frame.header.time_s };
      this.#drawing = this.#draw(frame, robot, camera).catch(this.#fail);
    } catch (error) {
      this.#fail(error);
    } finally {
      this.#isPending = false;
    }
    this.ask();
  }

  #isWanted() {
    const { pictures, selected, server, state } = this.#context;
    if (document.hidden || !pictures.isOpen || !selected.robot || !selected.camera) return false;
    if (performance.now() < this.#retryAt_ms) return false;
    if (server.clock !== "lockstep") return true;
    // The same moment gives the same picture.
    if (this.#shown.settings !== this.#settings) return true;
    return state !== null && state.reply.time_s !== this.#shown.time_s;
  }

  /** What a picture depends on beside the time. */
  get #settings() {
    return JSON.stringify([this.#context.selected, this.#context.variantRequest]);
  }

  /** Decode and draw a frame in an animation frame, unless the tab is hidden before. */
  async #draw(frame, robot, camera) {
    const context = this.#context;
    const file = fileFromFrame(frame);
    const bitmap = await createImageBitmap(file, DECODING);
    const isShown = await nextAnimationFrame();
    const isSelected = robot === context.selected.robot && camera === context.selected.camera;
    // An old frame must not follow a time in which the tab was hidden.
    if (!isShown || !isSelected) {
      bitmap.close();
      this.#shown.time_s = -1;
      return;
    }
    const { header, received_ms } = frame;
    this.#emit({ header, file, bitmap, received_ms });
    const now_ms = performance.now();
    context.statistics.add(1000 * header.age_s + now_ms - received_ms, now_ms);
  }

  #emit(frame) {
    const context = this.#context;
    const previous = context.frame;
    context.takeFrame(frame);
    context.emit("frame", frame);
    previous?.bitmap.close();
  }
}

/** Whether an animation frame came before the tab was hidden. */
function nextAnimationFrame() {
  if (document.hidden) return Promise.resolve(false);
  return new Promise((resolve) => {
    const end = (isShown) => {
      cancelAnimationFrame(request);
      clearTimeout(timer);
      document.removeEventListener("visibilitychange", onChange);
      resolve(isShown);
    };
    const onChange = () => end(false);
    document.addEventListener("visibilitychange", onChange);
    const request = requestAnimationFrame(() => end(true));
    // A window behind others may have no animation frames, though its page counts as visible.
    const timer = setTimeout(() => end(true), LONGEST_WAIT_MS);
  });
}
