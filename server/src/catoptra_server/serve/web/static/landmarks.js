/** Status of landmarks: one colour and one shape each, the same in all views and in the legend. */

import { make } from "./panel.js";

const LABEL_FONT = "12px system-ui, sans-serif";
const LABEL_HEIGHT = 14;
const LABEL_GAP = 10;

/** Statuses by name. The colours have a contrast of 3 : 1 to black and to white. */
export const STATUSES = {
  visible: { label: "visible", colour: "#2b83d9", shape: "circle" },
  hidden: { label: "hidden", colour: "#808080", shape: "dash" },
  detected: { label: "detected", colour: "#00945e", shape: "diamond" },
  rejected: { label: "rejected by the gate", colour: "#d55e00", shape: "cross" },
};

/** Landmarks in the world frame, z down, by status: a detection of any note outranks visibility. */
export function landmarksWithStatus(records, notes) {
  const accepted = acceptedByLandmark(notes);
  return records.map((record) => ({
    name: record.name,
    kind: record.kind,
    x_m: record.x_m,
    y_m: record.y_m,
    // Heights of a record count from the floor, upwards.
    z_m: -0.5 * (record.band_bottom_m + record.band_top_m),
    pixel: record.pixel,
    visible: record.visible,
    status: landmarkStatus(record.visible, accepted.get(record.name)),
  }));
}

/** Name of the status of a landmark that is visible or not, with a detection or undefined. */
function landmarkStatus(visible, accepted) {
  if (accepted !== undefined) return accepted ? "detected" : "rejected";
  return visible ? "visible" : "hidden";
}

/** Whether the newest detection of each landmark was accepted; accepted by one note is enough. */
function acceptedByLandmark(notes) {
  const accepted = new Map();
  for (const note of notes.values()) {
    // Notes are the text of any client: nothing of them is certain.
    if (!Array.isArray(note?.detections)) continue;
    for (const detection of note.detections) {
      const name = detection?.landmark;
      if (typeof name !== "string") continue;
      accepted.set(name, accepted.get(name) === true || detection.accepted !== false);
    }
  }
  return accepted;
}

/** Draw the mark of a status, with an outline that separates it from any background. */
export function drawMark(pen, x, y, status, radius = 6) {
  const { colour, shape } = STATUSES[status] ?? STATUSES.hidden;
  pen.save();
  pen.translate(x, y);
  pen.lineCap = "round";
  pen.lineJoin = "round";
  for (const [style, width] of [["#000", 5], ["#fff", 3.5], [colour, 2]]) {
    pen.strokeStyle = style;
    pen.lineWidth = width;
    pen.beginPath();
    traceShape(pen, shape, radius);
    pen.stroke();
  }
  pen.restore();
}

/** Draw the marks and names of landmarks {x, y, status, name}. */
export function drawLandmarks(pen, places, width) {
  for (const { x, y, status } of places) drawMark(pen, x, y, status);
  pen.font = LABEL_FONT;
  placeNames(pen, places, width, (name, left, top) => drawLabel(pen, name, left, top));
}

/**
 * Draw the names of places {x, y, name} by draw(name, left, top, place): beside the mark, above or
 * below it, where that is within the width of the view and covers no other name or mark.
 */
export function placeNames(pen, places, width, draw) {
  const taken = places.map(({ x, y }) => ({ left: x - 5, right: x + 5, y }));
  for (const place of places) {
    const { x, y, name } = place;
    const length = pen.measureText(name).width;
    const mid = x - 0.5 * length;
    const spots = [[x + LABEL_GAP, y], [x - LABEL_GAP - length, y], [mid, y - 17], [mid, y + 17]];
    const spot = spots.find(
      ([left, top]) =>
        left >= 0 && left + length <= width &&
        !taken.some((other) => overlaps(other, left, length, top)),
    );
    if (!spot) continue;
    const [left, top] = spot;
    taken.push({ left, right: left + length, y: top });
    draw(name, left, top, place);
  }
}

function overlaps(other, left, length, y) {
  return other.left < left + length && left < other.right && Math.abs(other.y - y) < LABEL_HEIGHT;
}

/** Draw white text with a dark outline, readable on any picture. */
export function drawLabel(pen, text, x, y) {
  pen.font = LABEL_FONT;
  pen.textBaseline = "middle";
  pen.lineJoin = "round";
  pen.lineWidth = 3;
  pen.strokeStyle = "rgba(0, 0, 0, 0.8)";
  pen.strokeText(text, x, y);
  pen.fillStyle = "#fff";
  pen.fillText(text, x, y);
}

function traceShape(pen, shape, radius) {
  const r = radius;
  if (shape === "circle") {
    pen.arc(0, 0, r, 0, 2 * Math.PI);
  } else if (shape === "diamond") {
    pen.moveTo(0, -r);
    pen.lineTo(r, 0);
    pen.lineTo(0, r);
    pen.lineTo(-r, 0);
    pen.closePath();
  } else if (shape === "cross") {
    pen.moveTo(-r, -r);
    pen.lineTo(r, r);
    pen.moveTo(-r, r);
    pen.lineTo(r, -r);
  } else {
    pen.moveTo(-r, 0);
    pen.lineTo(r, 0);
  }
}

/** Legend of all statuses: a list of marks with their names. */
export function makeLegend() {
  const items = Object.entries(STATUSES).map(([status, { label }]) => {
    const canvas = make("canvas", { width: 40, height: 40, ariaHidden: "true" });
    const pen = canvas.getContext("2d");
    // Twice the size in CSS pixels, for screens of any resolution.
    pen.scale(2, 2);
    drawMark(pen, 10, 10, status);
    return make("li", {}, canvas, label);
  });
  return make("ul", { className: "legend", ariaLabel: "Status of landmarks" }, ...items);
}
