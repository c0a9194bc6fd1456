/**
 * A canvas that shows the floor from above, x up and y to the right, with zoom and pan by mouse,
 * touch and keys.
 */

import { watchGestures } from "./views/gestures.js";

const MIN_SCALE = 2;
const MAX_SCALE = 5000;
const KEY_PAN_PX = 40;

export class PlanarView {
  /** Pixels of a metre. */
  scale = 60;
  /** Point of the world in the middle of the canvas. */
  centre = { x: 0, y: 0 };
  #canvas;
  #width = 1;
  #height = 1;
  #onChange;
  #placing = null;

  /** `onChange(isPan)` is called after each change of the view by the user. */
  constructor(canvas, onChange) {
    this.#canvas = canvas;
    this.#onChange = onChange;
    canvas.tabIndex = 0;
    // A click leaves the focus where it is, and with it the arrow keys to the robot.
    canvas.addEventListener("mousedown", (event) => event.preventDefault());
    watchGestures(canvas, {
      drag: (dx, dy) => this.#drag(dx, dy),
      zoom: (factor, left, top) => this.zoom(factor, left, top),
    });
    for (const type of ["pointerdown", "pointermove", "pointerup", "pointercancel"])
      canvas.addEventListener(type, (event) => this.#place(event));
    canvas.addEventListener("keydown", (event) => this.#key(event));
  }

  /** Take the size of the canvas, in CSS pixels; to ask it for each point would cost a layout. */
  setSize(width, height) {
    this.#width = width;
    this.#height = height;
  }

  /** Position on the canvas of a point of the world, in CSS pixels. */
  toScreen(x, y) {
    return [
      this.#width / 2 + (y - this.centre.y) * this.scale,
      this.#height / 2 - (x - this.centre.x) * this.scale,
    ];
  }

  /** Point of the world under a position on the canvas. */
  toWorld(left, top) {
    return {
      x: this.centre.x - (top - this.#height / 2) / this.scale,
      y: this.centre.y + (left - this.#width / 2) / this.scale,
    };
  }

  /** Show all of [xmin, ymin, xmax, ymax] above the lowest `covered` pixels of the canvas. */
  fit([xmin, ymin, xmax, ymax], covered = 0) {
    const height = Math.max(40, this.#height - covered);
    this.#setScale(0.94 * Math.min(this.#width / (ymax - ymin || 1), height / (xmax - xmin || 1)));
    this.centre = { x: (xmin + xmax) / 2 - covered / 2 / this.scale, y: (ymin + ymax) / 2 };
  }

  /** Zoom by a factor; the point under a position on the canvas stays there. */
  zoom(factor, left = this.#width / 2, top = this.#height / 2) {
    const before = this.toWorld(left, top);
    this.#setScale(this.scale * factor);
    const after = this.toWorld(left, top);
    this.centre.x += before.x - after.x;
    this.centre.y += before.y - after.y;
    this.#onChange(false);
  }

  /**
   * Let the next press place a pose instead of panning: the press is its position, the drag its
   * heading. `handler(pose, isFinal)`; null ends the mode.
   */
  setPlacing(handler) {
    this.#placing = handler && { handler, start: null };
    this.#canvas.classList.toggle("placing", Boolean(handler));
  }

  #setScale(scale) {
    this.scale = Math.min(MAX_SCALE, Math.max(MIN_SCALE, scale));
  }

  #pan(right, down) {
    this.centre.x += down / this.scale;
    this.centre.y -= right / this.scale;
    this.#onChange(true);
  }

  #drag(right, down) {
    if (this.#placing === null) this.#pan(right, down);
  }

  #place({ type, button, offsetX, offsetY }) {
    if (this.#placing === null) return;
    if (type === "pointerdown" && button === 0) this.#placing.start = [offsetX, offsetY];
    const { start, handler } = this.#placing;
    if (start === null) return;
    const isFinal = type === "pointerup";
    const [right, down] = [offsetX - start[0], offsetY - start[1]];
    // Below this length a drag is the tremor of a click, which has no direction.
    const yaw = Math.hypot(right, down) < 8 ? 0 : Math.atan2(right, -down);
    if (type === "pointercancel") this.#placing.start = null;
    if (isFinal) this.setPlacing(null);
    handler({ ...this.toWorld(...start), yaw }, isFinal);
  }

  #key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const action = {
      ArrowUp: () => this.#pan(0, KEY_PAN_PX),
      ArrowDown: () => this.#pan(0, -KEY_PAN_PX),
      ArrowLeft: () => this.#pan(KEY_PAN_PX, 0),
      ArrowRight: () => this.#pan(-KEY_PAN_PX, 0),
      "+": () => this.zoom(1.25),
      "=": () => this.zoom(1.25),
      "-": () => this.zoom(0.8),
    }[event.key];
    if (!action) return;
    event.preventDefault();
    action();
  }
}
