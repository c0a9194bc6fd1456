/** The difference of a picture from a reference, as a heat map. */

import { make } from "./panel.js";
import { format } from "./bars.js";
import { resizeCanvas } from "./canvas.js";

// Colours of increasing lightness, which keep their order without colour vision: Matplotlib's
// inferno at equal steps.
const COLOURS = [
  [0, 0, 4], [31, 12, 72], [85, 15, 109], [136, 34, 106], [186, 54, 85], [227, 89, 51],
  [249, 140, 10], [249, 201, 50], [252, 255, 164],
];
const PIXELS_PER_TASK = 200000;
const SMALLEST_SCALE = 8;

/** A heat map that covers the picture of a view, with its scale and its numbers. */
export class Difference {
  #canvas = make("canvas", { width: 1, height: 1, role: "img" });
  #scale = make("canvas", { className: "scale", width: 256, height: 1, ariaHidden: "true" });
  #labels = ["0", "", ""].map((text) => make("span", {}, text));
  #caption = make("p", {});

  constructor() {
    this.#canvas.setAttribute("aria-label", "Difference as a heat map");
    drawScale(this.#scale);
    const labels = make("div", { className: "scale-labels" }, ...this.#labels);
    const legend = make("div", { className: "legend" }, this.#scale, labels, this.#caption);
    this.node = make("div", { className: "difference", hidden: true }, this.#canvas, legend);
  }

  /** Show a frame with a reference: its right half are the differences. */
  async show({ difference }, bitmap) {
    if (!difference) return;
    const top = Math.max(SMALLEST_SCALE, 2 ** Math.ceil(Math.log2(difference.max_levels || 1)));
    this.#labels[1].textContent = String(top / 2);
    this.#labels[2].textContent = `${top} grey levels`;
    this.#caption.textContent =
      `Error: at most ${difference.max_levels}, rms ${format(difference.rms_levels)} grey levels; ` +
      `${format(100 * difference.changed_fraction)} % of the pixels differ from: ` +
      // Its first part; the reasons would fill the picture.
      difference.reference_plan.split(/[:;]/)[0];
    this.#caption.title = difference.reference_plan;
    resizeCanvas(this.#canvas, bitmap.width / 2, bitmap.height);
    await drawHeatMap(this.#canvas, bitmap, top);
    this.node.hidden = false;
  }

  /** Show nothing. */
  clear() {
    this.node.hidden = true;
  }
}

/** Draw the right half of a bitmap in colours, rows at a time: no task is long. */
async function drawHeatMap(canvas, bitmap, top) {
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  const { width, height } = canvas;
  pen.drawImage(bitmap, -width, 0);
  const colours = colourTable(top);
  const rowsPerTask = Math.max(1, Math.floor(PIXELS_PER_TASK / width));
  for (let row = 0; row < height; row += rowsPerTask) {
    if (row > 0) await new Promise((resolve) => setTimeout(resolve));
    const image = pen.getImageData(0, row, width, Math.min(rowsPerTask, height - row));
    const { data } = image;
    for (let i = 0; i < data.length; i += 4) {
      const at = 3 * Math.max(data[i], data[i + 1], data[i + 2]);
      data[i] = colours[at];
      data[i + 1] = colours[at + 1];
      data[i + 2] = colours[at + 2];
    }
    pen.putImageData(image, 0, row);
  }
}

/** Colours of all 256 differences, on a scale that ends at `top`. */
function colourTable(top) {
  const table = new Uint8ClampedArray(3 * 256);
  for (let level = 0; level < 256; level += 1) {
    table.set(colourAt(Math.min(level / top, 1)), 3 * level);
  }
  return table;
}

/** Colour of a fraction from 0 to 1. */
export function colourAt(fraction) {
  const position = fraction * (COLOURS.length - 1);
  const i = Math.min(Math.floor(position), COLOURS.length - 2);
  return COLOURS[i].map((value, k) => value + (position - i) * (COLOURS[i + 1][k] - value));
}

function drawScale(canvas) {
  const pen = canvas.getContext("2d");
  for (let x = 0; x < canvas.width; x += 1) {
    const [red, green, blue] = colourAt(x / (canvas.width - 1));
    pen.fillStyle = `rgb(${red} ${green} ${blue})`;
    pen.fillRect(x, 0, 1, 1);
  }
}
