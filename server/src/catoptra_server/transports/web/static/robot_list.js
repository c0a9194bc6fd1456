/** The list of all robots, from which one and its camera are selected. */

import { make, shorten } from "./panel.js";
import { classOf, selectedName } from "./scan_geometry.js";

const MAX_LISTED = 100;

/** All robots, with a button for each camera that can be watched. */
export class RobotList {
  #context;
  #rows = make("tbody");
  #more = make("p", { className: "quiet" });
  #signature = null;

  constructor(context) {
    this.#context = context;
    const heading = (text) => make("th", { scope: "col" }, text);
    const head = make("tr", {}, heading("Robot"), heading("Class"), heading("Watch"));
    const table = make("table", {}, make("thead", {}, head), this.#rows);
    const scroller = { className: "scroller", tabIndex: 0, role: "region", ariaLabel: "List" };
    this.element = make("div", scroller, table, this.#more);
  }

  /** Build the rows anew where something they show has changed. */
  update() {
    const { state, selected, own } = this.#context;
    const robots = state?.reply.robots ?? [];
    const chosen = selectedName(this.#context);
    const listed = robots.slice(0, MAX_LISTED);
    const signature = JSON.stringify([
      listed.map(({ name, class_name, shares_control }) => [name, class_name, shares_control]),
      [chosen, selected.camera, own, robots.length],
    ]);
    if (signature === this.#signature) return;
    this.#signature = signature;
    const hadFocus = this.#rows.contains(document.activeElement);
    this.#rows.replaceChildren(...listed.map((robot) => this.#row(robot, chosen)));
    if (hadFocus) this.#rows.querySelector('[aria-pressed="true"]')?.focus();
    const hidden = robots.length - listed.length;
    this.#more.textContent = robots.length
      ? hidden > 0
        ? `and ${hidden} more`
        : ""
      : "There is no robot yet.";
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
