/**
 * The panorama: what the camera shows, on a cylinder about the robot's vertical, ahead in the middle
 * and right on the right. Rows are linear in slope, as in `CylinderGeometry` of catoptra_client.
 */

import { chooseCylinder } from "../camera_table.js";
import { screenScale } from "../canvas.js";
import { drawLabel } from "../landmarks.js";
import { toolsOf } from "../panel.js";
import { makeSaveButton, savePanorama } from "../snapshot.js";
import { viewAxes } from "../transforms.js";
import {
  aimFromDirection,
  cursorDirection,
  horizonDirections,
  shownPixel,
  windowOutline,
} from "./directions.js";
import { ARROWS, watchGestures } from "./gestures.js";
import { UnwarpedView } from "./unwarped_view.js";
import { strokeHorizon, strokeOutlined, tracePolyline } from "./view_canvases.js";

const MAX_COLUMNS = 1440;
const KEY_STEP_RAD = (2 * Math.PI) / 180;
/** Of the cursor: straight up or down it would forget its azimuth. */
const STEEPEST_RAD = 1.57;
const HELP =
  "Arrow keys move the cursor. Click or Enter holds it, Escape releases it. Double click or L " +
  "looks there.";

/** Create the view. */
export function create(section, context) {
  new PanoramaView(section, context);
}

class PanoramaView {
  #context;
  #view;

  constructor(section, context) {
    this.#context = context;
    this.#view = new UnwarpedView(section, context, {
      label: "Panorama",
      help: HELP,
      drawEvents: ["selection", "table", "unwarper"],
      markEvents: ["cursor", "window", "landmarks"],
      geometry: () => this.#cylinder(),
      drawMarks: (pen, drawn) => this.#drawMarks(pen, drawn),
      onKey: (event) => this.#onKey(event),
    });
    toolsOf(section).append(makeSaveButton(context, "panorama", savePanorama));
    watchGestures(this.#view.canvases.overlay, {
      ...this.#view.cursorGestures((position) => this.#directionFromPosition(position)),
      aim: (x, y) => this.#aim(this.#directionFromPosition([x, y])),
    });
  }

  /** The cylinder at the resolution of the screen. */
  #cylinder() {
    const { width } = this.#view.canvases;
    const { mount, table, unwarper } = this.#context;
    const columns = Math.min(Math.round(width * screenScale() * unwarper.detail), MAX_COLUMNS);
    return chooseCylinder(table, Math.max(columns, 1), mount);
  }

  /** Where style.css (object-fit: contain) places the picture, in CSS pixels. */
  #placement() {
    const cylinder = this.#cylinder();
    const { width, height } = this.#view.canvases;
    const scale = Math.min(width / cylinder.columns, height / cylinder.rows);
    const left = 0.5 * (width - cylinder.columns * scale);
    const top = 0.5 * (height - cylinder.rows * scale);
    return { cylinder, scale, left, top };
  }

  #drawMarks(pen, drawn) {
    const placement = this.#placement();
    const { cylinder, scale, left, top } = placement;
    const project = (direction) => positionFromDirection(placement, direction);
    pen.save();
    pen.beginPath();
    pen.rect(left, top, cylinder.columns * scale, cylinder.rows * scale);
    pen.clip();
    const { width } = this.#view.canvases;
    const trace = (line) => tracePolyline(pen, line.map(project), 0.5 * width);
    trace(horizonDirections(drawn));
    strokeHorizon(pen);
    this.#drawScale(pen, placement);
    trace(windowOutline(this.#context.window));
    strokeOutlined(pen, "#ff9de1");
    pen.restore();
    this.#view.drawDirections(pen, project);
  }

  #drawScale(pen, placement) {
    const { cylinder, scale, top } = placement;
    const bottom = top + cylinder.rows * scale;
    for (let degrees = -135; degrees < 180; degrees += 45) {
      const { forward } = viewAxes((degrees * Math.PI) / 180, 0);
      const [x] = positionFromDirection(placement, forward);
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
    if (!this.#context.table) return null;
    const { cylinder, scale, left, top } = this.#placement();
    const { columns, rows, top_slope, bottom_slope, seam_azimuth_rad } = cylinder;
    const [column, row] = [(x - left) / scale, (y - top) / scale];
    if (!(column >= 0 && column <= columns && row >= 0 && row <= rows)) return null;
    const azimuth_rad = seam_azimuth_rad + (2 * Math.PI * column) / columns;
    const slope = top_slope + ((bottom_slope - top_slope) * row) / rows;
    return [Math.cos(azimuth_rad), Math.sin(azimuth_rad), slope];
  }

  #aim(direction) {
    if (direction) this.#context.setWindow(aimFromDirection(direction));
  }

  #onKey(event) {
    const { cursor } = this.#context;
    const arrow = ARROWS[event.key];
    if (arrow) this.#moveCursor(arrow, event.shiftKey ? 10 : 1);
    else if (event.key === "Enter") this.#context.setCursor(cursor.pixel, !cursor.isHeld);
    else if (event.key === "l" || event.key === "L") this.#aim(cursorDirection(this.#context));
    else return false;
    return true;
  }

  /**
   * From its present direction, or from straight ahead, or of a camera that does not show that from
   * its optical axis; not out of what the camera shows.
   */
  #moveCursor([dx, dy], step) {
    const { table } = this.#context;
    if (!table) return;
    const start = cursorDirection(this.#context);
    if (!start) {
      const ahead = shownPixel(this.#context, [1, 0, 0]);
      this.#context.setCursor(ahead ?? table.centre_px, true);
      return;
    }
    const { yaw_rad, pitch_rad } = aimFromDirection(start);
    const delta_rad = step * KEY_STEP_RAD;
    const pitch = Math.min(Math.max(pitch_rad - dy * delta_rad, -STEEPEST_RAD), STEEPEST_RAD);
    const { forward } = viewAxes(yaw_rad + dx * delta_rad, pitch);
    const pixel = shownPixel(this.#context, forward);
    if (pixel) this.#context.setCursor(pixel, true);
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
