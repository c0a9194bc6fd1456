/**
 * What accuracy costs: a slider from the exact mirror to few polygons. All pictures of the page
 * follow it, with their bound and their milliseconds; "Show the error" lays the difference from a
 * reference over the picture.
 */

import { format } from "../bars.js";
import { Difference } from "../difference.js";
import { bodyOf, make, makeButton, setText, showOnDemand, toolsOf } from "../panel.js";
import { VariantPull } from "../variant_pull.js";
import { durationOf } from "./status.js";

/** Create the panel. */
export function create(section, context) {
  new CostPanel(section, context);
}

class CostPanel {
  #context;
  #pull;
  #difference = new Difference();
  #slider = make("input", { type: "range", min: 0, step: 1, value: 0, id: "cost-slider" });
  #text = make("output", { htmlFor: "cost-slider" });
  #error = makeButton("Show the error", () => this.#toggle(), { ariaPressed: "false" });
  #reset;
  #showsError = false;

  constructor(section, context) {
    this.#context = context;
    this.#slider.ariaLabel = "Accuracy, from exact to coarse";
    this.#slider.addEventListener("input", () => this.#choose());
    this.#reset = makeButton("Reset", () => this.#resetAll());
    bodyOf(section).append(
      make("span", { className: "quiet" }, "exact"),
      this.#slider,
      make("span", { className: "quiet" }, "coarse"),
      this.#error,
      this.#reset,
    );
    toolsOf(section).append(this.#text);
    bodyOf(document.getElementById("panel-omni")).append(this.#difference.node);
    this.#pull = new VariantPull(section, context, {
      variant: () => this.#referred,
      show: (header, bitmap) => this.#difference.show(header, bitmap),
      fail: (error) => context.report(error),
    });
    const show = showOnDemand(section, () => this.#show());
    for (const event of ["frame", "selection", "state"]) context.on(event, show);
    context.on("variant", () => {
      this.#show();
      this.#pull.refresh();
    });
    context.on("selection", () => this.#hideError());
    this.#show();
  }

  /** What the slider sets, exact first: polygons of the mirror's mesh, or samples of a pixel. */
  get #scale() {
    const { camera, server } = this.#context;
    if (camera?.kind !== "omni") return { key: "", values: [] };
    if (!camera.has_mesh) return { key: "samples", values: [4, 3, 2, 1] };
    return { key: "polygons", values: [0, ...server.polygons.filter(Boolean).reverse()] };
  }

  #choose() {
    const { key, values } = this.#scale;
    const value = values[this.#slider.value];
    this.#context.setVariant({ max_error_px: null, budget_ms: null, [key]: value });
  }

  /** Of the picture with its settings: from the exact one, or of effects alone from the camera's. */
  get #referred() {
    if (!this.#showsError) return null;
    const { variant } = this.#context;
    const isEffect = Object.keys(variant).every((key) => ["effects", "picture"].includes(key));
    return { ...variant, reference: variant.effects && isEffect ? "camera" : "exact" };
  }

  #toggle() {
    if (this.#showsError) return this.#hideError();
    this.#showsError = true;
    this.#error.ariaPressed = "true";
    this.#pull.refresh();
  }

  #hideError() {
    this.#showsError = false;
    this.#error.ariaPressed = "false";
    this.#difference.clear();
  }

  #resetAll() {
    const { variant } = this.#context;
    this.#slider.value = 0;
    this.#context.setVariant(Object.fromEntries(Object.keys(variant).map((key) => [key, null])));
  }

  #show() {
    const { variant, frame } = this.#context;
    const { key, values } = this.#scale;
    const chosen = values.indexOf(variant[key]);
    this.#slider.max = Math.max(values.length - 1, 0);
    if (chosen >= 0) this.#slider.value = chosen;
    for (const control of [this.#slider, this.#error]) control.disabled = values.length === 0;
    this.#reset.disabled = Object.keys(variant).length === 0;
    const name = nameOf(variant);
    const text = frame ? `${name}: ${numbersOf(frame.header)}` : name;
    setText(this.#text, text);
    this.#slider.setAttribute("aria-valuetext", text);
  }
}

function nameOf({ polygons, samples, max_error_px, budget_ms }) {
  if (polygons === 0) return "Exact mirror";
  if (polygons !== undefined) return `${polygons} polygons`;
  if (max_error_px !== undefined || budget_ms !== undefined) return "By target";
  return samples === undefined ? "As the camera is set" : `${samples} \u00d7 ${samples} samples`;
}

function numbersOf(header) {
  const { error_bound_px } = header;
  const bound = error_bound_px === null ? "no bound" : `at most ${format(error_bound_px)} px off`;
  return `${bound}, ${format(durationOf(header))} ms a picture`;
}
