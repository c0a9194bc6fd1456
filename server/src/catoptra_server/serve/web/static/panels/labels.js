/** Ground truth of pixels in colours, and its value under the cursor. */

import { colourAt } from "../difference.js";
import { resizeCanvas } from "../canvas.js";
import { bodyOf, isShown, make, makeSelect, onShown, setText } from "../panel.js";

const INTERVAL_MS = 334;
const textOfNumber = (key) => (values, at, objects) => {
  if (key === "class_number" && values[at] === 65535) return "sky";
  const found = objects.find((one) => one[key] === values[at]);
  if (!found) return values[at] ? `number ${values[at]}` : "nothing";
  return `${key === "number" ? found.name : "all"} of class ${found.class_name}`;
};

/** Array, colour and text of each channel; `at` is the index of a pixel's first value. */
const CHANNELS = {
  range: {
    type: Float32Array,
    colour: (values, at) => colourAt(2 / (2 + values[at])),
    text: (values, at) => (values[at] < Infinity ? `${values[at].toFixed(3)} m` : "nothing"),
  },
  normal: {
    type: Float32Array,
    colour: (values, at) => [0, 1, 2].map((k) => 127.5 * (1 + values[at + k])),
    text: (values, at) => [0, 1, 2].map((k) => values[at + k].toFixed(3)).join(", "),
  },
  ids: { type: Uint16Array, colour: colourOfNumber, text: textOfNumber("number") },
  classes: { type: Uint16Array, colour: colourOfNumber, text: textOfNumber("class_number") },
  agreement: {
    type: Uint8Array,
    colour: (values, at) => colourAt(values[at] / 255),
    text: (values, at) => `${Math.round(values[at] / 2.55)} % of the samples`,
  },
};

/** Colours of neighbouring numbers are far apart; nothing is black. */
function colourOfNumber(values, at) {
  const mixed = Math.imul(values[at], 0x9e3779b1);
  return [24, 16, 8].map((shift) => (values[at] ? 55 + (((mixed >>> shift) & 255) * 200) / 255 : 0));
}

/** Create the panel. */
export function create(section, context) {
  const panel = new LabelsPanel(section, context);
  for (const event of ["state", "selection"]) context.on(event, () => panel.ask());
  context.on("cursor", () => panel.showValue());
  onShown(section, () => panel.ask());
}

class LabelsPanel {
  #section;
  #context;
  #select = makeSelect(Object.keys(CHANNELS), (name) => name, { id: "labels-channel" });
  #canvas = make("canvas", { width: 1, height: 1, role: "img" });
  #value = make("p", { className: "quiet", role: "status" });
  #isPending = false;
  /** Header and values of the picture that is shown. */
  #shown = null;

  constructor(section, context) {
    this.#section = section;
    this.#context = context;
    this.#select.addEventListener("change", () => this.ask());
    this.#canvas.setAttribute("aria-label", "Ground truth in colours");
    const label = make("label", {}, "Channel ", this.#select);
    const figure = make("figure", { className: "labels" }, this.#canvas);
    bodyOf(section).append(label, figure, this.#value);
  }

  /** Request a frame with the channel: three a second at most, one pending. */
  async ask() {
    const { commands, selected, frame } = this.#context;
    if (this.#isPending || !isShown(this.#section) || !commands.isOpen) return;
    if (!selected.robot || !selected.camera || frame === null) return;
    this.#isPending = true;
    const name = this.#select.value;
    const pause = new Promise((resolve) => setTimeout(resolve, INTERVAL_MS));
    try {
      // Names of objects come with their numbers.
      const channels = name === "classes" ? ["classes", "ids"] : [name];
      const { picture } = this.#context.variant;
      const variant = picture ? { picture } : null;
      const reply = await commands.requestFrame({ ...selected, encoding: "jpeg", channels, variant });
      if (selected === this.#context.selected) this.#show(name, reply);
    } catch (error) {
      setText(this.#value, error.message);
    }
    await pause;
    this.#isPending = false;
    if (name !== this.#select.value) this.ask();
  }

  #show(name, { header, bytes }) {
    const { channels } = header.labels;
    const index = channels.findIndex((channel) => channel.name === name);
    const { depth, num_bytes } = channels[index];
    const rest = channels.slice(index).reduce((sum, channel) => sum + channel.num_bytes, 0);
    const begin = bytes.length - rest;
    // A copy: values of four bytes begin at multiples of four.
    const values = new CHANNELS[name].type(bytes.slice(begin, begin + num_bytes).buffer);
    this.#shown = { name, header, values, depth };
    const { width_px, height_px } = header;
    resizeCanvas(this.#canvas, width_px, height_px);
    const image = new ImageData(width_px, height_px);
    const { colour } = CHANNELS[name];
    for (let pixel = 0; pixel < width_px * height_px; pixel += 1) {
      image.data.set(colour(values, pixel * depth), 4 * pixel);
      image.data[4 * pixel + 3] = 255;
    }
    this.#canvas.getContext("2d").putImageData(image, 0, 0);
    this.showValue();
  }

  /** Write the value under the cursor. */
  showValue() {
    const { pixel } = this.#context.cursor;
    if (!this.#shown || !isShown(this.#section)) return;
    const { name, header, values, depth } = this.#shown;
    const [column, row] = pixel ? pixel.map(Math.floor) : [-1, -1];
    const isInside =
      column >= 0 && row >= 0 && column < header.width_px && row < header.height_px;
    const at = depth * (row * header.width_px + column);
    const text = isInside ? CHANNELS[name].text(values, at, header.labels.objects) : "no cursor";
    setText(this.#value, `Under the cursor: ${text}`);
  }
}
