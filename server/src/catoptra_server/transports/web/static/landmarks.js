/** Status of landmarks: one colour and one shape each, the same in all views and in the legend. */

import { element } from "./elements.js";

/** Statuses by name. The colours have a contrast of 3 : 1 to black and to white. */
export const STATUSES = {
  visible: { label: "visible", colour: "#2b83d9", shape: "circle" },
  hidden: { label: "hidden", colour: "#808080", shape: "dash" },
  detected: { label: "detected", colour: "#00945e", shape: "diamond" },
  rejected: { label: "rejected by the gate", colour: "#d55e00", shape: "cross" },
};

/**
 * Landmarks with position and status: a detection of any note outranks visibility.
 *
 * @param {Object[]} records of the reply `landmarks`
 * @param {Map<string, Object>} notes by name
 * @returns {{name, kind, x_m, y_m, z_m, pixel, visible, status}[]} in the world frame, z down
 */
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
export function landmarkStatus(visible, accepted) {
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

/**
 * Draw the mark of a status, with an outline that separates it from any background.
 *
 * @param {CanvasRenderingContext2D} context
 * @param {number} x
 * @param {number} y centre, in units of the context
 * @param {string} status key of STATUSES
 * @param {number} radius half the size of the mark
 */
export function drawMark(context, x, y, status, radius = 6) {
  const { colour, shape } = STATUSES[status] ?? STATUSES.hidden;
  context.save();
  context.translate(x, y);
  context.lineCap = "round";
  context.lineJoin = "round";
  for (const [style, width] of [["#000", 5], ["#fff", 3.5], [colour, 2]]) {
    context.strokeStyle = style;
    context.lineWidth = width;
    context.beginPath();
    traceShape(context, shape, radius);
    context.stroke();
  }
  context.restore();
}

/** Draw a mark and the name beside it. */
export function drawLandmark(context, x, y, status, name) {
  drawMark(context, x, y, status);
  drawLabel(context, name, x + 10, y);
}

/** Draw white text with a dark outline, readable on any picture. */
export function drawLabel(context, text, x, y) {
  context.font = "12px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.lineJoin = "round";
  context.lineWidth = 3;
  context.strokeStyle = "rgba(0, 0, 0, 0.8)";
  context.strokeText(text, x, y);
  context.fillStyle = "#fff";
  context.fillText(text, x, y);
}

function traceShape(context, shape, radius) {
  const r = radius;
  if (shape === "circle") {
    context.arc(0, 0, r, 0, 2 * Math.PI);
  } else if (shape === "diamond") {
    context.moveTo(0, -r);
    context.lineTo(r, 0);
    context.lineTo(0, r);
    context.lineTo(-r, 0);
    context.closePath();
  } else if (shape === "cross") {
    context.moveTo(-r, -r);
    context.lineTo(r, r);
    context.moveTo(-r, r);
    context.lineTo(r, -r);
  } else {
    context.moveTo(-r, 0);
    context.lineTo(r, 0);
  }
}

/** Legend of all statuses: a list of marks with their names. */
export function makeLegend() {
  const items = Object.entries(STATUSES).map(([status, { label }]) => {
    const size = 20;
    const scale = window.devicePixelRatio || 1;
    const canvas = element("canvas", {
      class: "legend-mark",
      width: Math.round(size * scale),
      height: Math.round(size * scale),
      "aria-hidden": "true",
    });
    const context = canvas.getContext("2d");
    context.scale(scale, scale);
    drawMark(context, size / 2, size / 2, status);
    return element("li", {}, canvas, label);
  });
  return element("ul", { class: "legend", "aria-label": "Status of landmarks" }, ...items);
}
