/** What the scene calls for: each image effect with its bound against its threshold, live. */

import { Bar, format, LogScale } from "../bars.js";
import { Comparison } from "../comparison.js";
import { bodyOf, drawOnDemand, make } from "../panel.js";
import { VariantPull } from "../variant_pull.js";

const INTERVAL_MS = 250;
// Bounds in units of their thresholds: the mark is the same for all effects.
const RATIO = new LogScale(1e-3, 1e3);
/** Modes in the order of clicks; the first is that of the camera itself. */
const MODES = ["as set", "auto", "always", "never"];
const NO_EFFECTS =
  "This camera has no image effects. They are part of a robot's file: start the server with the " +
  "file p2at_omni_real.ini to see those of a real camera.";

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
  #body = make("tbody", {});
  #table;
  #hint = make("p", { className: "quiet" }, "Waiting for a picture.");
  #status = make("p", { className: "quiet", role: "status" });
  #comparison = new Comparison("With the chosen effects");
  #reset;

  constructor(section, context) {
    this.#context = context;
    const titles = ["Effect", "Bound, threshold", "On", "ms", "Mode"];
    const head = titles.map((text) => make("th", { scope: "col" }, text));
    this.#table = make(
      "table",
      { className: "effects", hidden: true },
      make("thead", {}, make("tr", {}, ...head)),
      this.#body,
    );
    const reset = { type: "button", className: "button", hidden: true };
    this.#reset = make("button", reset, "All as set");
    this.#reset.addEventListener("click", () => this.reset());
    bodyOf(section).append(
      this.#hint,
      this.#table,
      this.#reset,
      this.#status,
      this.#comparison.node,
    );
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
    this.#table.hidden = effects.length === 0;
    this.#hint.hidden = effects.length > 0;
    if (effects.length === 0) this.#hint.textContent = NO_EFFECTS;
    const names = effects.map(({ name }) => name);
    if (names.join() !== [...this.#rows.keys()].join()) this.#build(names);
    const forced = new Map((this.#forced ?? []).map((record) => [record.name, record]));
    for (const record of effects) {
      const isForced = this.#modes.has(record.name);
      this.#showRow((isForced && forced.get(record.name)) || record);
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
    this.#changed();
  }

  #changed() {
    this.#forced = null;
    this.#reset.hidden = this.#modes.size === 0;
    for (const [name, row] of this.#rows) {
      const mode = this.#modes.get(name) ?? MODES[0];
      row.mode.textContent = mode;
      row.mode.setAttribute("aria-label", `Mode of ${name}: ${mode}. Press for the next one`);
      row.mode.setAttribute("aria-pressed", String(this.#modes.has(name)));
    }
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
    this.#body.replaceChildren();
    for (const name of names) {
      const row = {
        bar: new Bar(RATIO.fractionOf(1)),
        bound: make("span", {}),
        reason: make("div", { className: "reason" }),
        isOn: make("td", {}),
        duration: make("td", { className: "number" }),
        mode: make("button", { type: "button", className: "button small" }, MODES[0]),
      };
      row.mode.addEventListener("click", () => this.#cycle(name));
      this.#rows.set(name, row);
      this.#body.append(
        make(
          "tr",
          {},
          make("th", { scope: "row" }, wordsOf(name)),
          make("td", {}, row.bound, row.bar.node, row.reason),
          row.isOn,
          row.duration,
          make("td", {}, row.mode),
        ),
      );
    }
    this.#changed();
  }

  #showRow({ name, enabled, bound, threshold, unit, reason, duration_ms }) {
    const row = this.#rows.get(name);
    // Without a threshold every effect above 0 counts.
    const ratio = threshold > 0 ? bound / threshold : bound * RATIO.high;
    row.bar.set(RATIO.fractionOf(ratio), enabled);
    setText(row.bound, `${format(bound)} (${format(threshold)}) ${unit}`);
    setText(row.reason, reason);
    setText(row.isOn, enabled ? "on" : "off");
    setText(row.duration, duration_ms === null ? "\u2013" : format(duration_ms));
  }

  #setStatus(text, isError = false) {
    this.#status.classList.toggle("error", isError);
    setText(this.#status, text);
  }
}

/** "FixedPattern" as words: narrow columns break between them. */
function wordsOf(name) {
  return name.replace(/(?<=[a-z])(?=[A-Z])/g, " ");
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}
