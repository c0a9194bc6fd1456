/** Frames of other settings than those of the camera, for the panels that compare. */

import { decodeFrame } from "./connection.js";
import { isShown, onShown } from "./panel.js";

const INTERVAL_MS = 334;

/**
 * Requests frames of a variant while its panel is shown: three a second at most, one pending.
 *
 * They come over the connection for commands: the other one keeps a frame request of its own.
 */
export class VariantPull {
  #section;
  #context;
  #handlers;
  #isPending = false;
  #isChanged = true;
  #shownTime_s = null;

  /**
   * Pull for a panel by handlers: variant(), null where no frame is wanted; show(header, bitmap);
   * fail(error).
   */
  constructor(section, context, handlers) {
    this.#section = section;
    this.#context = context;
    this.#handlers = handlers;
    onShown(section, () => this.#ask());
    context.on("state", () => this.#ask());
    context.on("selection", () => this.refresh());
  }

  /** Request a frame soon, though no time has passed: a setting has changed. */
  refresh() {
    this.#isChanged = true;
    this.#ask();
  }

  #isWanted() {
    const { commands, selected, camera, frame, state } = this.#context;
    if (!isShown(this.#section) || !commands.isOpen || camera?.kind !== "omni") return false;
    // The camera's own picture first: the server may prepare a variant for a second.
    if (frame === null) return false;
    if (!selected.robot || this.#handlers.variant() === null) return false;
    return this.#isChanged || state?.reply.time_s !== this.#shownTime_s;
  }

  async #ask() {
    if (this.#isPending || !this.#isWanted()) return;
    this.#isPending = true;
    this.#isChanged = false;
    const pause = new Promise((resolve) => setTimeout(resolve, INTERVAL_MS));
    try {
      await this.#request();
    } catch (error) {
      this.#handlers.fail(error);
    }
    await pause;
    this.#isPending = false;
    this.#ask();
  }

  async #request() {
    const { commands, selected } = this.#context;
    const variant = this.#handlers.variant();
    const frame = await commands.requestFrame({ ...selected, encoding: "png", variant });
    const bitmap = await decodeFrame(frame);
    try {
      const isCurrent = selected === this.#context.selected && this.#handlers.variant() !== null;
      this.#shownTime_s = this.#context.state?.reply.time_s ?? null;
      if (isCurrent) await this.#handlers.show(frame.header, bitmap);
    } finally {
      bitmap.close();
    }
  }
}
