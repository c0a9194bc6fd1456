/**
 * The panorama: all that the mirror shows, on a cylinder around the viewpoint, ahead in the middle
 * and right on the right. Rows are linear in slope, as in `CylinderGeometry` of catoptra_client.
 */

import { chooseCylinder } from "../camera_table.js";
import { drawLabel, drawLandmarks } from "../landmarks.js";
import { drawOnDemand, isShown } from "../panel.js";
import {
  aimFromDirection,
  cursorDirection,
  landmarkPlaces,
  reasonForNoUnwarping,
  windowOutline,
} from "./directions.js";
import { watchGestures } from "./gestures.js";
import { drawCrosshair, strokeOutlined, tracePolyline, ViewCanvases } from "./view_canvases.js";

const MAX_COLUMNS = 1440;
const AZIMUTH_LABELS_DEG = [-135, -90, -45, 0, 45, 90, 135];
const KEY_STEP_RAD = (2 * Math.PI) / 180;
const HELP =
  "Arrow keys move the cursor. Click or Enter holds it, Escape releases it. Double click or L " +
  "turns the perspective view there.";
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** Create the view. */
export function create(section, context) {
  const view = new PanoramaView(section, context);
  context.on("frame", () => {
    if (isShown(section)) view.draw();
  });
  // Only the reason why nothing is shown: to unwarp the same picture again takes time.
  context.on("state", () => {
    if (context.frame === null) view.requestDraw();
  });
  for (const event of ["selection", "table", "unwarper"]) {
    context.on(event, view.requestDraw);
  }
  for (const event of ["cursor", "window", "landmarks"]) context.on(event, view.requestOverlay);
}

class PanoramaView {
  #context;
  #canvases;

  constructor(section, context) {
    this.#context = context;
    this.requestDraw = drawOnDemand(section, () => this.draw());
    this.requestOverlay = drawOnDemand(section, () => this.#drawOverlay());
    this.#canvases = new ViewCanvases(section, "Panorama", HELP, this.requestDraw);
    const { overlay } = this.#canvases;
    watchGestures(overlay, {
      hover: (x, y) => this.#hover([x, y]),
      leave: () => {
        if (!context.cursor.isHeld) context.setCursor(null);
      },
      tap: (x, y) => this.#place(this.#directionFromPosition([x, y]), true),
      aim: (x, y) => this.#aim(this.#directionFromPosition([x, y])),
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
      this.#context.unwarper.draw(this.#canvases.picture, this.#cylinder(), onDrawn);
    }
  }

  /** The cylinder at the resolution of the screen. */
  #cylinder() {
    const { width, scale } = this.#canvases;
    const { table, unwarper } = this.#context;
    const columns = Math.min(Math.round(width * scale * unwarper.detail), MAX_COLUMNS);
    return chooseCylinder(table, Math.max(columns, 1));
  }

  /** Where style.css (object-fit: contain) places the picture, in CSS pixels. */
  #placement() {
    const cylinder = this.#cylinder();
    const { width, height } = this.#canvases;
    const scale = Math.min(width / cylinder.columns, height / cylinder.rows);
    const left = 0.5 * (width - cylinder.columns * scale);
    const top = 0.5 * (height - cylinder.rows * scale);
    return { cylinder, scale, left, top };
  }

