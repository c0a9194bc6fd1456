/** Plots of chosen numbers over the last seconds, those of one unit in one plot (uPlot). */

import { colour, onColourScheme, onResize } from "../canvas.js";
import { bodyOf, isShown, make, onShown, remember, remembered, shorten } from "../panel.js";
import { SeriesStore } from "../series.js";

const DURATIONS_S = [30, 120];
const MAX_CHOSEN = 6;
const INTERVAL_MS = 200;
const HEIGHT_PX = 150;
const FIRST_CHOICE = ["Left wheels", "Right wheels", "Odometry error position"];

/** Create the panel. */
export function create(section, context) {
  new PlotPanel(section, context);
}

/** Load the plot library when a plot is first seen: the pictures do not wait for it. */
function loadLibrary() {
  document.head.append(make("link", { rel: "stylesheet", href: "/static/vendor/uPlot.min.css" }));
  return new Promise((resolve, reject) => {
    const script = make("script", { src: "/static/vendor/uPlot.iife.min.js" });
    script.addEventListener("load", () => resolve(window.uPlot));
    script.addEventListener("error", () => reject(new Error("the plot library is missing")));
    document.head.append(script);
  });
}

class PlotPanel {
  #section;
  #store = new SeriesStore();
  #chosen = remembered("catoptra.plots.chosen", FIRST_CHOICE).slice(0, MAX_CHOSEN);
  #duration = make("select", { ariaLabel: "Duration" });
  #add = make("select", { ariaLabel: "Add a series" });
  #chips = make("ul", { className: "chips", ariaLabel: "Series shown" });
  #area = make("div", { className: "plots" });
  #plots = [];
  #library = null;
  #listed = "";
  #drawn_ms = 0;

