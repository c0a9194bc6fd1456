/** The items of the map: each function draws one, in CSS pixels, by the pen and the view given. */

import { colour } from "./canvas.js";
import { STATUSES } from "./landmarks.js";
import { compose } from "./scan_geometry.js";
import { positionEllipse } from "./beliefs.js";

/** Pen style of a line of constant width. */
export function setLine(pen, name, width = 1.5, dash = []) {
  pen.strokeStyle = colour(name);
  pen.lineWidth = width;
  pen.setLineDash(dash);
}

/** Fill the path with a transparent colour. */
export function fillFaintly(pen, name, alpha) {
  pen.globalAlpha = alpha;
  pen.fillStyle = colour(name);
  pen.fill();
  pen.globalAlpha = 1;
}

/** Begin a path of screen positions. */
export function tracePositions(pen, positions) {
  pen.beginPath();
  for (const position of positions) pen.lineTo(...position);
}

function tracePoints(pen, view, points) {
  tracePositions(pen, points.map(({ x, y }) => view.toScreen(x, y)));
}

export function drawPath(pen, view, points, name, dash) {
  setLine(pen, name, 1.5, dash);
  tracePoints(pen, view, points);
  pen.stroke();
}

/** Lines at whole metres, or tens of metres where these would be too dense. */
export function drawGrid(pen, view, width, height) {
  const step = view.scale >= 18 ? 1 : 10;
  const corner = view.toWorld(0, height);
  const opposite = view.toWorld(width, 0);
  if (step * view.scale < 10) return;
  setLine(pen, "grid", 1);
  pen.beginPath();
  for (let x = Math.ceil(corner.x / step) * step; x <= opposite.x; x += step) {
    const top = Math.round(view.toScreen(x, 0)[1]) + 0.5;
    pen.moveTo(0, top);
    pen.lineTo(width, top);
  }
  for (let y = Math.ceil(corner.y / step) * step; y <= opposite.y; y += step) {
    const left = Math.round(view.toScreen(0, y)[0]) + 0.5;
    pen.moveTo(left, 0);
    pen.lineTo(left, height);
  }
  pen.stroke();
}

/** Picture whose columns run along x, up on the screen. */
export function drawPlan(pen, view, { bounds, image }) {
  const pixel = ((bounds[2] - bounds[0]) * view.scale) / image.width;
  pen.save();
  pen.filter = colour("plan");
  pen.transform(0, -pixel, pixel, 0, ...view.toScreen(bounds[0], bounds[1]));
  pen.drawImage(image, 0, 0);
  pen.restore();
}

/** Corners of a robot in its own frame: its rectangle, the front drawn out to a point. */
export function robotOutline([length, width]) {
  const [front, half] = [length / 2, width / 2];
  return [
    { x: -front, y: -half },
    { x: front * 0.7, y: -half },
    { x: front * 1.15, y: 0 },
    { x: front * 0.7, y: half },
    { x: -front, y: half },
  ];
}

/** A robot's outline; small robots keep a size that can be seen. */
export function drawRobot(pen, view, pose, size_m, name, { isFilled = true, dash = [] } = {}) {
  const enlargement = Math.max(1, 10 / (size_m[0] * view.scale));
  const corners = robotOutline(size_m.map((side) => side * enlargement));
  setLine(pen, name, 1.5, dash);
  tracePoints(pen, view, corners.map((corner) => compose(pose, corner)));
  pen.closePath();
  if (isFilled) fillFaintly(pen, name, 0.25);
  pen.stroke();
}

export const FONT = "11px system-ui, sans-serif";

/** Text beside a point, on a halo of the background. */
export function drawLabel(pen, text, left, top, name = "ink", align = "left") {
  pen.font = FONT;
  pen.textAlign = align;
  pen.textBaseline = "middle";
  pen.lineJoin = "round";
  pen.setLineDash([]);
  pen.lineWidth = 3;
  pen.strokeStyle = colour("well");
  pen.strokeText(text, left, top);
  pen.fillStyle = colour(name);
  pen.fillText(text, left, top);
}

/** Small arrow head of a start pose. */
export function drawStart(pen, view, { location_m, rotation_rad }) {
  const [left, top] = view.toScreen(location_m[0], location_m[1]);
  pen.save();
  pen.translate(left, top);
  pen.rotate(rotation_rad[2]);
  setLine(pen, "muted", 1.25);
  tracePositions(pen, [[-4, 4], [0, -5], [4, 4]]);
  pen.stroke();
  pen.restore();
}

