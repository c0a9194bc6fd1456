/**
 * The panels of the page: which there are, and what holds for all of them: creation, collapsing.
 *
 * To add a panel: its section in index.html, its line in PANELS, its module with
 * `create(section, context)`. The module fills `bodyOf(section)` and, for small controls beside
 * the title, `toolsOf(section)`; it draws only while `isShown(section)` (panel.js).
 */

import { bodyOf, furnish } from "./panel.js";

/** Loads a module on first use, so that a panel with a fault leaves the others intact. */
const from = (path) => async (section, context) => (await import(path)).create(section, context);

/** In the order of their creation: the pictures first. */
const PANELS = [
  { id: "omni", title: "What the robot sees", create: from("./views/omni.js") },
  { id: "status", title: "Status", create: from("./panels/status.js") },
  { id: "drive", title: "Drive", create: from("./panels/drive.js") },
  { id: "cost", title: "What accuracy costs", create: from("./panels/cost.js") },
  { id: "panorama", title: "Panorama", create: from("./views/panorama.js") },
  { id: "perspective", title: "Look around", create: from("./views/perspective.js") },
  { id: "map", title: "Map", create: from("./panels/map.js") },
  { id: "effects", title: "What this scene calls for", create: from("./panels/effects.js") },
  { id: "robot", title: "Robots", create: from("./panels/robot.js") },
  { id: "accuracy", title: "Accuracy in detail", create: from("./panels/accuracy.js") },
  { id: "labels", title: "Ground truth", create: from("./panels/labels.js") },
  { id: "plots", title: "Plots", create: from("./panels/plots.js") },
  { id: "scans", title: "Range scans", create: from("./panels/scans.js") },
];

/** Section of the panel with this id. */
const sectionOf = (id) => document.getElementById(`panel-${id}`);

/** Give the panels their titles, expanded or collapsed as they were left; needs no connection. */
export function preparePanels() {
  for (const { id, title } of PANELS)
    // The status line has its place in the bar of the page, without a title.
    if (id !== "status") furnish(sectionOf(id), title);
}

/** Create all panels. The fault of one is shown in its place. */
export async function createPanels(context) {
  await Promise.all(
    PANELS.map(async ({ id, title, create }) => {
      try {
        await create(sectionOf(id), context);
      } catch (error) {
        console.error(`panel ${id}:`, error);
        bodyOf(sectionOf(id)).textContent = `${title} cannot be shown: ${error.message}`;
      }
    }),
  );
}
