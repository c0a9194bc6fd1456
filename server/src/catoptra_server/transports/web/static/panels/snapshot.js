/** Files of what is seen: the picture without loss, and its panorama. */

import { bodyOf, make } from "../panel.js";

/** Create the panel. */
export function create(section, context) {
  const message = make("p", { className: "quiet", role: "status" });
  const button = (text, save) => {
    const element = make("button", { type: "button", className: "button" }, text);
    element.addEventListener("click", async () => {
      element.disabled = true;
      message.className = "quiet";
      message.textContent = "Requesting the picture\u2026";
      try {
        message.textContent = `Saved ${await save(context)}`;
      } catch (error) {
        message.className = "error";
        message.textContent = `No file: ${error.message}`;
      }
      element.disabled = false;
    });
    return element;
  };
  bodyOf(section).append(
    make(
      "div",
      { className: "controls" },
      button("Save picture (PNG)", savePicture),
      button("Save panorama (PNG)", savePanorama),
    ),
    message,
  );
}

/** The newest frame as PNG; on the connection of commands, so that the feed goes on. */
async function requestPng({ commands, selected }) {
  const { robot, camera } = selected;
  const frame = await commands.requestFrame({ robot, camera, encoding: "png" });
  return { ...frame, blob: new Blob([frame.bytes], { type: "image/png" }) };
}

async function savePicture(context) {
  const { header, blob } = await requestPng(context);
  return download(blob, fileName(header, ""));
}

async function savePanorama(context) {
  if (!context.panoramaPng) throw new Error("this camera has no panorama");
  const { header, blob } = await requestPng(context);
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none" });
  try {
    return download(await context.panoramaPng(bitmap, header), fileName(header, "_panorama"));
  } finally {
    bitmap.close();
  }
}

/** Names are the choice of clients: of their characters only those of file names remain. */
function fileName({ robot, camera, time_s }, suffix) {
  const clean = (text) => text.replace(/[^\w-]+/g, "-").slice(0, 60) || "image";
  return `${clean(robot)}_${clean(camera)}_${time_s.toFixed(3)}${suffix}.png`;
}

function download(blob, name) {
  const url = URL.createObjectURL(blob);
  make("a", { href: url, download: name }).click();
  // The browser reads the blob after the click; a minute is ample for a picture.
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
  return name;
}
