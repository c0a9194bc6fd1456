/**
 * The omnidirectional picture: zoom, pan, landmarks, horizon, rim, the perspective view's outline,
 * and the cursor. By 2D canvas, so that it needs no WebGL.
 */

import { otherHand } from "../camera_table.js";
import { screenScale } from "../canvas.js";
import { CursorCard } from "../cursor_card.js";
import { drawLandmarks } from "../landmarks.js";
import { bodyOf, drawOnDemand, isShown, make, makeButton, setText, toolsOf } from "../panel.js";
import { makeSaveButton, savePicture } from "../snapshot.js";
import {
  aimFromDirection,
  directionFromPixel,
  landmarkPlaces,
  pixelFromDirection,
  reasonForNoPicture,
} from "./directions.js";
import { ARROWS, cursorGestures, watchGestures } from "./gestures.js";
import { drawOutlines } from "./outlines.js";
import { drawCrosshair, ViewCanvases } from "./view_canvases.js";

const MAX_ZOOM = 40;
const ZOOM_STEP = 1.25;
// Above, single pixels are meant to be seen.
const SMOOTH_UP_TO = 3;
const HELP =
  "Drag to pan, wheel or + and - to zoom, 0 to fit. Arrow keys move a cursor, with Shift by ten " +
  "pixels, with Alt they pan. Click or Enter holds the cursor, Escape releases it. Double click " +
  "or L looks there.";

/** Create the view. */
export function create(section, context) {
  const view = new OmniView(section, context);
  context.on("frame", () => {
    if (isShown(section)) view.draw();
  });
  // For the reason why nothing is shown.
  context.on("state", () => context.frame ?? view.requestDraw());
  for (const event of ["selection", "table"]) context.on(event, view.requestDraw);
  for (const event of ["cursor", "window", "landmarks"]) context.on(event, view.requestOverlay);
}

class OmniView {
  #context;
  #canvases;
  #caption;
  #card;
  #zoom = 1;
  /** Pixel of the frame in the middle of the view; null for the middle of the frame. */
  #middle = null;

