/** The robots: which there are, spawning one's own, sharing its control, and the state of one. */

import { beliefsOf } from "../beliefs.js";
import { bodyOf, drawOnDemand, make, shorten } from "../panel.js";
import { classOf, degrees, odometryPose, planarPose } from "../scan_geometry.js";

const MAX_LISTED = 100;
const MAX_FIELDS = 24;
const MAX_READINGS = 64;
/** Fields of the status line that are shown in words, or not at all. */
const STATUS_FIELDS = new Set(["type", "time", "battery", "lighttoggle", "lightintensity", "view"]);

/** Create the panel. */
export function create(section, context) {
  const list = new RobotList(context);
  const own = new OwnRobot(context);
  const details = new Details(context);
  bodyOf(section).append(list.element, own.element, details.element);
  const draw = drawOnDemand(section, () => {
    list.update();
    own.update();
    details.update();
  });
  for (const event of ["state", "selection", "connection"]) context.on(event, draw);
}

/** The robot of the state that has the name. */
const robotOf = (context, name) =>
  context.state?.reply.robots.find((robot) => robot.name === name) ?? null;

/** Name of the robot whose readings the page receives. */
const selectedName = ({ state, selected }) => state?.reply.robot || selected.robot;

/** All robots, with a button for each camera that can be watched. */
class RobotList {
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

/** Spawning, sharing and removing the robot of this page. */
class OwnRobot {
  #context;
  #class = make("select", { name: "class" });
  #start = make("select", { name: "start" });
  #name = make("input", { type: "text", name: "name", maxLength: 40, placeholder: "optional" });
  #pose = ["x", "y", "heading"].map((name) =>
    make("input", { type: "number", name, step: "any", value: "0", className: "short" }),
  );
  #poseFields;
  /** Name of the page's robot, kept to name it when it is lost. */
  #own = "";
  #isNew = false;
  #message = make("p", { role: "status" });
  #form;
  #owned = make("div", { className: "controls" });
  #share = make("input", { type: "checkbox" });
  #remove = make("button", { type: "button", className: "button" });

  constructor(context) {
    this.#context = context;
    const { classes, start_poses } = context.server;
    const option = (value, label = value) => make("option", { value }, shorten(label));
    this.#class.append(...classes.map(({ class_name }) => option(class_name)));
    this.#start.append(
      ...start_poses.map(({ name }) => option(name)),
      option("", "x, y, or the map"),
    );
    this.#form = this.#makeForm();
    this.#owned.append(make("label", {}, this.#share, "Let others drive it"), this.#remove);
    this.#share.addEventListener("change", () => this.#setShared());
    this.#remove.addEventListener("click", () => this.#reset());
    context.on("placed", (place) => this.#setPlace(place));
    context.commands.on("close", () => this.#lose("the connection was lost"));
    context.on("state", () => this.#selectNew());
    const heading = make("h3", {}, "A robot of your own");
    this.element = make("div", { className: "block" }, heading, this.#form, this.#owned);
    this.element.append(this.#message);
  }

  #makeForm() {
    const [x, y, heading] = this.#pose;
    const place = make("button", { type: "button", className: "button" }, "Press on the map");
    place.addEventListener("click", () => this.#startPlacing());
    this.#poseFields = make(
      "div",
      { className: "controls" },
      make("label", {}, "x", x, "m"),
      make("label", {}, "y", y, "m"),
      make("label", {}, "heading", heading, "\u00b0"),
      place,
    );
    this.#start.addEventListener("change", () => this.#startChanged());
    const form = make(
      "form",
      { className: "block" },
      make(
        "div",
        { className: "controls" },
        make("label", {}, "Class", this.#class),
        make("label", {}, "at", this.#start),
        make("label", {}, "Name", this.#name),
        make("button", { className: "button primary" }, "Spawn"),
      ),
      this.#poseFields,
    );
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.#spawn();
    });
    this.#poseFields.hidden = this.#start.value !== "";
    return form;
  }

  #startChanged() {
    this.#poseFields.hidden = this.#start.value !== "";
    this.#context.emit("place", { active: false });
  }

  #startPlacing() {
    this.#context.emit("place", { active: true });
    this.#say("");
  }

  /** Spawn at a place pressed on the map. */
  #setPlace({ x_m, y_m, yaw_rad }) {
    const [x, y, heading] = this.#pose;
    x.value = x_m.toFixed(2);
    y.value = y_m.toFixed(2);
    heading.value = ((yaw_rad * 180) / Math.PI).toFixed(0);
    this.#spawn();
  }

  async #spawn() {
    const context = this.#context;
    const request = { kind: "spawn", class_name: this.#class.value, ...this.#place() };
    request.name = this.#name.value.trim() || null;
    try {
      const reply = await context.commands.request(request);
      context.own = reply.robot;
      this.#own = reply.robot;
      this.#isNew = true;
      const moved = reply.moved_to?.slice(0, 2).map((value) => value.toFixed(2));
      this.#say(moved ? `The place was not free: it stands at ${moved.join(", ")} m.` : "");
    } catch (error) {
      this.#say(`Not spawned: ${error.message}`, "error");
    }
    this.update();
  }

  /** Watch one's robot as soon as a state lists it: the page selects among those listed. */
  #selectNew() {
    if (!this.#isNew || !robotOf(this.#context, this.#own)) return;
    this.#isNew = false;
    this.#context.select(this.#own);
  }

  #place() {
    if (this.#start.value) return { start: this.#start.value, location_m: null };
    const [x, y, heading] = this.#pose.map((field) => Number(field.value) || 0);
    const rotation_rad = [0, 0, (heading * Math.PI) / 180];
    return { start: null, location_m: [x, y, 0], rotation_rad };
  }

  async #setShared() {
    const shared = this.#share.checked;
    try {
      await this.#context.commands.request({ kind: "share_control", shared });
    } catch (error) {
      this.#share.checked = !shared;
      this.#say(`Not changed: ${error.message}`, "error");
    }
  }

