/** The list of all robots, from which one and its camera are selected. */

import { make, shorten } from "./panel.js";
import { classOf, selectedName } from "./scan_geometry.js";

const MAX_LISTED = 100;

/** All robots, with a button for each camera that can be watched. */
export class RobotList {
  #context;
  #rows = make("tbody");
  #more = make("p", { className: "quiet" });
  /** Rows by name, each with the signature of what it shows. */
  #cache = new Map();

  constructor(context) {
    this.#context = context;
    const heading = (text) => make("th", { scope: "col" }, text);
    const head = make("tr", {}, heading("Robot"), heading("Class"), heading("Watch"));
    const table = make("table", {}, make("thead", {}, head), this.#rows);
    const scroller = { className: "scroller", tabIndex: 0, role: "region", ariaLabel: "List" };
    this.element = make("div", scroller, table, this.#more);
  }

  /** Replace the rows that have changed; the others stay, under the pointer too. */
  update() {
    const robots = this.#context.state?.reply.robots ?? [];
    const listed = robots.slice(0, MAX_LISTED);
    const hadFocus = this.#rows.contains(document.activeElement);
    this.#cache = new Map(listed.map((robot) => [robot.name, this.#cachedRow(robot)]));
    const rows = [...this.#cache.values()].map(({ row }) => row);
    const kept = new Set(rows);
    for (const row of [...this.#rows.children]) if (!kept.has(row)) row.remove();
    rows.forEach((row, index) => {
      const present = this.#rows.children[index] ?? null;
      if (present !== row) this.#rows.insertBefore(row, present);
    });
    if (hadFocus && !this.#rows.contains(document.activeElement))
      this.#rows.querySelector('[aria-pressed="true"]')?.focus();
    this.#more.textContent = remarkOf(robots.length, robots.length - listed.length);
  }

  #cachedRow(robot) {
    const { selected, own } = this.#context;
    const { name, class_name, shares_control } = robot;
    const chosen = selectedName(this.#context);
    const camera = name === chosen ? selected.camera : null;
    const signature = JSON.stringify([class_name, shares_control, name === own, camera]);
    const cached = this.#cache.get(name);
    if (cached?.signature === signature) return cached;
    return { signature, row: this.#row(robot, chosen) };
  }

  #row(robot, chosen) {
    const { own, server } = this.#context;
    const remarks = [];
    if (robot.name === own) remarks.push("yours");
    if (robot.shares_control) remarks.push("shared");
    const name = make("th", { scope: "row", title: robot.name }, shorten(robot.name, 24));
    if (remarks.length) name.append(make("span", { className: "quiet" }, ` ${remarks.join(", ")}`));
    const cameras = classOf(server, robot.class_name)?.cameras ?? [];
    const buttons = cameras.map((camera) => this.#button(robot, camera, chosen));
    const watch = make("td", {}, make("div", { className: "controls" }, ...buttons));
    if (!cameras.length) watch.textContent = "no camera";
    // Without the package, which all classes share.
    const className = shorten(robot.class_name.split(".").at(-1), 24);
    return make("tr", {}, name, make("td", { title: robot.class_name }, className), watch);
  }

  #button(robot, { name, kind }, chosen) {
    const { selected } = this.#context;
    const isChosen = robot.name === chosen && name === selected.camera;
    const properties = {
      type: "button",
      className: "button small",
      ariaPressed: String(isChosen),
      ariaLabel: `Watch ${kind} camera ${name} of ${shorten(robot.name)}`,
      title: name,
      onclick: () => this.#context.select(robot.name, name),
    };
    return make("button", properties, kind === "omni" ? "Omni" : shorten(name, 16));
  }
}

function remarkOf(number, numHidden) {
  if (number === 0) return "There is no robot yet.";
  return numHidden > 0 ? `and ${numHidden} more` : "";
}
