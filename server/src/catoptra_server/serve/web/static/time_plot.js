/** A plot of numbers over time on a canvas: axes, lines with gaps, a cursor. */

import { clearedCanvas, colour } from "./canvas.js";
import { make } from "./panel.js";

const MARGIN = { left: 48, right: 10, top: 8, bottom: 20 };
const TICK_DISTANCE_PX = { x: 90, y: 32 };

/** Distance of ticks: 1, 2 or 5 times a power of ten, at least `smallest`. */
export function tickStep(smallest) {
  const power = 10 ** Math.floor(Math.log10(smallest));
  return power * ([1, 2, 5].find((digit) => digit * power >= smallest) ?? 10);
}

/** Limits a little beyond the values, and never so close that rounding fills the plot. */
function limitsOf(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value === null) continue;
    low = Math.min(low, value);
    high = Math.max(high, value);
  }
  if (low > high) return [0, 1];
  const margin = Math.max(0.06 * (high - low), 0.01 * Math.abs(high), 0.01);
  return [low - margin, high + margin];
}

export class TimePlot {
  /** The canvas, to be put into the page. */
  element;
  #unit;
  #names;
  #range = [0, 1];

  /** `names`: custom property of each line's colour; `onHover(time_s)`: null without a pointer. */
  constructor(unit, names, label, onHover) {
    this.#unit = unit;
    this.#names = names;
    this.element = make("canvas", { className: "plot", role: "img", ariaLabel: label });
    this.element.addEventListener("pointermove", ({ offsetX }) => onHover(this.#timeAt(offsetX)));
    this.element.addEventListener("pointerleave", () => onHover(null));
  }

  /** Draw columns of times and of the values of each line, null for a gap, in a range of times. */
  draw([times, ...lines], range, cursor_s) {
    const { pen, width, height } = clearedCanvas(this.element);
    const limits = limitsOf(lines.flat());
    const box = {
      width: width - MARGIN.left - MARGIN.right,
      height: height - MARGIN.top - MARGIN.bottom,
    };
    const fraction = (value, [low, high]) => (value - low) / (high - low);
    const x = (time_s) => MARGIN.left + fraction(time_s, range) * box.width;
    const y = (value) => height - MARGIN.bottom - fraction(value, limits) * box.height;
    this.#range = range;
    pen.font = "11px system-ui, sans-serif";
    this.#drawTimes(pen, x, range, box, height);
    this.#drawValues(pen, y, limits, box, height);
    lines.forEach((values, index) => {
      pen.strokeStyle = colour(this.#names[index]);
      pen.lineWidth = 1.5;
      drawLine(pen, times.map(x), values, y);
    });
    if (cursor_s !== null) drawRule(pen, "muted", x(cursor_s), MARGIN.top, 0, box.height);
  }

  #timeAt(offset) {
    const width = this.element.clientWidth - MARGIN.left - MARGIN.right;
    const [start, end] = this.#range;
    return start + ((offset - MARGIN.left) / width) * (end - start);
  }

  #drawTimes(pen, x, range, box, height) {
    pen.textAlign = "center";
    pen.textBaseline = "alphabetic";
    for (const [time_s, text] of ticks(range, box.width / TICK_DISTANCE_PX.x)) {
      if (time_s < 0) continue;
      drawRule(pen, "grid", x(time_s), MARGIN.top, 0, box.height);
      pen.fillStyle = colour("muted");
      pen.fillText(`${text} s`, x(time_s), height - 6);
    }
  }

  #drawValues(pen, y, limits, box, height) {
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const [value, text] of ticks(limits, box.height / TICK_DISTANCE_PX.y)) {
      drawRule(pen, "grid", MARGIN.left, y(value), box.width, 0);
      pen.fillStyle = colour("muted");
      pen.fillText(text, MARGIN.left - 6, y(value));
    }
    pen.textBaseline = "alphabetic";
    pen.fillText(this.#unit, MARGIN.left - 6, height - 6);
  }
}

/** Round values within the limits, about as many as given, with their text. */
function ticks([low, high], count) {
  const step = tickStep((high - low) / Math.max(1, count));
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const first = Math.ceil(low / step);
  const number = Math.floor(high / step) - first + 1;
  return Array.from({ length: Math.max(0, number) }, (_, index) => {
    const value = (first + index) * step;
    return [value, value.toFixed(decimals)];
  });
}

function drawRule(pen, name, left, top, right, down) {
  pen.strokeStyle = colour(name);
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(Math.round(left) + 0.5, Math.round(top) + 0.5);
  pen.lineTo(Math.round(left + right) + 0.5, Math.round(top + down) + 0.5);
  pen.stroke();
}

function drawLine(pen, lefts, values, y) {
  let isDown = false;
  pen.beginPath();
  values.forEach((value, index) => {
    if (value !== null && isDown) pen.lineTo(lefts[index], y(value));
    if (value !== null && !isDown) pen.moveTo(lefts[index], y(value));
    isDown = value !== null;
  });
  pen.stroke();
}
