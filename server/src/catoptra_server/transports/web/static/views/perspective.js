/** The perspective view: a pinhole camera at the viewpoint, turned by hand. */

import { drawLandmarks } from "../landmarks.js";
import { drawOnDemand, isShown, make, toolsOf } from "../panel.js";
import { viewAxes } from "../transforms.js";
import { cursorDirection, landmarkPlaces, reasonForNoUnwarping } from "./directions.js";
import { watchGestures } from "./gestures.js";
import { drawCrosshair, ViewCanvases } from "./view_canvases.js";

const MIN_FOV_RAD = 0.1;
const MAX_FOV_RAD = 2.4;
const MAX_SIDE_PX = 1280;
const ZOOM_STEP = 1.15;
const HELP =
  "Drag or arrow keys turn the view, with Shift farther; wheel or + and - change its field of " +
  "view; 0 looks ahead again. Click holds the cursor, Escape releases it.";
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const AHEAD = { yaw_rad: 0, pitch_rad: -0.2, fov_rad: 1.3 };

/** Create the view. */
export function create(section, context) {
  const view = new PerspectiveView(section, context);
  context.on("frame", () => {
    if (isShown(section)) view.draw();
  });
  // Only the reason why nothing is shown: to unwarp the same picture again takes time.
  context.on("state", () => {
    if (context.frame === null) view.requestDraw();
  });
  for (const event of ["selection", "table", "unwarper", "window"]) {
    context.on(event, view.requestDraw);
  }
  for (const event of ["cursor", "landmarks"]) context.on(event, view.requestOverlay);
}

class PerspectiveView {
  #context;
  #canvases;
  #values;

  constructor(section, context) {
    this.#context = context;
    this.requestDraw = drawOnDemand(section, () => this.draw());
    this.requestOverlay = drawOnDemand(section, () => this.#drawOverlay());
    this.#canvases = new ViewCanvases(section, "Perspective view", HELP, () => this.#resize());
    this.#values = make("span", { className: "quiet" });
    const ahead = make("button", { type: "button", className: "button small" }, "Ahead");
    ahead.addEventListener("click", () => context.setWindow(AHEAD));
    toolsOf(section).append(this.#values, ahead);
    const { overlay } = this.#canvases;
    watchGestures(overlay, {
      drag: (dx, dy) => this.#drag(dx, dy),
      zoom: (factor) => this.#zoom(factor),
      hover: (x, y) => {
        if (!context.cursor.isHeld) this.#placeCursor([x, y], false);
      },
      leave: () => {
        if (!context.cursor.isHeld) context.setCursor(null);
      },
      tap: (x, y) => this.#placeCursor([x, y], true),
    });
    overlay.addEventListener("keydown", (event) => this.#onKey(event));
  }

  draw() {
    const reason = reasonForNoUnwarping(this.#context);
    this.#canvases.setMessage(reason);
    if (reason) {
      this.#drawOverlay();
    } else {
      // Together with its picture: marks lie on what they name.
      const onDrawn = () => this.#drawOverlay();
      this.#context.unwarper.draw(this.#canvases.picture, this.#view(), onDrawn);
    }
    const { yaw_rad, pitch_rad, fov_rad } = this.#context.window;
    const degrees = (angle_rad) => `${Math.round((angle_rad * 180) / Math.PI)}\u00b0`;
    const text = `${degrees(yaw_rad)}, ${degrees(pitch_rad)}, ${degrees(fov_rad)} wide`;
    if (this.#values.textContent !== text) this.#values.textContent = text;
  }

  /** The view at the resolution of the screen. */
  #view() {
    const { width, height, scale } = this.#canvases;
    const { detail } = this.#context.unwarper;
    const reduction = Math.min(scale * detail, MAX_SIDE_PX / Math.max(width, height));
    return {
      ...this.#context.window,
      width_px: Math.max(Math.round(width * reduction), 1),
      height_px: Math.max(Math.round(height * reduction), 1),
    };
  }

  get #focalLength() {
    return (0.5 * this.#canvases.width) / Math.tan(0.5 * this.#context.window.fov_rad);
  }

  #drawOverlay() {
    const pen = this.#canvases.clear(this.#canvases.overlay);
    if (reasonForNoUnwarping(this.#context)) return;
    const places = landmarkPlaces(this.#context, (direction) => this.#project(direction));
    drawLandmarks(pen, places, this.#canvases.width);
    const cursor = cursorDirection(this.#context);
    const position = cursor && this.#project(cursor);
    if (position) drawCrosshair(pen, position, this.#context.cursor.isHeld);
  }

  /** Position of a direction in CSS pixels; null behind the view. */
  #project(direction) {
    const { yaw_rad, pitch_rad } = this.#context.window;
    const { forward, right, down } = viewAxes(yaw_rad, pitch_rad);
    const along = dot(forward, direction);
    if (along <= 0) return null;
    const { width, height } = this.#canvases;
    const scale = this.#focalLength / along;
    return [
      0.5 * width + scale * dot(right, direction),
      0.5 * height + scale * dot(down, direction),
    ];
  }

  #placeCursor([x, y], isHeld) {
    const { table, window: perspective } = this.#context;
    if (!table) return;
    const { forward, right, down } = viewAxes(perspective.yaw_rad, perspective.pitch_rad);
    const { width, height } = this.#canvases;
    const [across, along] = [x - 0.5 * width, y - 0.5 * height].map((px) => px / this.#focalLength);
    const direction = forward.map((value, i) => value + across * right[i] + along * down[i]);
    const pixel = table.pixelFromDirection(direction);
    this.#context.setCursor(pixel && table.contains(pixel) ? pixel : null, isHeld);
  }

  #resize() {
    this.#context.setWindow({ aspect: this.#canvases.width / this.#canvases.height });
  }

  /** What is grabbed follows the pointer. */
  #drag(dx, dy) {
    this.#turn(-dx / this.#focalLength, dy / this.#focalLength);
  }

  #turn(yaw_rad, pitch_rad) {
    const present = this.#context.window;
    const turned = present.yaw_rad + yaw_rad;
    this.#context.setWindow({
      yaw_rad: turned - 2 * Math.PI * Math.round(turned / (2 * Math.PI)),
      pitch_rad: Math.min(Math.max(present.pitch_rad + pitch_rad, -0.5 * Math.PI), 0.5 * Math.PI),
    });
  }

  #zoom(factor) {
    const fov_rad = this.#context.window.fov_rad / factor;
    this.#context.setWindow({ fov_rad: Math.min(Math.max(fov_rad, MIN_FOV_RAD), MAX_FOV_RAD) });
  }

  #onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = ARROWS[event.key];
    const step_rad = this.#context.window.fov_rad / (event.shiftKey ? 4 : 20);
    if (arrow) this.#turn(arrow[0] * step_rad, arrow[1] * step_rad);
    else if (event.key === "+" || event.key === "=") this.#zoom(ZOOM_STEP);
    else if (event.key === "-") this.#zoom(1 / ZOOM_STEP);
    else if (event.key === "0") this.#context.setWindow(AHEAD);
    else if (event.key === "Escape") this.#context.setCursor(null);
    else return;
    event.preventDefault();
    event.stopPropagation();
  }
}

function dot([a, b, c], [x, y, z]) {
  return a * x + b * y + c * z;
}
