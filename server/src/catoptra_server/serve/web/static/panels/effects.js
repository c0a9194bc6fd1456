/** What the scene calls for: what each image effect changes, its cost, on or left out; forced. */

import { Bar, format, LogScale } from "../bars.js";
import { bodyOf, make, makeButton, setText, showOnDemand, toolsOf } from "../panel.js";

// Changes in units of their thresholds: the mark is the same for all effects.
const RATIO = new LogScale(1e-3, 1e3);
/** Modes in the order of clicks; the first is that of the camera itself. */
const MODES = ["as set", "auto", "always", "never"];
const NO_EFFECTS =
  "This camera has no image effects: the robot p2at_omni_real has those of a real camera.";
const SCALE =
  "Bars: what an effect changes, on a logarithmic scale; marks: what is visible. A button " +
  "forces an effect.";

/** Create the panel. */
export function create(section, context) {
  const panel = new EffectsPanel(section, context);
  context.on("frame", showOnDemand(section, () => panel.update()));
  context.on("variant", () => panel.update());
}

class EffectsPanel {
  #context;
  #rows = new Map();
  #list = make("ul", { className: "effects", hidden: true });
  #hint = make("p", { className: "quiet" }, "Waiting for a picture.");
  #total = make("span", { className: "quiet" });

  constructor(section, context) {
    this.#context = context;
    toolsOf(section).append(this.#total);
    bodyOf(section).append(this.#list, this.#hint);
  }

  /** Show the decisions of the newest frame. */
  update() {
    const { frame, variant } = this.#context;
    if (frame === null) return;
    const { effects } = frame.header;
    this.#list.hidden = effects.length === 0;
    setText(this.#hint, effects.length === 0 ? NO_EFFECTS : SCALE);
    if (effects.length !== this.#rows.size || !effects.every(({ name }) => this.#rows.has(name)))
      this.#build(effects);
    for (const record of effects) {
      this.#rows.get(record.name).show(record, variant.effects?.[record.name] ?? MODES[0]);
    }
    const on = effects.filter(({ enabled }) => enabled).length;
    setText(this.#total, effects.length ? `${on} of ${effects.length} on, by the levels they change` : "");
  }

  #cycle(name) {
    const { effects = {} } = this.#context.variant;
    const mode = MODES[(MODES.indexOf(effects[name] ?? MODES[0]) + 1) % MODES.length];
    const { [name]: _, ...others } = effects;
    const chosen = mode === MODES[0] ? others : { ...others, [name]: mode };
    this.#context.setVariant({ effects: Object.keys(chosen).length ? chosen : null });
  }

  /** Rows of effects, those first that the scene calls for at present. */
  #build(effects) {
    const names = effects.toSorted((a, b) => b.enabled - a.enabled).map(({ name }) => name);
    this.#rows = new Map(names.map((name) => [name, new EffectRow(name, () => this.#cycle(name))]));
    this.#list.replaceChildren(...[...this.#rows.values()].map(({ node }) => node));
  }
}

/** One effect: name, what it changes, bar, milliseconds, decision, mode. */
class EffectRow {
  #name;
  #bar = new Bar(RATIO.fractionOf(1));
  #change = make("span", { className: "quiet" });
  #duration = make("span", { className: "number" });
  #decision = make("span", {});
  #mode;

  constructor(name, onClick) {
    this.#name = wordsOf(name);
    this.#mode = makeButton("", onClick, { className: "button small" });
    const cells = [this.#change, this.#bar.node, this.#duration, this.#decision, this.#mode];
    this.node = make("li", {}, make("h3", {}, this.#name), ...cells);
  }

  /** Show a record of a frame's header, and the mode that is chosen here. */
  show({ enabled, bound, change, basis, threshold, visible_share, reason, duration_ms }, mode) {
    // Without a threshold every effect above 0 counts.
    const value = change ?? bound;
    const ratio = threshold > 0 ? value / threshold : value * RATIO.high;
    this.#bar.set(RATIO.fractionOf(ratio), enabled);
    // Pixels are not counted where the largest change decides.
    const isCounted = visible_share > 0 && visible_share < 1;
    const share = isCounted ? ` in ${format(Number((100 * visible_share).toPrecision(2)))} %` : "";
    const limit = change === null ? "\u2264 " : "";
    setText(this.#change, `${limit}${format(value)} levels${share}`);
    setText(this.#duration, duration_ms === null ? "" : `${duration_ms.toFixed(duration_ms < 1 ? 2 : 1)} ms`);
    setText(this.#decision, enabled ? "on" : "left out");
    this.node.classList.toggle("off", !enabled);
    this.node.title = `${basis}, threshold ${format(threshold)}: ${reason}`;
    setText(this.#mode, mode);
    this.#mode.setAttribute("aria-label", `${this.#name}: ${mode}. Press for the next mode`);
    this.#mode.classList.toggle("primary", mode !== MODES[0]);
  }
}

/** "FixedPattern" as words. */
function wordsOf(name) {
  return name.replace(/(?<=[a-z])(?=[A-Z])/g, " ");
}
