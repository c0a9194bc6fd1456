/**
 * What accuracy costs: the picture of a tolerance, of a budget, or of explicit numbers, its
 * difference from the exact one, its milliseconds, its bound, and the plans next to it.
 */

import { BarList, format, LogScale } from "../bars.js";
import { Comparison } from "../comparison.js";
import { bodyOf, make, makeButton, makeSelect, setText } from "../panel.js";
import { VariantPull } from "../variant_pull.js";

const TOLERANCE_PX = new LogScale(0.05, 20);
const BUDGET_MS = new LogScale(1, 500);
const SLIDER_STEPS = 200;
const SAMPLES = [1, 2, 3, 4];
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

/** Create the panel. */
export function create(section, context) {
  const panel = new AccuracyPanel(section, context);
  context.on("selection", () => panel.updateAvailability());
  context.on("state", () => panel.updateAvailability());
}

class AccuracyPanel {
  #context;
  #pull;
  #controls;
  #comparison = new Comparison("With these settings");
  #stages = new BarList("Milliseconds by stage");
  #parts = new BarList("Error bound and its parts");
  #plan = make("p", { className: "plan" });
  #status = make("p", { className: "quiet", role: "status" });
  #alternatives = make("div", { className: "alternatives" });
  #contents;

  constructor(section, context) {
    this.#context = context;
    this.#controls = new Controls(context.server, () => this.#pull.refresh());
    this.#contents = make(
      "div",
      { hidden: true },
      this.#controls.node,
      this.#status,
      this.#plan,
      this.#alternatives,
      this.#comparison.node,
      make("h3", {}, "Time"),
      this.#stages.node,
      make("h3", {}, "Bound on the displacement of outlines"),
      this.#parts.node,
    );
    this.hint = make("p", { className: "quiet" });
    bodyOf(section).append(this.hint, this.#contents);
    this.#pull = new VariantPull(section, context, {
      variant: () => this.#controls.variant,
      show: (header, bitmap) => this.#show(header, bitmap),
      fail: (error) => this.#setStatus(error.message, true),
      setBusy: (isBusy) => this.#setBusy(isBusy),
    });
    this.updateAvailability();
  }

  /** Show the controls for cameras that have settings. */
  updateAvailability() {
    const { camera } = this.#context;
    const hasSettings = camera?.kind === "omni";
    this.#controls.hasMesh = camera?.has_mesh;
    if (this.#contents.hidden === !hasSettings && this.hint.hidden === hasSettings) return;
    this.#contents.hidden = !hasSettings;
    this.hint.hidden = hasSettings;
    this.hint.textContent = camera
      ? "An ordinary camera: its picture has no such settings."
      : "Waiting for a robot with an omnidirectional camera.";
  }

  #setBusy(isBusy) {
    if (!isBusy) {
      if (!this.#status.classList.contains("error")) this.#setStatus("");
    } else if (this.#controls.hasTarget) {
      const text = "The server renders; a first target takes seconds, in which it measures costs.";
      this.#setStatus(text);
    } else {
      this.#setStatus("The server renders.");
    }
  }

  #setStatus(text, isError = false) {
    this.#status.classList.toggle("error", isError);
    setText(this.#status, text);
  }

  async #show(header, bitmap) {
    this.#setStatus("");
    const isMissed = !header.target_met ? "Target not met. " : "";
    const plan = `${isMissed}${header.plan ?? "no plan"}`;
    setText(this.#plan, plan);
    this.#plan.classList.toggle("error", !header.target_met);
    this.#showStages(header);
    this.#showBounds(header);
    this.#showAlternatives(header);
    if (header.difference) await this.#comparison.show(header, bitmap);
  }

  #showStages({ stage_ms, predicted_ms }) {
    const stages = Object.entries(stage_ms);
    const total_ms = stages.reduce((sum, [, ms]) => sum + ms, 0);
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
    return makeButton(text, () => this.#controls.setTolerance(error_bound_px * 1.000001));
  }
}

/** Sliders and lists; `variant` is what they select. */
class Controls {
  #onChange;
  #hasMesh = true;
  #mode;
  #tolerance;
  #budget;
  #polygons;
  #samples;
  #renderer;
  #targetRows;
  #numberRows;

  constructor({ polygons, renderers }, onChange) {
    this.#onChange = onChange;
    // First what the server can render at once: a target takes seconds of measuring.
    const modes = { numbers: "polygons and samples", target: "tolerance and budget" };
    this.#mode = select("Settings by", Object.keys(modes), (mode) => modes[mode]);
    this.#tolerance = new Slider("Tolerance", TOLERANCE_PX, "px", 0.5, onChange);
    this.#budget = new Slider("Budget", BUDGET_MS, "ms", 0, onChange);
    const surfaceText = (n) => (n === 0 ? "exact surface" : `${n} polygons`);
    this.#polygons = select("Mirror", [...polygons, 0], surfaceText);
    this.#polygons.control.value = String(polygons.at(-2) ?? 0);
    this.#samples = select("Samples", SAMPLES, (n) => `${n} \u00d7 ${n} per pixel`);
    this.#samples.control.value = "2";
    this.#renderer = select("Renderer", ["", ...renderers], (name) => name || "of the camera");
    this.#targetRows = [...this.#tolerance.nodes, ...this.#budget.nodes];
    this.#numberRows = [...this.#polygons.nodes, ...this.#samples.nodes];
    const rows = [...this.#targetRows, ...this.#numberRows, ...this.#renderer.nodes];
    this.node = make("div", { className: "sliders" }, ...this.#mode.nodes, ...rows);
    for (const { control } of [this.#polygons, this.#samples, this.#renderer]) {
      control.addEventListener("change", onChange);
    }
    this.#mode.control.addEventListener("change", () => this.#changeMode());
    this.#showRows();
  }

  /** A lens or a mirror without a viewpoint has no mesh of polygons to choose. */
  set hasMesh(hasMesh) {
    this.#hasMesh = hasMesh;
    this.#showRows();
  }

  get hasTarget() {
    return this.#mode.control.value === "target";
  }

  /** FrameVariant of the present settings. */
  get variant() {
    const renderer = this.#renderer.control.value || null;
    const target = { max_error_px: this.#tolerance.value, budget_ms: this.#budget.value };
    const numbers = {
      polygons: this.#hasMesh ? Number(this.#polygons.control.value) : 0,
      samples: Number(this.#samples.control.value),
    };
    return { ...(this.hasTarget ? target : numbers), renderer, reference: "exact" };
  }

  /** Set a tolerance without a budget. */
  setTolerance(max_error_px) {
    this.#mode.control.value = "target";
    this.#tolerance.set(max_error_px);
    this.#budget.set(0);
    this.#changeMode();
  }

  #changeMode() {
    this.#showRows();
    this.#onChange();
  }

  #showRows() {
    for (const node of this.#targetRows) node.hidden = !this.hasTarget;
    for (const node of this.#numberRows) node.hidden = this.hasTarget;
    for (const node of this.#polygons.nodes) node.hidden ||= !this.#hasMesh;
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

  constructor(label, scale, unit, value, onChange) {
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
    this.set(value);
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
