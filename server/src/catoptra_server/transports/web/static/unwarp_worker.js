/** Worker that unwarps: receives frames, tables and requests of unwarper.js. */

import { UnwarpRenderer } from "./unwarp_renderer.js";

let renderer = null;

/** Tell the page that views can be drawn, at the start and after a lost context. */
function announce() {
  postMessage({ kind: "running", renderer: renderer.renderer });
}

/** Result of a request; nulls while there is no context. */
function perform({ kind, view }) {
  if (!renderer?.isReady) return { bitmap: null, pixels: null };
  if (kind === "draw") return { bitmap: renderer.draw(view) };
  return { pixels: renderer.read(view) };
}

addEventListener("message", ({ data }) => {
  if (data.kind === "frame") {
    renderer?.setFrame(data.bitmap);
  } else if (data.kind === "table") {
    renderer?.setTable(data.table);
  } else if (data.kind === "lose") {
    renderer?.loseContext();
  } else {
    const result = perform(data);
    const transferred = [result.bitmap, result.pixels?.buffer].filter(Boolean);
    postMessage({ kind: "reply", id: data.id, ...result }, transferred);
  }
});

try {
  renderer = new UnwarpRenderer(announce);
  announce();
} catch (error) {
  postMessage({ kind: "failed", reason: error.message });
}
