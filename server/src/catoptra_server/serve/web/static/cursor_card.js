/** What the camera sees under the cursor of any view: a card beside it on the picture. */

import { isShown, make, onShown, setText } from "./panel.js";
import { degrees } from "./scan_geometry.js";
import { rotate } from "./transforms.js";
import { aimFromDirection, directionFromAngles } from "./views/directions.js";

const INTERVAL_MS = 100;
const ROWS = ["object", "range", "azimuth", "elevation", "incidence angle", "pixel", "error bound"];
const OUTSIDE = "outside the image of the camera";
const OFFSET_PX = 16;

/** The card of a view. */
export class CursorCard {
  #section;
  #context;
  #values = new Map();
  #hint = make("p", { className: "quiet" });
  #isPending = false;
  #askedAt_ms = 0;
  #askedFor = "";

  constructor(section, context) {
    this.#section = section;
    this.#context = context;
    const list = make("dl", { className: "values" });
    for (const name of ROWS) {
      const value = make("dd", {}, "\u2013");
      this.#values.set(name, value);
      list.append(make("dt", {}, name), value);
    }
    this.node = make("div", { className: "card", id: "cursor-card", hidden: true }, list, this.#hint);
    context.on("cursor", () => this.#update());
    context.on("table", () => this.#update());
    // The robot moves below a cursor that rests.
    context.on("state", () => this.ask());
    onShown(section, () => this.#update());
  }

  /** Place the card beside a position of the cursor in a view of a size, in CSS pixels. */
  place([x, y], { width, height }) {
    const { style } = this.node;
    const [toLeft, toTop] = [x > 0.5 * width, y > 0.5 * height];
    style.left = toLeft ? "" : `${x + OFFSET_PX}px`;
    style.right = toLeft ? `${width - x + OFFSET_PX}px` : "";
    style.top = toTop ? "" : `${y + OFFSET_PX}px`;
    style.bottom = toTop ? `${height - y + OFFSET_PX}px` : "";
  }

  /** Show at once what the table knows, then ask for the rest. */
  #update() {
    if (!isShown(this.#section)) return;
    const { cursor, table } = this.#context;
    const { pixel } = cursor;
    this.node.hidden = pixel === null;
    if (pixel === null) return;
    this.#set("pixel", `${pixel[0].toFixed(1)}, ${pixel[1].toFixed(1)}`);
    const angles = table ? table.anglesFromPixel(pixel) : null;
    const isOutside = Boolean(table && !angles);
    this.#showAngles(angles && { ...angles, direction: directionFromAngles(angles) }, isOutside);
    if (isOutside) this.#showReply(null);
    const { isHeld } = cursor;
    setText(this.#hint, isHeld ? "Held: Escape or Enter releases it." : "Click or Enter holds it.");
    this.ask();
  }

  /** Ask for range, object and bound: one request pending, ten a second at most. */
  async ask() {
    const { cursor, pictures, selected, state, table } = this.#context;
    if (!cursor.pixel || this.#isPending || !pictures.isOpen || !isShown(this.#section)) return;
    const [u_px, v_px] = cursor.pixel;
    const key = JSON.stringify([selected, u_px, v_px, state?.reply.time_s]);
    if (key === this.#askedFor) return;
    const pause_ms = this.#askedAt_ms + INTERVAL_MS - performance.now();
    this.#isPending = true;
    try {
      if (pause_ms > 0) await new Promise((resolve) => setTimeout(resolve, pause_ms));
      this.#askedAt_ms = performance.now();
      this.#askedFor = key;
      // The server counts columns in the camera's own hand.
      const own_px = table?.isTurned ? table.width_px - u_px : u_px;
      const request = { kind: "get_pixel", ...selected, u_px: own_px, v_px };
      const reply = await pictures.request(request);
      // The cursor may be gone; if it has moved, this is nearer than what is shown.
      if (this.#context.cursor.pixel) this.#showReply(reply);
    } catch (error) {
      this.#set("object", error.message);
    } finally {
      this.#isPending = false;
    }
    this.ask();
  }

  #showReply(reply) {
    const { table, cursor } = this.#context;
    const isOutside = reply !== null && reply.theta_rad === null;
    // A camera without a table: the server knows its model.
    if (reply !== null && !table && cursor.pixel) {
      // An ordinary camera looks along x, and its azimuth is about that axis.
      const [right, down, ahead] = isOutside ? [] : directionFromAngles(reply);
      const angles = { theta_rad: reply.theta_rad, direction: [ahead, right, down] };
      this.#showAngles(isOutside ? null : angles, isOutside);
    }
    const isSeen = reply !== null && !isOutside;
    const range = isSeen && reply.range_m !== null ? `${reply.range_m.toFixed(3)} m` : null;
    this.#set("range", range ?? (isSeen ? "none: it meets nothing" : null));
    this.#set("object", isSeen ? reply.object : null);
    const hasBound = isSeen && reply.bound_px !== null;
    this.#set("error bound", hasBound ? `${reply.bound_px.toPrecision(3)} px` : null);
  }

  /** Incidence angle from the optical axis; azimuth and elevation in the axes of the robot. */
  #showAngles(angles, isOutside) {
    const theta = angles ? degrees(angles.theta_rad, 2) : null;
    this.#set("incidence angle", isOutside ? OUTSIDE : theta);
    const aim = angles && aimFromDirection(rotate(this.#context.mount, angles.direction));
    this.#set("azimuth", aim && degrees(aim.yaw_rad, 2));
    this.#set("elevation", aim && degrees(aim.pitch_rad, 2));
  }

  #set(name, text) {
    setText(this.#values.get(name), text || "\u2013");
  }
}
