/**
 * What every panel needs of its section: its parts, whether it is shown, when to draw, and elements
 * whose text never becomes markup.
 */

const STORAGE_KEY = "catoptra.panels";
const intersecting = new WeakSet();
const shownHandlers = new WeakMap();

/** Element that holds the contents of a panel. */
export const bodyOf = (section) => section.querySelector(".body");

/** Element beside the title, for a few small controls. */
export const toolsOf = (section) => section.querySelector(".tools");

/** Whether the panel is expanded, whether or not it is scrolled into view. */
export const isOpen = (section) => !section.classList.contains("closed");

/** Whether drawing the panel can be seen: tab visible, panel expanded and scrolled into view. */
export const isShown = (section) =>
  document.visibilityState === "visible" && isOpen(section) && intersecting.has(section);

// A pixel inside: what only touches the border of the window is not seen, but would be drawn.
const observer = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (isIntersecting) intersecting.add(target);
    else intersecting.delete(target);
    notify(target);
  }
}, { rootMargin: "-1px" });

function notify(section) {
  for (const handler of shownHandlers.get(section) ?? []) handler(isShown(section));
}

/** Call `handler(isShown)` whenever the panel may have come into view or gone. */
export function onShown(section, handler) {
  const handlers = shownHandlers.get(section) ?? [];
  shownHandlers.set(section, [...handlers, handler]);
  observer.observe(section);
  document.addEventListener("visibilitychange", () => handler(isShown(section)));
}

/**
 * A function that asks for one call of `draw` in the next animation frame, an interval after the
 * last one, if the panel is shown then; calls in between count once. A panel that comes into view
 * is drawn.
 */
export function drawOnDemand(section, draw, interval = () => 0) {
  let isPending = false;
  let due_ms = 0;
  const run = () => {
    isPending = false;
    due_ms = performance.now() + interval();
    if (isShown(section)) draw();
  };
  const request = () => {
    if (isPending || !isShown(section)) return;
    isPending = true;
    const wait_ms = due_ms - performance.now();
    if (wait_ms > 0) setTimeout(() => requestAnimationFrame(run), wait_ms);
    else requestAnimationFrame(run);
  };
  onShown(section, request);
  return request;
}

/** The same for numbers, slowly enough to be read: each change costs a layout. */
export const showOnDemand = (section, show) => drawOnDemand(section, show, () => 500);

/** A value of an earlier visit, of the same kind as the fallback; private windows have none. */
export function remembered(key, fallback) {
  try {
    const value = JSON.parse(localStorage.getItem(key)) ?? fallback;
    const isAlike = typeof value === typeof fallback;
    return isAlike && Array.isArray(value) === Array.isArray(fallback) ? value : fallback;
  } catch {
    return fallback;
  }
}

/** Keep a value for the next visit, if the browser allows it. */
export function remember(key, value) {
  try {
    localStorage.setItem(key, JSON.stringify(value));
  } catch {
    // The page works without a memory.
  }
}

/** Give a section its title, its tools and its body; the ids are those that index.html names. */
export function furnish(section, title) {
  const name = section.id.replace("panel-", "");
  const body = make("div", { className: "body", id: `body-${name}` });
  const properties = { type: "button", className: "toggle", id: `title-${name}` };
  const toggle = make("button", { ...properties, "aria-controls": body.id }, title);
  const tools = make("div", { className: "tools" });
  section.setAttribute("aria-labelledby", toggle.id);
  section.append(make("header", {}, make("h2", {}, toggle), tools), body);
  setUpToggle(section, toggle);
}

/** Make the panel's title expand and collapse it, from the state of the last visit. */
function setUpToggle(section, toggle) {
  observer.observe(section);
  const apply = (open) => {
    toggle.setAttribute("aria-expanded", String(open));
    section.classList.toggle("closed", !open);
    notify(section);
  };
  apply(remembered(STORAGE_KEY, {})[section.id] !== false);
  toggle.addEventListener("click", () => {
    apply(!isOpen(section));
    remember(STORAGE_KEY, { ...remembered(STORAGE_KEY, {}), [section.id]: isOpen(section) });
  });
}

/**
 * An element with properties and children; text is always text.
 * `make("p", { className: "quiet", hidden: true }, "Waiting.")`
 */
export function make(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in element) element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** A button with a text; small ones by `className: "button small"`. */
export function makeButton(text, onclick, properties = {}) {
  return make("button", { type: "button", className: "button", onclick, ...properties }, text);
}

/** A list of choices by their values, each with its text. */
export function makeSelect(values, textOf, properties = {}) {
  const option = (value) => make("option", { value: String(value) }, textOf(value));
  return make("select", properties, ...values.map(option));
}

/** Set a text that has changed: a screen reader would read each assignment aloud. */
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

/** Choices that hide layers: a set of the hidden ones, kept for the next visit, with check boxes. */
export class LayerChoice {
  #key;
  #hidden;
  #onChange;

  constructor(key, onChange) {
    this.#key = key;
    this.#hidden = new Set(remembered(key, []));
    this.#onChange = onChange;
  }

  shows = (layer) => !this.#hidden.has(layer);

  /** The box of a layer; its class gives the colour. */
  makeBox(layer, label, className, properties = {}) {
    const box = make("input", { type: "checkbox", checked: this.shows(layer) });
    box.addEventListener("change", () => {
      if (box.checked) this.#hidden.delete(layer);
      else this.#hidden.add(layer);
      remember(this.#key, [...this.#hidden].slice(0, 20));
      this.#onChange();
    });
    return make("label", { className: `layer ${className}`, ...properties }, box, label);
  }
}

/** Control characters, and those that reverse the direction of all text behind them. */
const UNSEEN = /[\u0000-\u001f\u007f-\u009f\u200e\u200f\u202a-\u202e\u2066-\u2069]/g;

/** A name from the wire, fit for a list or a label. */
export function shorten(text, length = 40) {
  const start = text.slice(0, length + 1).replace(UNSEEN, "\ufffd");
  return text.length > length ? `${start.slice(0, length - 1)}\u2026` : start;
}
