/**
 * Accuracy in detail: the plan of the picture, its milliseconds by stage, its bound by part; a
 * tolerance or a budget from which the server plans, samples, renderer.
 */

import { BarList, format, LogScale } from "../bars.js";
import { bodyOf, drawOnDemand, make, makeSelect, setText } from "../panel.js";
import { durationOf } from "./status.js";

const INTERVAL_MS = 250;
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
  #hint = make("p", { className: "quiet" });
  #contents;
  #tolerance;
  #budget;
  #samples;
  #renderer;

  constructor(section, context) {
    this.#context = context;
    const set = (changes) => context.setVariant(changes);
    const valueOf = ({ control }) => Number(control.value);
    const target = () =>
      set({
        polygons: null,
        samples: null,
        max_error_px: valueOf(this.#tolerance),
        budget_ms: valueOf(this.#budget),
      });
    this.#tolerance = number("Tolerance, px", target);
    this.#budget = number("Budget, ms", target);
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
    const show = ({ control }, value) => {
      if (control !== document.activeElement) control.value = String(value || "");
    };
    show(this.#tolerance, variant.max_error_px);
    show(this.#budget, variant.budget_ms);
    show(this.#samples, variant.samples);
    show(this.#renderer, variant.renderer);
    const { header } = frame;
    const isMissed = !header.target_met ? "Target not met. " : "";
    setText(this.#plan, `${isMissed}${header.plan ?? "no plan"}`);
    this.#plan.classList.toggle("error", !header.target_met);
    this.#showStages(header);
    this.#showBounds(header);
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
}

/** A labelled list of choices. */
function select(label, values, textOf) {
  const id = `accuracy-${label.toLowerCase().replaceAll(" ", "-")}`;
  const control = makeSelect(values, textOf, { id });
  return { control, nodes: [make("label", { htmlFor: id }, label), control] };
}

/** A labelled number, empty for none. */
function number(label, onChange) {
  const id = `accuracy-${label.split(",")[0].toLowerCase()}`;
  const control = make("input", { type: "number", min: 0, step: "any", id, placeholder: "none" });
  control.addEventListener("change", onChange);
  return { control, nodes: [make("label", { htmlFor: id }, label), control] };
}
