/** Files of what is seen: the picture without loss, and its panorama. */

import { chooseCylinder } from "./camera_table.js";
import { make, makeButton } from "./panel.js";
import { robotFromMirror } from "./transforms.js";

const MAX_COLUMNS = 4096;

/** A small button that saves a file by `save(context)`. */
export function makeSaveButton(context, what, save) {
  const title = `Save the ${what} (PNG)`;
  const action = () => save(context).catch((error) => context.report(error));
  return makeButton("\u2913", action, { className: "button small", title, ariaLabel: title });
}

/** The newest frame as PNG; on the connection of commands, so that the feed goes on. */
async function requestPng({ commands, selected, variantRequest }) {
  const frame = await commands.requestFrame({ ...selected, encoding: "png", ...variantRequest });
  return { ...frame, blob: new Blob([frame.bytes], { type: "image/png" }) };
}

export async function savePicture(context) {
  const { header, blob } = await requestPng(context);
  download(blob, fileName(header, ""));
}

/** The panorama of a picture that is rendered for it, not of one that JPEG has changed. */
export async function savePanorama(context) {
  const { unwarper, table } = context;
  if (!table) throw new Error("this camera has no panorama");
  const { header, blob } = await requestPng(context);
  const bitmap = await createImageBitmap(blob, { colorSpaceConversion: "none" });
  const columns = Math.min(MAX_COLUMNS, 2 * header.width_px);
  const cylinder = chooseCylinder(table, columns, robotFromMirror(header));
  const pixels = await unwarper.read(cylinder, bitmap);
  bitmap.close();
  const panorama = await pngOf(new ImageData(pixels, columns, cylinder.rows));
  download(panorama, fileName(header, "_panorama"));
}

function pngOf(image) {
  const canvas = new OffscreenCanvas(image.width, image.height);
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas.convertToBlob({ type: "image/png" });
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
}