  async #reset() {
    try {
      await this.#context.commands.request({ kind: "reset" });
      this.#lose("");
    } catch (error) {
      this.#say(`Not removed: ${error.message}`, "error");
    }
  }

  /** The robot is gone: with it the right to drive it. */
  #lose(reason) {
    if (!this.#own) return;
    this.#say(reason && `${shorten(this.#own)} was removed: ${reason}.`);
    this.#context.own = "";
    this.#own = "";
    this.update();
  }

  #say(text, className = "quiet") {
    this.#message.textContent = text;
    this.#message.className = className;
  }

  update() {
    const { own } = this.#context;
    this.#form.hidden = own !== "";
    this.#owned.hidden = own === "";
    this.#remove.textContent = `Remove ${shorten(own, 24)}`;
    const robot = robotOf(this.#context, own);
    if (robot && document.activeElement !== this.#share) this.#share.checked = robot.shares_control;
  }
}

/** State of the selected robot, its readings as text, and what clients publish about it. */
class Details {
  #context;
  #title = make("h3");
  #values = make("dl", { className: "values" });
  #notes = make("div", { className: "block" });
  #readings = make("dl", { className: "values raw", tabIndex: 0, ariaLabel: "All readings" });
  #raw = make("details", {}, make("summary", {}, "All readings"), this.#readings);

  constructor(context) {
    this.#context = context;
    this.element = make("div", { className: "block" }, this.#title, this.#values, this.#notes);
    this.element.append(this.#raw);
    this.#raw.addEventListener("toggle", () => this.update());
  }

  update() {
    const { state } = this.#context;
    const robot = robotOf(this.#context, selectedName(this.#context));
    this.element.hidden = robot === null;
    if (!robot) return;
    this.#title.textContent = `State of ${shorten(robot.name)}`;
    setValues(this.#values, valuesOf(robot, state));
    const beliefs = beliefsOf(state).filter(({ text, pose }) => text || pose);
    this.#notes.replaceChildren(...beliefs.map(noteElement));
    if (this.#raw.open) setValues(this.#readings, readingPairs(state.readings));
  }
}

/** Update a list of pairs in place: elements stay, so that a selection of text stays too. */
function setValues(list, pairs) {
  while (list.childElementCount > 2 * pairs.length) list.lastElementChild.remove();
  while (list.childElementCount < 2 * pairs.length) list.append(make("dt"), make("dd"));
  pairs.flat().forEach((text, index) => {
    const element = list.children[index];
    if (element.textContent !== text) element.textContent = text;
  });
}

const poseText = ({ x, y, yaw }) => `${x.toFixed(3)}, ${y.toFixed(3)} m, ${degrees(yaw)}`;

function valuesOf(robot, { readings }) {
  const speeds = robot.wheel_speeds_rad_s.map((speed) => speed.toFixed(2)).join(", ");
  const measured = odometryPose(readings, robot);
  const pairs = [
    ["True pose", poseText(planarPose(robot.world_from_robot))],
    ["By odometry", measured ? poseText(measured) : "\u2013"],
    ["Wheels, left, right", `${speeds} rad/s`],
  ];
  const status = [...readings.values()].find(({ word }) => word === "STA");
  return status ? [...pairs, ...statusPairs(status)] : pairs;
}

/** Battery and lights in words, then the joints. */
function statusPairs({ fields }) {
  const isLit = fields.get("lighttoggle")?.toLowerCase() === "true";
  // Robots without steered wheels report angles of 0 for them.
  const isJoint = ([name, value]) =>
    !STATUS_FIELDS.has(name) && !(name.endsWith("steer") && Number(value) === 0);
  const joints = [...fields].filter(isJoint).slice(0, MAX_FIELDS);
  return [
    ["Battery", `${fields.get("battery") ?? "\u2013"} s`],
    ["Lights", isLit ? `on, ${fields.get("lightintensity") ?? "\u2013"} %` : "off"],
    ...joints.map(([name, value]) => [shorten(name, 24), `${shorten(value, 24)} rad`]),
  ];
}

/** Each reading as one line of text. */
function readingPairs(readings) {
  return [...readings.values()].slice(0, MAX_READINGS).map(({ type, name, fields, parts }) => {
    const values = [...fields].filter(([key]) => key !== "type" && key !== "name");
    const texts = [
      ...parts.map((part) => `${part.name} ${part.value}`),
      ...values.map(([key, value]) => `${key} ${value}`),
    ];
    return [shorten(name || type, 24), shorten(texts.join("; "), 400)];
  });
}

function noteElement({ name, pose, text }) {
  const element = make("div", {}, make("h3", {}, `Note \u201c${shorten(name)}\u201d`));
  if (pose) element.append(make("p", {}, poseText(pose)));
  if (text) element.append(make("p", { className: "note" }, text));
  return element;
}