  constructor(section, context) {
    this.#section = section;
    this.#add.append(make("option", { value: "" }, "Add a series\u2026"));
    const option = (seconds) => make("option", { value: String(seconds) }, `last ${seconds} s`);
    this.#duration.append(...DURATIONS_S.map(option));
    this.#duration.value = String(remembered("catoptra.plots.duration", DURATIONS_S[0]));
    this.#duration.addEventListener("change", () => {
      remember("catoptra.plots.duration", Number(this.#duration.value));
      this.#draw();
    });
    this.#add.addEventListener("change", () => this.#choose(this.#add.value));
    const controls = make("div", { className: "controls" }, this.#add, this.#duration, this.#chips);
    bodyOf(section).append(controls, this.#area);
    context.on("state", (state) => this.#update(state));
    onResize(this.#area, () => this.#resize());
    onColourScheme(() => this.#rebuild());
    onShown(section, (shown) => shown && this.#load());
  }

  async #load() {
    if (this.#library) return;
    this.#library = loadLibrary();
    try {
      await this.#library;
      this.#rebuild();
    } catch (error) {
      this.#area.textContent = error.message;
    }
  }

  /** Record always, so that a panel that comes into view shows the last seconds. */
  #update(state) {
    this.#store.add(state);
    const now_ms = performance.now();
    if (!isShown(this.#section) || now_ms - this.#drawn_ms < INTERVAL_MS) return;
    this.#drawn_ms = now_ms;
    this.#list();
    this.#draw();
  }

  #setChosen(chosen) {
    this.#chosen = chosen;
    remember("catoptra.plots.chosen", chosen);
    this.#rebuild();
  }

  #choose(label) {
    if (label && !this.#chosen.includes(label))
      this.#setChosen([...this.#chosen, label].slice(-MAX_CHOSEN));
    this.#add.value = "";
  }

  /** All series by group, made anew when there are other ones, but not under the user's hand. */
  #list() {
    const labels = [...this.#store.series.keys()];
    const signature = labels.join("\n");
    if (signature === this.#listed || document.activeElement === this.#add) return;
    this.#listed = signature;
    const groups = new Map();
    for (const { group, label } of this.#store.series.values())
      groups.set(group, [...(groups.get(group) ?? []), label]);
    this.#add.replaceChildren(
      make("option", { value: "" }, "Add a series\u2026"),
      ...[...groups].map(([group, members]) =>
        make(
          "optgroup",
          { label: shorten(group) },
          ...members.map((label) => make("option", { value: label }, shorten(label, 60))),
        ),
      ),
    );
    this.#rebuild();
  }

  /** The chosen series that exist, by unit; each keeps the colour of its place. */
  #groups() {
    const groups = new Map();
    this.#chosen.forEach((label, place) => {
      const series = this.#store.series.get(label);
      if (!series) return;
      const member = { label, name: `series-${place + 1}` };
      groups.set(series.unit, [...(groups.get(series.unit) ?? []), member]);
    });
    return groups;
  }

  #rebuild() {
    for (const { plot } of this.#plots) plot.destroy();
    this.#plots = [];
    this.#chips.replaceChildren(...this.#chosen.map((label, place) => this.#chip(label, place)));
    if (!window.uPlot || !this.#area.clientWidth) return;
    this.#area.replaceChildren();
    for (const [unit, members] of this.#groups()) {
      const labels = members.map(({ label }) => label);
      const options = plotOptions(this.#area.clientWidth, unit, members, () => this.#timeRange());
      const data = this.#store.window(labels, Number(this.#duration.value));
      this.#plots.push({ labels, plot: new window.uPlot(options, data, this.#area) });
    }
    if (!this.#plots.length) this.#area.textContent = "Choose a series to plot.";
  }

  #chip(label, place) {
    const swatch = make("span", { className: "swatch" });
    swatch.style.background = colour(`series-${place + 1}`);
    const remove = make(
      "button",
      { type: "button", className: "button small", ariaLabel: `Remove ${shorten(label)}` },
      "\u00d7",
    );
    remove.addEventListener("click", () =>
      this.#setChosen(this.#chosen.filter((other) => other !== label)),
    );
    return make("li", { title: label }, swatch, shorten(label, 32), remove);
  }

  /** The whole duration from the start, so that the curves move and do not stretch. */
  #timeRange() {
    const newest_s = Math.max(0, this.#store.newest_s);
    return [newest_s - Number(this.#duration.value), newest_s];
  }

  #draw() {
    const duration_s = Number(this.#duration.value);
    for (const { labels, plot } of this.#plots)
      plot.setData(this.#store.window(labels, duration_s));
  }

  #resize() {
    const width = this.#area.clientWidth;
    if (!width) return;
    for (const { plot } of this.#plots) plot.setSize({ width, height: HEIGHT_PX });
    if (!this.#plots.length) this.#rebuild();
  }
}

/** Limits of an axis: a little beyond the values, and never so close that noise fills it. */
function valueRange(_, low, high) {
  if (low === null || high === null) return [0, 1];
  const margin = Math.max(0.06 * (high - low), 0.01 * Math.abs(high), 0.01);
  return [low - margin, high + margin];
}

function plotOptions(width, unit, members, timeRange) {
  const axis = () => ({
    stroke: colour("muted"),
    font: "11px system-ui, sans-serif",
    labelFont: "11px system-ui, sans-serif",
    grid: { stroke: colour("grid"), width: 1 },
    ticks: { stroke: colour("grid"), width: 1, size: 4 },
  });
  return {
    width,
    height: HEIGHT_PX,
    legend: { show: false },
    // Without dragging to zoom: the next state would undo it.
    cursor: { sync: { key: "catoptra" }, drag: { x: false, y: false }, points: { size: 5 } },
    scales: { x: { time: false, range: timeRange }, y: { range: valueRange } },
    axes: [
      { ...axis(), size: 28, values: (_, times) => times.map((time) => `${time} s`) },
      { ...axis(), size: 52, label: unit, labelSize: 14 },
    ],
    series: [
      {},
      ...members.map(({ label, name }) => ({
        label,
        stroke: colour(name),
        width: 1.5,
        spanGaps: true,
        points: { show: false },
      })),
    ],
  };
}
