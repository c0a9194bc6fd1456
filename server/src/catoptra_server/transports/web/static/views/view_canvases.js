/** Canvases of a view: the picture, and above it an overlay that has the focus and the pointer. */

import { bodyOf, make } from "../panel.js";
import { drawLabel } from "../landmarks.js";

const MAX_SCALE = 2;

/**
 * A picture and its overlay, which fill the body of a view.
 *
 * Sizes are observed, not read: reading them while drawing would force a layout a frame.
 */
export class ViewCanvases {
  /** Size of the view in CSS pixels. */
  width = 1;
  height = 1;

  /**
   * @param {HTMLElement} section of the view
   * @param {string} label name of the view
   * @param {string} help its keys and gestures
   * @param {function(): void} onResize
   */
  constructor(section, label, help, onResize) {
    this.picture = make("canvas", { className: "picture", ariaHidden: "true" });
    const helpText = make("p", { className: "visually-hidden", id: `${section.id}-help` }, help);
    this.overlay = make("canvas", {
      className: "overlay",
      tabIndex: 0,
      role: "application",
      ariaLabel: label,
      title: help,
      "aria-describedby": helpText.id,
    });
    this.message = make("p", { className: "view-message", hidden: true });
    bodyOf(section).append(this.picture, this.overlay, this.message, helpText);
    new ResizeObserver(([{ contentRect }]) => {
      this.width = Math.max(contentRect.width, 1);
      this.height = Math.max(contentRect.height, 1);
      onResize();
    }).observe(bodyOf(section));
  }

  /** Device pixels per CSS pixel, as far as they are worth their cost. */
  get scale() {
    return Math.min(window.devicePixelRatio || 1, MAX_SCALE);
  }

  /** Clear a canvas at the resolution of the screen. @returns its context, in CSS pixels */
  clear(canvas) {
    const [columns, rows] = [this.width, this.height].map((px) => Math.round(px * this.scale));
    if (canvas.width !== columns || canvas.height !== rows) {
      canvas.width = columns;
      canvas.height = rows;
    }
    const pen = canvas.getContext("2d");
    pen.setTransform(this.scale, 0, 0, this.scale, 0, 0);
    pen.clearRect(0, 0, this.width, this.height);
    return pen;
  }

  /** Show a message in place of a picture, or with "" the picture. */
  setMessage(text) {
    if (this.message.textContent !== text) this.message.textContent = text;
    this.message.hidden = text === "";
    this.picture.hidden = text !== "";
  }

  /** Position of a pointer in CSS pixels of the view; reads no layout. */
  positionOf(event) {
    return [event.offsetX, event.offsetY];
  }
}

/** Draw a line with a dark outline, readable on any picture. */
export function strokeOutlined(pen, colour, width = 1.5) {
  pen.lineJoin = "round";
  pen.strokeStyle = "rgba(0, 0, 0, 0.65)";
  pen.lineWidth = width + 2;
  pen.stroke();
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.stroke();
}

/** Draw the cursor; a held one has a ring. */
export function drawCrosshair(pen, [x, y], isHeld) {
  pen.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    pen.moveTo(x + 4 * dx, y + 4 * dy);
    pen.lineTo(x + 12 * dx, y + 12 * dy);
  }
  if (isHeld) {
    pen.moveTo(x + 8, y);
    pen.arc(x, y, 8, 0, 2 * Math.PI);
  }
  strokeOutlined(pen, "#ffe14d");
}

/** Draw a polyline of points, broken where a point is null or where it would cross the seam. */
export function tracePolyline(pen, points, maxStep = Infinity) {
  let previous = null;
  pen.beginPath();
  for (const point of points) {
    if (point !== null) {
      const isNear = previous !== null && Math.abs(point[0] - previous[0]) <= maxStep;
      if (isNear) pen.lineTo(...point);
      else pen.moveTo(...point);
    }
    previous = point;
  }
}

export { drawLabel };
