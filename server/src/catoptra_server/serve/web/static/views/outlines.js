/** Lines over the omnidirectional picture: rim of the camera, horizon, border of the window. */

import { drawLabel } from "../landmarks.js";
import { levelDirections, pixelFromDirection, shownPixel, windowOutline } from "./directions.js";
import { strokeOutlined, tracePolyline } from "./view_canvases.js";

/** Draw the lines where they lie in the picture; `place` gives the position of a pixel. */
export function drawOutlines(pen, context, place) {
  const { table } = context;
  const trace = (pixels) => tracePolyline(pen, pixels.map((pixel) => pixel && place(pixel)));
  const project = (direction) => pixelFromDirection(context, direction);
  const circle = levelDirections();
  pen.save();
  clipToPicture(pen, place([0, 0]), place([table.width_px, table.height_px]));
  trace(circle.map(([x, y]) => table.pixelFromAngles(table.max_theta_rad, Math.atan2(y, x))));
  strokeOutlined(pen, "#b0b8c0", 1);
  trace(circle.map(project));
  pen.setLineDash([6, 6]);
  strokeOutlined(pen, "#e6e6e6", 1);
  pen.setLineDash([]);
  trace(windowOutline(context.window).map(project));
  strokeOutlined(pen, "#ff9de1");
  pen.restore();
  labelHorizon(pen, circle.map((one) => shownPixel(context, one)).filter(Boolean).map(place));
}

/** A rim may lie outside of the picture; one that touches its border is drawn whole. */
function clipToPicture(pen, [left, top], [right, bottom]) {
  pen.beginPath();
  pen.rect(left - 1, top - 1, right - left + 2, bottom - top + 2);
  pen.clip();
}

/** At its lowest point, or at the left end of a level line. */
function labelHorizon(pen, points) {
  const lowest = points.reduce((a, b) => (b[1] > a[1] + 1 ? b : a), points[0]);
  if (lowest) drawLabel(pen, "horizon", lowest[0] + 4, lowest[1]);
}
