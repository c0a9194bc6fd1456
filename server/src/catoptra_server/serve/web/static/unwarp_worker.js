/** Worker that unwarps: receives frames, tables and requests of unwarper.js. */

import { UnwarpRenderer } from "./unwarp_renderer.js";

const SOFTWARE_RENDERER = /swiftshader|llvmpipe|softpipe|software|basic render/i;

let renderer = null;
let isSoftware = false;
/** Messages are handled in turn, though a frame takes time to decode. */
let last = Promise.resolve();

/** Tell the page that views can be drawn, at the start and after a lost context. */
function announce() {
  isSoftware = SOFTWARE_RENDERER.test(renderer.name);
  postMessage({ kind: "running", isSoftware });
}

/** Result of a request; nulls while there is no context. */
async function perform({ kind, view }) {
  if (!renderer?.isReady) return { bitmap: null, pixels: null };
  // Pixels of a software renderer are in memory: the page would wait for them in a bitmap.
  if (kind === "draw" && !isSoftware) return { bitmap: renderer.draw(view), pixels: null };
  return { bitmap: null, pixels: await renderer.read(view) };
}

async function handle(data) {
  if (data.kind === "frame") {
    renderer?.setFrame(await createImageBitmap(data.source, data.options));
  } else if (data.kind === "table") {
    renderer?.setTable(data.table);
  } else {
    const result = await perform(data);
    const transferred = [result.bitmap, result.pixels?.buffer].filter(Boolean);
    postMessage({ kind: "reply", id: data.id, ...result }, transferred);
  }
}

addEventListener("message", ({ data }) => {
  last = last.then(() => handle(data)).catch((error) => {
    if (data.id) postMessage({ kind: "reply", id: data.id, bitmap: null, pixels: null });
    console.error(error);
  });
});

try {
  renderer = new UnwarpRenderer(announce);
  announce();
} catch (error) {
  postMessage({ kind: "failed", reason: error.message });
}
