/**
 * Accuracy in detail: the plan of the picture, its milliseconds by stage, its bound by part, the
 * plans next to it; a tolerance or a budget from which the server plans, samples, renderer.
 */

import { BarList, format, LogScale } from "../bars.js";
import { bodyOf, drawOnDemand, make, makeButton, makeSelect, setText } from "../panel.js";
import { durationOf } from "./status.js";

const INTERVAL_MS = 250;
const TOLERANCE_PX = new LogScale(0.05, 20);
const BUDGET_MS = new LogScale(1, 500);
const SLIDER_STEPS = 200;
const SAMPLES = ["", 1, 2, 3, 4];
/** Parts of the bound by key of `error_bounds`. */
const PARTS = {
  polygons_px: "flat polygons",
  rim_px: "straight rim",
  faces_px: "texels of faces",
  corners_px: "rasterizer's grid",
  rounding_px: "rounding",
  scene_px: "coordinates",
  edge_px: "sampling of edges",
};
const BOUND_PX = new LogScale(1e-5, 20);
/** What a target takes the place of. */
const NO_NUMBERS = { polygons: null, samples: null };

/** Create the panel. */
export function create(section, context) {
  const panel = new AccuracyPanel(section, context);
  const draw = drawOnDemand(section, () => panel.update());
  for (const event of ["frame", "selection", "variant"]) context.on(event, draw);
}

class AccuracyPanel {
  #context;
  #drawn_ms = -INTERVAL_MS;
  #stages = new BarList("Milliseconds by stage");
  #parts = new BarList("Error bound and its parts");
  #plan = make("p", { className: "plan" });
  #alternatives = make("div", { className: "alternatives" });
  #hint = make("p", { className: "quiet" });
  #contents;
  #tolerance;
  #budget;
  #samples;
  #renderer;

