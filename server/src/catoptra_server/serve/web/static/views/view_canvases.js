/** Canvases of a view: the picture, and above it an overlay that has the focus and the pointer. */

import { clearedPen } from "../canvas.js";
import { bodyOf, make, setText } from "../panel.js";

/**
 * A picture and its overlay, which fill the body of a view.
 *
 * Sizes are observed, not read: reading them while drawing would force a layout a frame.
 */
export class ViewCanvases {
  /** Size of the view in CSS pixels. */
  width = 1;
  height = 1;

  /** Fill a section: `label` names the view, `help` its keys and gestures. */
  constructor(section, label, help, onResize) {
    this.picture = make("canvas", { className: "picture", ariaHidden: "true" });
    // Opaque, in later calls too: nothing is blended.
    this.picture.getContext("2d", { alpha: false });
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

  /** Clear a canvas of the view. @returns its pen, in CSS pixels */
  clear(canvas) {
    return clearedPen(canvas, this.width, this.height);
  }

  /** Show a message in place of a picture, or with "" the picture. */
  setMessage(text) {
    setText(this.message, text);
    this.message.hidden = text === "";
    this.picture.hidden = text !== "";
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

export function strokeHorizon(pen) {
  pen.setLineDash([6, 6]);
  strokeOutlined(pen, "#e6e6e6", 1);
  pen.setLineDash([]);
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
