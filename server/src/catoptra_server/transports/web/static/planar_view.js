/**
 * A canvas that shows the floor from above, x up and y to the right, with zoom and pan by mouse,
 * touch and keys.
 */

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
  #pointers = new Map();
  #placing = null;

  /** `onChange(isPan)` is called after each change of the view by the user. */
  constructor(canvas, onChange) {
    this.#canvas = canvas;
    this.#onChange = onChange;
    canvas.tabIndex = 0;
    // A click leaves the focus where it is, and with it the arrow keys to the robot.
    canvas.addEventListener("mousedown", (event) => event.preventDefault());
    canvas.addEventListener("pointerdown", (event) => this.#press(event));
    canvas.addEventListener("pointermove", (event) => this.#move(event));
    for (const type of ["pointerup", "pointercancel"])
      canvas.addEventListener(type, (event) => this.#release(event));
    canvas.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
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

  #press(event) {
    if (event.button !== 0) return;
    this.#canvas.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (this.#placing) {
      this.#placing.start = [event.offsetX, event.offsetY];
      this.#place(event, false);
    }
  }

  #move(event) {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    if (this.#placing?.start) return this.#place(event, false);
    const other = [...this.#pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.#pointers.set(event.pointerId, now);
    if (!other) return this.#pan(now[0] - before[0], now[1] - before[1]);
    // Two fingers: the middle between them pans, their distance zooms.
    const middle = [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2];
    this.#pan((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    this.zoom(distance(now, other) / Math.max(1, distance(before, other)), ...middle);
  }

  #release(event) {
    this.#pointers.delete(event.pointerId);
    if (this.#placing?.start) this.#place(event, event.type === "pointerup");
  }

  #place(event, isFinal) {
    const { start, handler } = this.#placing;
    const [right, down] = [event.offsetX - start[0], event.offsetY - start[1]];
    // Below this length a drag is the tremor of a click, which has no direction.
    const yaw = Math.hypot(right, down) < 8 ? 0 : Math.atan2(right, -down);
    if (isFinal) this.setPlacing(null);
    handler({ ...this.toWorld(...start), yaw }, isFinal);
  }

  #wheel(event) {
    if (event.ctrlKey && event.deltaMode !== 0) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 20 : 1;
    const step = Math.max(-200, Math.min(200, event.deltaY * lines));
    this.zoom(Math.exp(-0.002 * step), event.offsetX, event.offsetY);
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

const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
