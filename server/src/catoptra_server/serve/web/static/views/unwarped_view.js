/** What panorama and perspective view share: when they are drawn, their marks, the cursor's keys. */

import { drawLandmarks } from "../landmarks.js";
import { drawOnDemand } from "../panel.js";
import {
  cursorDirection,
  landmarkPlaces,
  reasonForNoUnwarping,
  shownPixel,
} from "./directions.js";
import { cursorGestures } from "./gestures.js";
import { drawCrosshair, ViewCanvases } from "./view_canvases.js";

/** Canvases of a view that the unwarper draws, with marks above. */
export class UnwarpedView {
  #context;
  #view;
  /** The context at the frame that the view shows: a newer one may not be unwarped yet. */
  #drawn;

  /**
   * Fill a section with a view: label, help; drawEvents that change the picture, markEvents;
   * functions: geometry() for the unwarper, drawMarks(pen, context) with the context at the frame
   * that is shown, onKey(event) which returns whether it is a key of the view, and perhaps
   * onDraw(), onResize().
   */
  constructor(section, context, view) {
    this.#context = context;
    this.#view = view;
    const requestDraw = drawOnDemand(section, () => this.draw());
    const requestMarks = drawOnDemand(section, () => this.#drawOverlay());
    const onResize = view.onResize ?? requestDraw;
    this.canvases = new ViewCanvases(section, view.label, view.help, onResize);
    this.canvases.overlay.addEventListener("keydown", (event) => this.#onKey(event));
    const interval = () => context.unwarper.interval_ms;
    context.on("frame", drawOnDemand(section, () => this.draw(), interval));
    // For the reason why nothing is shown.
    context.on("state", () => context.frame ?? requestDraw());
    for (const event of view.drawEvents) context.on(event, requestDraw);
    for (const event of view.markEvents) context.on(event, requestMarks);
  }

  draw() {
    const reason = reasonForNoUnwarping(this.#context);
    this.canvases.setMessage(reason);
    const drawn = Object.create(this.#context, { frame: { value: this.#context.frame } });
    // Together with its picture: marks lie on what they name.
    const onDrawn = () => {
      this.#drawn = drawn;
      this.#drawOverlay();
    };
    if (reason) onDrawn();
    else this.#context.unwarper.draw(this.canvases.picture, this.#view.geometry(), onDrawn);
    this.#view.onDraw?.();
  }

  #drawOverlay() {
    const pen = this.canvases.clear(this.canvases.overlay);
    if (this.#drawn && !reasonForNoUnwarping(this.#context)) this.#view.drawMarks(pen, this.#drawn);
  }

  /** Draw landmarks and cursor; `project` gives the position of a direction, null outside. */
  drawDirections(pen, project) {
    drawLandmarks(pen, landmarkPlaces(this.#drawn, project), this.canvases.width);
    const cursor = cursorDirection(this.#drawn);
    const position = cursor && project(cursor);
    if (position) drawCrosshair(pen, position, this.#context.cursor.isHeld);
  }

  /** Gestures that move the cursor; `direction` of a position, null outside the view. */
  cursorGestures(direction) {
    const place = (position, isHeld) => this.placeCursor(direction(position), isHeld);
    return cursorGestures(this.#context, place);
  }

  /** Place the cursor at a direction; null and directions that the camera does not show remove it. */
  placeCursor(direction, isHeld) {
    if (!this.#context.table) return;
    this.#context.setCursor(direction && shownPixel(this.#context, direction), isHeld);
  }

  #onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Escape") this.#context.setCursor(null);
    else if (!this.#view.onKey(event)) return;
    event.preventDefault();
    // Driving keys are the page's; here they belong to the view.
    event.stopPropagation();
  }
}
