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

/**
 * Fit the canvas to its place, in device pixels, and clear it.
 *
 * @returns {{pen: CanvasRenderingContext2D, width: number, height: number}} in CSS pixels; the pen
 *   draws in these units.
 */
export function clearedCanvas(canvas) {
  const width = Math.max(1, canvas.clientWidth);
  const height = Math.max(1, canvas.clientHeight);
  // Above 2 the cost grows and the eye sees no difference.
  const scale = Math.min(2, window.devicePixelRatio || 1);
  const [columns, rows] = [Math.round(width * scale), Math.round(height * scale)];
  if (canvas.width !== columns || canvas.height !== rows) {
    canvas.width = columns;
    canvas.height = rows;
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}