  constructor(section, context) {
    this.#context = context;
    this.requestDraw = drawOnDemand(section, () => this.draw());
    this.requestOverlay = drawOnDemand(section, () => this.#drawOverlay());
    this.#canvases = new ViewCanvases(section, "Omnidirectional picture", HELP, this.requestDraw);
    this.#caption = make("p", { className: "view-caption" });
    this.#card = new CursorCard(section, context);
    bodyOf(section).append(this.#caption, this.#card.node);
    this.#addTools(toolsOf(section));
    const { overlay } = this.#canvases;
    watchGestures(overlay, {
      ...cursorGestures(context, (position, isHeld) => this.#placeCursor(position, isHeld)),
      drag: (dx, dy) => this.#pan(dx, dy),
      zoom: (factor, x, y) => this.#zoomAbout(factor, x, y),
      aim: (x, y) => this.#aim(this.#pixelFromPosition([x, y])),
    });
    overlay.addEventListener("keydown", (event) => this.#onKey(event));
  }

  draw() {
    const reason = reasonForNoPicture(this.#context);
    this.#canvases.setMessage(reason);
    if (!reason) this.#drawPicture();
    this.#drawOverlay();
    this.#drawCaption();
  }

  #drawPicture() {
    const { bitmap } = this.#context.frame;
    const pen = this.#canvases.clear(this.#canvases.picture);
    const { scale, left, top } = this.#placement();
    pen.imageSmoothingEnabled = scale * screenScale() < SMOOTH_UP_TO;
    pen.drawImage(bitmap, left, top, bitmap.width * scale, bitmap.height * scale);
  }

  #drawOverlay() {
    const pen = this.#canvases.clear(this.#canvases.overlay);
    const { table, cursor } = this.#context;
    if (reasonForNoPicture(this.#context)) return;
    if (table) drawOutlines(pen, this.#context, (pixel) => this.#positionFromPixel(pixel));
    this.#drawLandmarks(pen);
    if (!cursor.pixel) return;
    const position = this.#positionFromPixel(cursor.pixel);
    drawCrosshair(pen, position, cursor.isHeld);
    this.#card.place(position, this.#canvases);
  }

  /** By the pose of the frame; without a model of the camera by the pixels of the reply. */
  #drawLandmarks(pen) {
    const { table, landmarks } = this.#context;
    const places = table
      ? landmarkPlaces(this.#context, (direction) => this.#project(direction))
      : landmarks.filter(({ pixel }) => pixel).map(({ name, status, pixel }) => {
          const [x, y] = this.#positionFromPixel(pixel);
          return { x, y, name, status };
        });
    drawLandmarks(pen, places, this.#canvases.width);
  }

  #drawCaption() {
    const { frame } = this.#context;
    if (frame === null) return;
    const { width_px, height_px, missed_frames, dropped_frames } = frame.header;
    const lost = missed_frames + dropped_frames;
    setText(this.#caption, `${width_px} \u00d7 ${height_px} px${lost ? `, ${lost} left out` : ""}`);
  }

  #addTools(tools) {
    const button = (text, ariaLabel, action) =>
      tools.append(makeButton(text, action, { className: "button small", ariaLabel }));
    button("\u2212", "Zoom out", () => this.#zoomAboutMiddle(1 / ZOOM_STEP));
    button("+", "Zoom in", () => this.#zoomAboutMiddle(ZOOM_STEP));
    button("\u21c4", "Turn the picture round, left to right", () => this.#turn());
    button("Fit", "Fit the whole picture", () => this.#fit());
    tools.append(makeSaveButton(this.#context, "picture", savePicture));
  }

  #turn() {
    const { table } = this.#context;
    if (table) this.#context.setVariant({ picture: otherHand(table.picture) });
  }

  /** CSS pixels per pixel of the frame, and the position of the frame's corner. */
  #placement() {
    const { width, height } = this.#canvases;
    const fitted = this.#fittedArea();
    const scale = this.#zoom * Math.min(width / fitted.width, height / fitted.height);
    const [u, v] = this.#middle ?? fitted.middle;
    return { scale, left: 0.5 * width - u * scale, top: 0.5 * height - v * scale };
  }

  /** The part of the frame to fit into the view: the mirror, without the black around it. */
  #fittedArea() {
    const { frame, table } = this.#context;
    const { width, height } = frame?.bitmap ?? { width: 1, height: 1 };
    const whole = { width, height, middle: [0.5 * width, 0.5 * height] };
    if (!table) return whole;
    const side = 2 * table.rim_radius_px;
    if (side > Math.max(width, height)) return whole;
    return { width: side, height: side, middle: table.centre_px };
  }

  #positionFromPixel([u, v]) {
    const { scale, left, top } = this.#placement();
    return [left + u * scale, top + v * scale];
  }

  #pixelFromPosition([x, y]) {
    const { scale, left, top } = this.#placement();
    return [(x - left) / scale, (y - top) / scale];
  }

  #project(direction) {
    const pixel = pixelFromDirection(this.#context, direction);
    return pixel && this.#positionFromPixel(pixel);
  }

  #zoomAboutMiddle(factor) {
    this.#zoomAbout(factor, 0.5 * this.#canvases.width, 0.5 * this.#canvases.height);
  }

  /** Zoom so that what the view shows at (x, y) stays there. */
  #zoomAbout(factor, x, y) {
    const { bitmap } = this.#context.frame ?? {};
    if (!bitmap) return;
    const fixed = this.#pixelFromPosition([x, y]);
    this.#zoom = Math.min(Math.max(this.#zoom * factor, 1), MAX_ZOOM);
    const { scale } = this.#placement();
    const { width, height } = this.#canvases;
    this.#setMiddle([fixed[0] - (x - 0.5 * width) / scale, fixed[1] - (y - 0.5 * height) / scale]);
  }

  #pan(dx, dy) {
    const { scale } = this.#placement();
    const { bitmap } = this.#context.frame ?? {};
    if (!bitmap) return;
    const [u, v] = this.#middle ?? this.#fittedArea().middle;
    this.#setMiddle([u - dx / scale, v - dy / scale]);
  }

  /** Keep the middle of the view on the frame; a picture that fits stays centred. */
  #setMiddle([u, v]) {
    const { bitmap } = this.#context.frame;
    const clamp = (value, size) => Math.min(Math.max(value, 0), size);
    const isFitted = this.#zoom === 1;
    this.#middle = isFitted ? null : [clamp(u, bitmap.width), clamp(v, bitmap.height)];
    this.requestDraw();
  }

  #fit() {
    this.#zoom = 1;
    this.#middle = null;
    this.requestDraw();
  }

  /** Outside the frame there is no cursor. */
  #placeCursor(position, isHeld) {
    const { bitmap } = this.#context.frame ?? {};
    if (!bitmap) return;
    const pixel = this.#pixelFromPosition(position);
    const [u, v] = pixel;
    const isInside = u >= 0 && v >= 0 && u <= bitmap.width && v <= bitmap.height;
    this.#context.setCursor(isInside ? pixel : null, isHeld);
  }

  #moveCursor([du, dv], step) {
    const { bitmap } = this.#context.frame ?? {};
    if (!bitmap) return;
    const start = this.#context.cursor.pixel;
    // Pixel centres, from which keys step on.
    const snap = (value, delta, size) =>
      Math.min(Math.max(Math.floor(value) + 0.5 + delta * step, 0.5), size - 0.5);
    const [u, v] = start ?? this.#middle ?? this.#fittedArea().middle;
    const pixel = [snap(u, du, bitmap.width), snap(v, dv, bitmap.height)];
    this.#context.setCursor(start ? pixel : [u, v], true);
  }

  #aim(pixel) {
    const direction = pixel && directionFromPixel(this.#context, pixel);
    if (direction) this.#context.setWindow(aimFromDirection(direction));
  }

  #onKey(event) {
    if (event.ctrlKey || event.metaKey) return;
    const { cursor } = this.#context;
    const arrow = ARROWS[event.key];
    if (arrow && event.altKey) this.#pan(-40 * arrow[0], -40 * arrow[1]);
    else if (arrow) this.#moveCursor(arrow, event.shiftKey ? 10 : 1);
    else if (event.key === "+" || event.key === "=") this.#zoomAboutMiddle(ZOOM_STEP);
    else if (event.key === "-") this.#zoomAboutMiddle(1 / ZOOM_STEP);
    else if (event.key === "0") this.#fit();
    else if (event.key === "Enter") this.#context.setCursor(cursor.pixel, !cursor.isHeld);
    else if (event.key === "Escape") this.#context.setCursor(null);
    else if (event.key === "l" || event.key === "L") this.#aim(cursor.pixel);
    else return;
    event.preventDefault();
    // Driving keys are the page's; here they move the cursor.
    event.stopPropagation();
  }
}