  constructor(section, context) {
    this.#context = context;
    const set = (changes) => context.setVariant(changes);
    const target = () =>
      set({ ...NO_NUMBERS, max_error_px: this.#tolerance.value, budget_ms: this.#budget.value });
    this.#tolerance = new Slider("Tolerance", TOLERANCE_PX, "px", target);
    this.#budget = new Slider("Budget", BUDGET_MS, "ms", target);
    this.#samples = select("Samples", SAMPLES, (n) => n ? `${n} \u00d7 ${n} per pixel` : "as set");
    const noTarget = { max_error_px: null, budget_ms: null };
    this.#samples.control.addEventListener("change", ({ target: { value } }) =>
      set({ ...noTarget, samples: Number(value) || null }),
    );
    const renderers = ["", ...context.server.renderers];
    this.#renderer = select("Renderer", renderers, (name) => name || "of the camera");
    this.#renderer.control.addEventListener("change", ({ target: { value } }) =>
      set({ renderer: value || null }),
    );
    const rows = [this.#tolerance, this.#budget, this.#samples, this.#renderer];
    this.#contents = make(
      "div",
      { hidden: true },
      make("div", { className: "sliders" }, ...rows.flatMap(({ nodes }) => nodes)),
      this.#plan,
      this.#alternatives,
      make("h3", {}, "Time"),
      this.#stages.node,
      make("h3", {}, "Bound on the displacement of outlines"),
      this.#parts.node,
    );
    bodyOf(section).append(this.#hint, this.#contents);
    context.on("state", () => this.#updateAvailability());
    this.#updateAvailability();
  }

  /** Show the controls for cameras that have settings. */
  #updateAvailability() {
    const { camera } = this.#context;
    const hasSettings = camera?.kind === "omni";
    this.#contents.hidden = !hasSettings;
    this.#hint.hidden = hasSettings;
    const text = camera
      ? "An ordinary camera: its picture has no such settings."
      : "Waiting for a robot with an omnidirectional camera.";
    setText(this.#hint, text);
  }

  /** Show the numbers of the newest frame, slowly enough to be read. */
  update() {
    this.#updateAvailability();
    const { frame, variant } = this.#context;
    if (frame === null || performance.now() - this.#drawn_ms < INTERVAL_MS) return;
    this.#drawn_ms = performance.now();
    this.#tolerance.set(variant.max_error_px ?? 0);
    this.#budget.set(variant.budget_ms ?? 0);
    this.#samples.control.value = String(variant.samples ?? "");
    this.#renderer.control.value = variant.renderer ?? "";
    const { header } = frame;
    const isMissed = !header.target_met ? "Target not met. " : "";
    setText(this.#plan, `${isMissed}${header.plan ?? "no plan"}`);
    this.#plan.classList.toggle("error", !header.target_met);
    this.#showStages(header);
    this.#showBounds(header);
    this.#showAlternatives(header);
  }

  #showStages(header) {
    const stages = Object.entries(header.stage_ms);
    const [total_ms, { predicted_ms }] = [durationOf(header), header];
    const longest_ms = Math.max(total_ms, predicted_ms ?? 0, 1e-6);
    const bar = (name, ms, isOn) => {
      return { name, fraction: ms / longest_ms, text: `${format(ms)} ms`, isOn };
    };
    const bars = [bar("all stages", total_ms, true)];
    if (predicted_ms !== null) bars.push(bar("predicted", predicted_ms, true));
    this.#stages.show([...bars, ...stages.map(([name, ms]) => bar(name, ms, false))]);
  }

  #showBounds({ error_bound_px, error_bounds }) {
    const bar = (name, px, isOn) => {
      return { name, fraction: BOUND_PX.fractionOf(px), text: `${format(px)} px`, isOn };
    };
    const parts = Object.entries(PARTS).filter(([key]) => Number.isFinite(error_bounds?.[key]));
    const bars = parts.map(([key, name]) => bar(name, error_bounds[key], false));
    if (error_bound_px === null) bars.unshift({ name: "bound", fraction: 0, text: "none" });
    else bars.unshift(bar("bound", error_bound_px, true));
    this.#parts.show(bars);
  }

  #showAlternatives({ more_accurate, faster }) {
    const key = JSON.stringify([more_accurate, faster]);
    if (this.#alternatives.dataset.key === key) return;
    this.#alternatives.dataset.key = key;
    const buttons = [["More accurate", more_accurate], ["Faster", faster]]
      .filter(([, alternative]) => alternative !== null)
      .map(([title, alternative]) => this.#alternativeButton(title, alternative));
    this.#alternatives.replaceChildren(...buttons);
  }

  #alternativeButton(title, { plan, error_bound_px, cost_ms }) {
    const text = `${title}: ${format(error_bound_px)} px, ${format(cost_ms)} ms (${plan})`;
    // The fastest plan within its bound is the plan itself: both lie on the Pareto front.
    const max_error_px = error_bound_px * 1.000001;
    return makeButton(text, () =>
      this.#context.setVariant({ ...NO_NUMBERS, max_error_px, budget_ms: 0 }),
    );
  }
}

/** A labelled list of choices. */
function select(label, values, textOf) {
  const id = `accuracy-${label.toLowerCase().replaceAll(" ", "-")}`;
  const control = makeSelect(values, textOf, { id });
  return { control, nodes: [make("label", { htmlFor: id }, label), control] };
}

/** A slider on a logarithmic scale whose left end is "none", the value 0. */
class Slider {
  #scale;
  #unit;
  #input;
  #output;

  value = 0;

  constructor(label, scale, unit, onChange) {
    this.#scale = scale;
    this.#unit = unit;
    const id = `accuracy-${label.toLowerCase()}`;
    this.#input = make("input", { type: "range", id, min: 0, max: SLIDER_STEPS, step: 1 });
    this.#output = make("output", { htmlFor: id });
    this.nodes = [make("label", { htmlFor: id }, label), this.#input, this.#output];
    this.#input.addEventListener("input", () => {
      const step = Number(this.#input.value);
      this.value = step === 0 ? 0 : scale.valueAt((step - 1) / (SLIDER_STEPS - 1));
      this.#showValue();
      onChange();
    });
    this.#showValue();
  }

  /** Set a value, also between the steps. */
  set(value) {
    this.value = value;
    const step = value === 0 ? 0 : 1 + this.#scale.fractionOf(value) * (SLIDER_STEPS - 1);
    this.#input.value = String(Math.round(step));
    this.#showValue();
  }

  #showValue() {
    const text = this.value === 0 ? "none" : `${format(this.value)} ${this.#unit}`;
    this.#output.textContent = text;
    this.#input.setAttribute("aria-valuetext", text);
  }
}
