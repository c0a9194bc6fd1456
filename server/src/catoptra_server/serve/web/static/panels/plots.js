/** Plots of chosen numbers over the last seconds, those of one unit in one plot. */

import { colour, onColourScheme, onResize } from "../canvas.js";
import {
  bodyOf,
  drawOnDemand,
  make,
  makeButton,
  remember,
  remembered,
  setText,
  shorten,
} from "../panel.js";
import { SeriesStore } from "../series.js";
import { TimePlot } from "../time_plot.js";

const DURATION_S = 60;
const MAX_CHOSEN = 6;
const FIRST_CHOICE = ["Left wheels", "Right wheels", "Odometry error position"];

/** Create the panel. */
export function create(section, context) {
  new PlotPanel(section, context);
}

class PlotPanel {
  #store = new SeriesStore();
  #chosen = remembered("catoptra.plots.chosen", FIRST_CHOICE).slice(0, MAX_CHOSEN);
  #add = make("select", { ariaLabel: "Add a series" });
  #chips = make("ul", { className: "chips", ariaLabel: "Series shown" });
  #area = make("div", { className: "plots" });
  #values = new Map();
  #plots = [];
  #listed = "";
  #cursor_s = null;
  #redraw;

  constructor(section, context) {
    this.#add.append(make("option", { value: "" }, "Add a series\u2026"));
    this.#add.addEventListener("change", () => this.#choose(this.#add.value));
    const controls = make("div", { className: "controls" }, this.#add, this.#chips);
    bodyOf(section).append(controls, this.#area);
    this.#redraw = drawOnDemand(section, () => this.#draw());
    // Recorded always, so that a panel that comes into view shows the last seconds.
    context.on("state", (state) => {
      this.#store.add(state);
      this.#redraw();
    });
    onResize(this.#area, this.#redraw);
    onColourScheme(() => {
      this.#build();
      this.#redraw();
    });
    this.#build();
  }

  #choose(label) {
    this.#add.value = "";
    if (label && !this.#chosen.includes(label))
      this.#setChosen([...this.#chosen, label].slice(-MAX_CHOSEN));
  }

  #setChosen(chosen) {
    this.#chosen = chosen;
    remember("catoptra.plots.chosen", chosen);
    this.#build();
    this.#redraw();
  }

  /** All series by group, made anew when there are other ones, but not under the user's hand. */
  #list() {
    const signature = [...this.#store.series.keys()].join("\n");
    if (signature === this.#listed || document.activeElement === this.#add) return;
    this.#listed = signature;
    const groups = Map.groupBy(this.#store.series.values(), ({ group }) => group);
    const option = ({ label }) => make("option", { value: label }, shorten(label, 60));
    this.#add.replaceChildren(
      make("option", { value: "" }, "Add a series\u2026"),
      ...[...groups].map(([group, series]) =>
        make("optgroup", { label: shorten(group) }, ...series.map(option)),
      ),
    );
    this.#build();
  }

  /** A plot for each unit; each series keeps the colour of its place. */
  #build() {
    this.#chips.replaceChildren(...this.#chosen.map((label, place) => this.#chip(label, place)));
    const known = this.#chosen
      .map((label, place) => ({ ...this.#store.series.get(label), name: `series-${place + 1}` }))
      .filter(({ label }) => label);
    this.#plots = [...Map.groupBy(known, ({ unit }) => unit)].map(([unit, series]) => {
      const labels = series.map(({ label }) => label);
      const names = series.map(({ name }) => name);
      const text = `${labels.map((label) => shorten(label)).join(", ")} over time`;
      return { labels, plot: new TimePlot(unit, names, text, (time_s) => this.#hover(time_s)) };
    });
    this.#area.replaceChildren(...this.#plots.map(({ plot }) => plot.element));
    if (!this.#plots.length)
      this.#area.textContent = "No series is chosen, or none has values yet.";
  }

  #chip(label, place) {
    const swatch = make("span", { className: "swatch" });
    swatch.style.background = colour(`series-${place + 1}`);
    const value = make("output", { className: "value" });
    this.#values.set(label, value);
    const others = () => this.#setChosen(this.#chosen.filter((other) => other !== label));
    const named = { className: "button small", ariaLabel: `Remove ${shorten(label)}` };
    const remove = makeButton("\u00d7", others, named);
    return make("li", { title: label }, swatch, shorten(label, 32), value, remove);
  }

  #hover(time_s) {
    this.#cursor_s = time_s;
    this.#redraw();
  }

  #draw() {
    this.#list();
    const newest_s = Math.max(0, this.#store.newest_s);
    // The whole duration from the start, so that the curves move and do not stretch.
    const range = [newest_s - DURATION_S, newest_s];
    for (const { labels, plot } of this.#plots) {
      const columns = this.#store.window(labels, DURATION_S);
      plot.draw(columns, range, this.#cursor_s);
      this.#showValues(labels, columns);
    }
  }

  /** Values at the cursor, else the newest ones. */
  #showValues(labels, [times, ...lines]) {
    const after = times.findIndex((time_s) => time_s >= (this.#cursor_s ?? Infinity));
    const index = after < 0 ? times.length - 1 : after;
    labels.forEach((label, line) => {
      setText(this.#values.get(label), lines[line][index]?.toPrecision(4) ?? "\u2013");
    });
  }
}