/** Believed pose with its 2-sigma ellipse and the 2-sigma sector of its heading. */
export function drawBelief(pen, view, { pose, covariance }) {
  const [left, top] = view.toScreen(pose.x, pose.y);
  setLine(pen, "filter", 1.75);
  const ellipse = covariance && positionEllipse(covariance);
  if (ellipse) {
    const [major, minor] = [ellipse.major_m * view.scale, ellipse.minor_m * view.scale];
    pen.beginPath();
    // An angle of the world, from x (up) to y (right), counts from up on the screen.
    pen.ellipse(left, top, major, minor, ellipse.angle_rad - Math.PI / 2, 0, 2 * Math.PI);
    fillFaintly(pen, "filter", 0.15);
    pen.stroke();
  }
  drawHeading(pen, left, top, pose.yaw, covariance);
}

function drawHeading(pen, left, top, yaw, covariance) {
  const length = 22;
  const spread = covariance ? Math.min(Math.PI, 2 * Math.sqrt(Math.max(0, covariance[8]))) : 0;
  pen.beginPath();
  pen.moveTo(left, top);
  pen.arc(left, top, length, yaw - spread - Math.PI / 2, yaw + spread - Math.PI / 2);
  pen.closePath();
  fillFaintly(pen, "filter", 0.3);
  const tip = [left + length * Math.sin(yaw), top - length * Math.cos(yaw)];
  tracePositions(pen, [[left, top], tip]);
  pen.stroke();
  pen.beginPath();
  pen.arc(left, top, 2.5, 0, 2 * Math.PI);
  pen.fillStyle = colour("filter");
  pen.fill();
}

/** Ray of a detection from a pose; without a range it ends open. */
export function drawDetection(pen, view, pose, { bearing_rad, range_m, accepted }) {
  const ray = { ...pose, yaw: pose.yaw + bearing_rad };
  const end = compose(ray, { x: range_m ?? 1.5, y: 0 });
  const [left, top] = view.toScreen(end.x, end.y);
  pen.strokeStyle = (accepted ? STATUSES.detected : STATUSES.rejected).colour;
  pen.lineWidth = 1.5;
  pen.setLineDash(accepted && range_m !== null ? [] : [5, 4]);
  tracePoints(pen, view, [pose, end]);
  pen.stroke();
  pen.setLineDash([]);
  if (range_m === null) return;
  pen.beginPath();
  if (accepted) pen.arc(left, top, 3, 0, 2 * Math.PI);
  else cross(pen, left, top, 3.5);
  pen.stroke();
}

function cross(pen, left, top, size) {
  pen.moveTo(left - size, top - size);
  pen.lineTo(left + size, top + size);
  pen.moveTo(left - size, top + size);
  pen.lineTo(left + size, top - size);
}

export function drawPoints(pen, view, points, name) {
  pen.fillStyle = colour(name);
  for (const { x, y } of points) {
    const [left, top] = view.toScreen(x, y);
    pen.fillRect(left - 1.25, top - 1.25, 2.5, 2.5);
  }
}

/** Bar of 1, 2 or 5 times a power of ten metres, and the directions of the axes. */
export function drawScale(pen, view, right, bottom) {
  const wanted_m = 90 / view.scale;
  const power = 10 ** Math.floor(Math.log10(wanted_m));
  const length_m = power * [5, 2, 1].find((digit) => digit * power <= wanted_m);
  const length = length_m * view.scale;
  setLine(pen, "ink", 1.5);
  const [left, top] = [right - length, bottom - 4];
  tracePositions(pen, [[left, top], [left, bottom], [right, bottom], [right, top]]);
  pen.stroke();
  const label = length_m < 1 ? `${Math.round(length_m * 100)} cm` : `${length_m} m`;
  drawLabel(pen, label, right - length / 2, bottom - 10, "ink", "center");
}

/** Arrows of the world's axes, x up and y to the right. */
export function drawAxes(pen, left, top) {
  setLine(pen, "muted", 1.25);
  tracePositions(pen, [[left, top - 22], [left, top], [left + 22, top]]);
  pen.stroke();
  drawLabel(pen, "x", left, top - 29, "muted", "center");
  drawLabel(pen, "y", left + 29, top, "muted", "center");
}
