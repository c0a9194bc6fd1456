/** Bars and logarithmic scales of the panels about cost and effects. */

import { make, setText } from "./panel.js";

/** A logarithmic scale between two positive values. */
export class LogScale {
  constructor(low, high) {
    this.low = low;
    this.high = high;
  }

  /** Part of the way from low to high, in [0, 1]; 0 for values of 0. */
  fractionOf(value) {
    if (!(value > 0)) return 0;
    const fraction = Math.log(value / this.low) / Math.log(this.high / this.low);
    return Math.min(Math.max(fraction, 0), 1);
  }
}

/** A number with three significant digits, without an exponent where it can be avoided. */
export function format(value) {
  if (value === 0) return "0";
  if (Math.abs(value) < 1e-3) return value.toExponential(1);
  return Math.abs(value) >= 1000 ? value.toFixed(0) : String(Number(value.toPrecision(3)));
}

/** A bar with a filled part and, if there is one, a mark at a threshold; text says its numbers. */
export class Bar {
  #fill = make("div", { className: "fill" });

  constructor(threshold = null) {
    this.node = make("div", { className: "track", ariaHidden: "true" }, this.#fill);
    if (threshold !== null) {
      const mark = make("div", { className: "threshold" });
      mark.style.left = `calc(${100 * threshold}% - 1px)`;
      this.node.append(mark);
    }
  }

  /** Fill a part of the bar, highlighted or not. */
  set(fraction, isOn) {
    const width = `${(100 * fraction).toFixed(1)}%`;
    if (this.#fill.style.width !== width) this.#fill.style.width = width;
    this.#fill.classList.toggle("on", isOn);
  }
}

/** A list of names, bars and texts, whose rows follow the names of the data. */
export class BarList {
  #rows = new Map();

  constructor(label) {
    this.node = make("div", { className: "bars", role: "group", ariaLabel: label });
  }

  /** Show bars {name, fraction, text, isOn}. */
  show(bars) {
    const names = bars.map(({ name }) => name);
    if (names.join() !== [...this.#rows.keys()].join()) this.#build(names);
    for (const { name, fraction, text, isOn = true } of bars) {
      const { bar, value } = this.#rows.get(name);
      bar.set(fraction, isOn);
      setText(value, text);
    }
  }

  #build(names) {
    this.#rows.clear();
    this.node.replaceChildren();
    for (const name of names) {
      const bar = new Bar();
      const value = make("span", { className: "number" });
      this.#rows.set(name, { bar, value });
      this.node.append(make("span", {}, name), bar.node, value);
    }
  }
}
