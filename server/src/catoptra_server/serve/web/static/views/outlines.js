/** Lines over the omnidirectional picture: rim of the camera, horizon, border of the window. */

import { drawLabel } from "../landmarks.js";
import { horizonDirections, pixelFromDirection, shownPixel, windowOutline } from "./directions.js";
import { strokeHorizon, strokeOutlined, tracePolyline } from "./view_canvases.js";

/** Draw the lines where they lie in the picture; `place` gives the position of a pixel. */
export function drawOutlines(pen, context, place) {
  const { table } = context;
  const trace = (pixels) => tracePolyline(pen, pixels.map((pixel) => pixel && place(pixel)));
  const project = (direction) => pixelFromDirection(context, direction);
  const level = horizonDirections(context);
  pen.save();
  clipToPicture(pen, place([0, 0]), place([table.width_px, table.height_px]));
  trace(level.map((_, i) => table.pixelFromAngles(table.max_theta_rad, (i * Math.PI) / 90)));
  strokeOutlined(pen, "#b0b8c0", 1);
  trace(level.map(project));
  strokeHorizon(pen);
  trace(windowOutline(context.window).map(project));
  strokeOutlined(pen, "#ff9de1");
  pen.restore();
  labelHorizon(pen, level.map((one) => shownPixel(context, one)).filter(Boolean).map(place));
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
