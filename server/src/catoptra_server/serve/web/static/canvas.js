/** Canvases at the resolution of the screen, and the colours of the style sheet for them. */

const darkScheme = matchMedia("(prefers-color-scheme: dark)");
let palette = null;
darkScheme.addEventListener("change", () => (palette = null));

/** Call `handler` when the page changes between light and dark. */
export const onColourScheme = (handler) => darkScheme.addEventListener("change", handler);

/** Colour of a custom property of style.css without its dashes: `colour("accent")`. */
export function colour(name) {
  palette ??= new Map();
  if (!palette.has(name)) {
    const style = getComputedStyle(document.documentElement);
    palette.set(name, style.getPropertyValue(`--${name}`).trim());
  }
  return palette.get(name);
}

/** Call `handler` when the size of the element changes. */
export function onResize(element, handler) {
  new ResizeObserver(handler).observe(element);
}

/** Resize a canvas, which clears it, only where its size changes. */
export function resizeCanvas(canvas, width, height) {
  if (canvas.width !== width) canvas.width = width;
  if (canvas.height !== height) canvas.height = height;
}

/** Device pixels per CSS pixel: above 2 the cost grows and the eye sees no difference. */
export const screenScale = () => Math.min(2, window.devicePixelRatio || 1);

/** Pen in CSS pixels on the cleared canvas, which has the resolution of the screen. */
export function clearedPen(canvas, width, height) {
  const scale = screenScale();
  resizeCanvas(canvas, Math.round(width * scale), Math.round(height * scale));
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  return pen;
}

/** Clear the canvas at the size of its place: {pen, width, height} in CSS pixels. */
export function clearedCanvas(canvas) {
  const [width, height] = [Math.max(1, canvas.clientWidth), Math.max(1, canvas.clientHeight)];
  return { pen: clearedPen(canvas, width, height), width, height };
}