  #drawOverlay() {
    const pen = this.#canvases.clear(this.#canvases.overlay);
    if (reasonForNoUnwarping(this.#context)) return;
    const placement = this.#placement();
    const { cylinder, scale, left, top } = placement;
    const project = (direction) => positionFromDirection(placement, direction);
    pen.save();
    pen.beginPath();
    pen.rect(left, top, cylinder.columns * scale, cylinder.rows * scale);
    pen.clip();
    this.#drawScale(pen, placement);
    const outline = windowOutline(this.#context.window).map(project);
    tracePolyline(pen, outline, 0.5 * this.#canvases.width);
    strokeOutlined(pen, "#ff9de1");
    const places = landmarkPlaces(this.#context, project);
    drawLandmarks(pen, places, this.#canvases.width);
    const cursor = cursorDirection(this.#context);
    const position = cursor && project(cursor);
    if (position) drawCrosshair(pen, position, this.#context.cursor.isHeld);
    pen.restore();
  }

  #drawScale(pen, placement) {
    const { cylinder, scale, top, left } = placement;
    const [, horizon] = positionFromDirection(placement, [1, 0, 0]);
    pen.setLineDash([6, 6]);
    pen.beginPath();
    pen.moveTo(left, horizon);
    pen.lineTo(left + cylinder.columns * scale, horizon);
    strokeOutlined(pen, "#e6e6e6", 1);
    pen.setLineDash([]);
    const bottom = top + cylinder.rows * scale;
    for (const degrees of AZIMUTH_LABELS_DEG) {
      const azimuth_rad = (degrees * Math.PI) / 180;
      const direction = [Math.cos(azimuth_rad), Math.sin(azimuth_rad), 0];
      const [x] = positionFromDirection(placement, direction);
      pen.beginPath();
      pen.moveTo(x, bottom - 6);
      pen.lineTo(x, bottom);
      strokeOutlined(pen, "#e6e6e6", 1);
      pen.textAlign = "center";
      drawLabel(pen, `${degrees}\u00b0`, x, bottom - 13);
    }
    pen.textAlign = "start";
  }

  #directionFromPosition([x, y]) {
    const { cylinder, scale, left, top } = this.#placement();
    const { columns, rows, top_slope, bottom_slope, seam_azimuth_rad } = cylinder;
    const [column, row] = [(x - left) / scale, (y - top) / scale];
    if (!(column >= 0 && column <= columns && row >= 0 && row <= rows)) return null;
    const azimuth_rad = seam_azimuth_rad + (2 * Math.PI * column) / columns;
    const slope = top_slope + ((bottom_slope - top_slope) * row) / rows;
    return [Math.cos(azimuth_rad), Math.sin(azimuth_rad), slope];
  }

  #hover(position) {
    if (reasonForNoUnwarping(this.#context) || this.#context.cursor.isHeld) return;
    this.#place(this.#directionFromPosition(position), false);
  }

  #place(direction, isHeld) {
    const { table } = this.#context;
    if (!table) return;
    const pixel = direction && table.pixelFromDirection(direction);
    this.#context.setCursor(pixel && table.contains(pixel) ? pixel : null, isHeld);
  }

  #aim(direction) {
    if (direction) this.#context.setWindow(aimFromDirection(direction));
  }

  #onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const { cursor } = this.#context;
    const arrow = ARROWS[event.key];
    if (arrow) this.#moveCursor(arrow, event.shiftKey ? 10 : 1);
    else if (event.key === "Enter") this.#context.setCursor(cursor.pixel, !cursor.isHeld);
    else if (event.key === "Escape") this.#context.setCursor(null);
    else if (event.key === "l" || event.key === "L") this.#aim(cursorDirection(this.#context));
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** From its present direction, or from straight ahead. */
  #moveCursor([dx, dy], step) {
    const { table } = this.#context;
    if (!table) return;
    const start = cursorDirection(this.#context);
    if (!start) {
      this.#place([1, 0, 0], true);
      return;
    }
    const { theta_rad, azimuth_rad } = table.anglesFromPixel(this.#context.cursor.pixel);
    const delta_rad = step * KEY_STEP_RAD;
    const theta = Math.min(Math.max(theta_rad - dy * delta_rad, 0), table.max_theta_rad);
    this.#context.setCursor(table.pixelFromAngles(theta, azimuth_rad + dx * delta_rad), true);
  }
}

/** Position in CSS pixels; null for directions along the axis, which no cylinder shows. */
function positionFromDirection({ cylinder, scale, left, top }, [x, y, z]) {
  const rho = Math.hypot(x, y);
  if (rho === 0) return null;
  const { columns, rows, top_slope, bottom_slope, seam_azimuth_rad } = cylinder;
  const turn = 2 * Math.PI;
  const azimuth_rad = (((Math.atan2(y, x) - seam_azimuth_rad) % turn) + turn) % turn;
  const row = (rows * (z / rho - top_slope)) / (bottom_slope - top_slope);
  return [left + (scale * columns * azimuth_rad) / turn, top + scale * row];
}
