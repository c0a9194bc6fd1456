/** The perspective view: a pinhole camera at the viewpoint, turned by hand. */

import { screenScale } from "../canvas.js";
import { make, makeButton, setText, toolsOf } from "../panel.js";
import { degrees } from "../scan_geometry.js";
import { viewAxes } from "../transforms.js";
import { ARROWS, watchGestures } from "./gestures.js";
import { UnwarpedView } from "./unwarped_view.js";

const MIN_FOV_RAD = 0.1;
const MAX_FOV_RAD = 2.4;
const MAX_SIDE_PX = 1280;
const ZOOM_STEP = 1.15;
const HELP =
  "Drag or arrow keys turn the view, with Shift farther; wheel or + and - change its field of " +
  "view; 0 looks ahead again. Click holds the cursor, Escape releases it.";
const AHEAD = { yaw_rad: 0, pitch_rad: -0.2, fov_rad: 1.3 };

/** Create the view. */
export function create(section, context) {
  new PerspectiveView(section, context);
}

class PerspectiveView {
  #context;
  #view;
  #values = make("span", { className: "quiet" });

  constructor(section, context) {
    this.#context = context;
    this.#view = new UnwarpedView(section, context, {
      label: "Perspective view",
      help: HELP,
      drawEvents: ["selection", "table", "unwarper", "window"],
      markEvents: ["cursor", "landmarks"],
      geometry: () => this.#geometry(),
      drawMarks: (pen) => this.#view.drawDirections(pen, (direction) => this.#project(direction)),
      onKey: (event) => this.#onKey(event),
      onDraw: () => this.#showValues(),
      onResize: () => this.#resize(),
    });
    const small = { className: "button small" };
    const ahead = makeButton("Ahead", () => context.setWindow(AHEAD), small);
    toolsOf(section).append(this.#values, ahead);
    watchGestures(this.#view.canvases.overlay, {
      ...this.#view.cursorGestures((position) => this.#directionFromPosition(position)),
      drag: (dx, dy) => this.#drag(dx, dy),
      zoom: (factor) => this.#zoom(factor),
    });
  }

  #showValues() {
    const { yaw_rad, pitch_rad, fov_rad } = this.#context.window;
    const [yaw, pitch, fov] = [yaw_rad, pitch_rad, fov_rad].map((angle) => degrees(angle, 0));
    setText(this.#values, `${yaw}, ${pitch}, ${fov} wide`);
  }

  /** The view at the resolution of the screen. */
  #geometry() {
    const { width, height } = this.#view.canvases;
    const { detail } = this.#context.unwarper;
    const reduction = Math.min(screenScale() * detail, MAX_SIDE_PX / Math.max(width, height));
    return {
      ...this.#context.window,
      robot_from_mirror: this.#context.mount,
      width_px: Math.max(Math.round(width * reduction), 1),
      height_px: Math.max(Math.round(height * reduction), 1),
    };
  }

  get #axes() {
    const { yaw_rad, pitch_rad } = this.#context.window;
    return viewAxes(yaw_rad, pitch_rad);
  }

  get #focalLength() {
    return (0.5 * this.#view.canvases.width) / Math.tan(0.5 * this.#context.window.fov_rad);
  }

  /** Position of a direction in CSS pixels; null behind the view. */
  #project(direction) {
    const { forward, right, down } = this.#axes;
    const along = dot(forward, direction);
    if (along <= 0) return null;
    const { width, height } = this.#view.canvases;
    const scale = this.#focalLength / along;
    return [
      0.5 * width + scale * dot(right, direction),
      0.5 * height + scale * dot(down, direction),
    ];
  }

  #directionFromPosition([x, y]) {
    const { forward, right, down } = this.#axes;
    const { width, height } = this.#view.canvases;
    const [across, along] = [x - 0.5 * width, y - 0.5 * height].map((px) => px / this.#focalLength);
    return forward.map((value, i) => value + across * right[i] + along * down[i]);
  }

  #resize() {
    this.#context.setWindow({ aspect: this.#view.canvases.width / this.#view.canvases.height });
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
    const arrow = ARROWS[event.key];
    const step_rad = this.#context.window.fov_rad / (event.shiftKey ? 4 : 20);
    if (arrow) this.#turn(arrow[0] * step_rad, -arrow[1] * step_rad);
    else if (event.key === "+" || event.key === "=") this.#zoom(ZOOM_STEP);
    else if (event.key === "-") this.#zoom(1 / ZOOM_STEP);
    else if (event.key === "0") this.#context.setWindow(AHEAD);
    else return false;
    return true;
  }
}

function dot([a, b, c], [x, y, z]) {
  return a * x + b * y + c * z;
}
