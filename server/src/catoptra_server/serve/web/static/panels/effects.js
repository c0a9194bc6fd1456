/** What the scene calls for: each image effect with its bound against its threshold, live. */

import { Bar, format, LogScale } from "../bars.js";
import { Comparison } from "../comparison.js";
import { bodyOf, drawOnDemand, make, makeButton, setText } from "../panel.js";
import { VariantPull } from "../variant_pull.js";

const INTERVAL_MS = 250;
// Bounds in units of their thresholds: the mark is the same for all effects.
const RATIO = new LogScale(1e-3, 1e3);
/** Modes in the order of clicks; the first is that of the camera itself. */
const MODES = ["as set", "auto", "always", "never"];
const NO_EFFECTS =
  "This camera has no image effects. They are part of a robot's file: start the server with the " +
  "file p2at_omni_real.ini to see those of a real camera.";
const SCALE =
  "Bars show each effect's bound on a logarithmic scale, the marks its threshold. A mode that is " +
  "chosen here holds for the picture shown below it only.";

/** Create the panel. */
export function create(section, context) {
  const panel = new EffectsPanel(section, context);
  const requestDraw = drawOnDemand(section, () => panel.update());
  context.on("frame", requestDraw);
  context.on("selection", () => panel.reset());
}

class EffectsPanel {
  #context;
  #pull;
  #modes = new Map();
  #rows = new Map();
  #forced = null;
  #drawn_ms = -INTERVAL_MS;
  #list = make("ul", { className: "effects", hidden: true });
  #hint = make("p", { className: "quiet" }, "Waiting for a picture.");
  #status = make("p", { className: "quiet", role: "status" });
  #comparison = new Comparison("With the chosen modes");
  /** Below the effect that was clicked last. */
  #result = make("div", { className: "result" }, this.#status, this.#comparison.node);
  #reset;

  constructor(section, context) {
    this.#context = context;
    this.#reset = makeButton("All as set", () => this.reset(), { hidden: true });
    bodyOf(section).append(this.#hint, this.#reset, this.#list);
    this.#pull = new VariantPull(section, context, {
      variant: () => this.#variant,
      show: (header, bitmap) => this.#showForced(header, bitmap),
      fail: (error) => this.#setStatus(error.message, true),
      setBusy: (isBusy) => this.#setStatus(isBusy ? "The server renders." : ""),
    });
  }

  /** Show the decisions of the newest frame, slowly enough to be read. */
  update() {
    const { frame } = this.#context;
    if (frame === null || performance.now() - this.#drawn_ms < INTERVAL_MS) return;
    this.#drawn_ms = performance.now();
    const { effects } = frame.header;
    this.#list.hidden = effects.length === 0;
    setText(this.#hint, effects.length === 0 ? NO_EFFECTS : SCALE);
    const names = effects.map(({ name }) => name);
    if (names.join() !== [...this.#rows.keys()].join()) this.#build(names);
    const forced = new Map((this.#forced ?? []).map((record) => [record.name, record]));
    for (const record of effects) {
      const isForced = this.#modes.has(record.name);
      this.#rows.get(record.name).show((isForced && forced.get(record.name)) || record);
    }
  }

  /** Leave all effects as the camera has them. */
  reset() {
    this.#modes.clear();
    this.#changed();
  }

  get #variant() {
    if (this.#modes.size === 0) return null;
    return { effects: Object.fromEntries(this.#modes), reference: "camera" };
  }

  #cycle(name) {
    const mode = MODES[(MODES.indexOf(this.#modes.get(name) ?? MODES[0]) + 1) % MODES.length];
    if (mode === MODES[0]) this.#modes.delete(name);
    else this.#modes.set(name, mode);
    this.#rows.get(name).node.append(this.#result);
    this.#changed();
  }

  #changed() {
    this.#forced = null;
    this.#reset.hidden = this.#modes.size === 0;
    for (const [name, row] of this.#rows) row.setMode(this.#modes.get(name) ?? MODES[0]);
    if (this.#modes.size === 0) this.#comparison.clear();
    this.#setStatus("");
    this.#pull.refresh();
  }

  async #showForced(header, bitmap) {
    this.#forced = header.effects;
    this.#setStatus("");
    if (header.difference) await this.#comparison.show(header, bitmap);
  }

  #build(names) {
    this.#rows.clear();
    this.#list.replaceChildren();
    for (const name of names) {
      const row = new EffectRow(name, () => this.#cycle(name));
      this.#rows.set(name, row);
      this.#list.append(row.node);
    }
    this.#changed();
  }

  #setStatus(text, isError = false) {
    this.#status.classList.toggle("error", isError);
    setText(this.#status, text);
  }
}

/** One effect: name, decision, duration, mode; bound against threshold; reason. */
class EffectRow {
  #name;
  #bar = new Bar(RATIO.fractionOf(1));
  #bound = make("span", { className: "number" });
  #reason = make("p", { className: "reason" });
  #decision = make("span", {});
  #mode;

  constructor(name, onClick) {
    this.#name = wordsOf(name);
    this.#mode = makeButton("", onClick, { className: "button small" });
    this.node = make(
      "li",
      {},
      make("h3", {}, this.#name),
      this.#decision,
      this.#mode,
      this.#bar.node,
      this.#bound,
      this.#reason,
    );
  }

  /** Show a record of a frame's header. */
  show({ enabled, bound, change, basis, threshold, visible_share, reason, duration_ms }) {
    // Without a threshold every effect above 0 counts.
    const value = change ?? bound;
    const ratio = threshold > 0 ? value / threshold : value * RATIO.high;
    this.#bar.set(RATIO.fractionOf(ratio), enabled);
    const relation = value > threshold ? ">" : "\u2264";
    // Of an effect that the largest change decides nobody counts the pixels.
    const isCounted = visible_share > 0 && visible_share < 1;
    const share = isCounted ? `, visible in ${format(100 * visible_share)} %` : "";
    setText(this.#bound, `${format(value)} ${relation} ${format(threshold)}${share}, ${basis}`);
    setText(this.#reason, reason);
    const duration = duration_ms === null ? "" : `, ${format(duration_ms)} ms`;
    setText(this.#decision, (enabled ? "on" : "off") + duration);
    this.node.classList.toggle("off", !enabled);
  }

  setMode(mode) {
    setText(this.#mode, mode);
    this.#mode.setAttribute("aria-label", `${this.#name}: ${mode}. Press for the next mode`);
    this.#mode.classList.toggle("primary", mode !== MODES[0]);
  }
}

/** "FixedPattern" as words. */
function wordsOf(name) {
  return name.replace(/(?<=[a-z])(?=[A-Z])/g, " ");
}
