/** State of the selected robot: pose, speeds, status, notes and readings. */

import { beliefsOf } from "./beliefs.js";
import { make, setText, shorten } from "./panel.js";
import { degrees, odometryPose, planarPose, robotOf, selectedName } from "./scan_geometry.js";

const MAX_FIELDS = 24;
const MAX_READINGS = 64;
/** Fields of the status line that are shown in words, or not at all. */
const STATUS_FIELDS = new Set(["type", "time", "battery", "lighttoggle", "lightintensity", "view"]);

/** State of the selected robot, its readings as text, and what clients publish about it. */
export class RobotDetails {
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
    setText(list.children[index], text);
  });
}

const poseText = ({ x, y, yaw }) => `${x.toFixed(3)}, ${y.toFixed(3)} m, ${degrees(yaw)}`;

function tiltText({ position_m, rotation }) {
  const [x, y, z] = rotation.slice(6);
  const tilt = [Math.atan2(y, z), Math.atan2(-x, Math.hypot(y, z))].map((one) => degrees(one));
  return `${position_m[2].toFixed(3)} m, ${tilt.join(", ")}`;
}

function valuesOf(robot, { readings }) {
  const speeds = robot.wheel_speeds_rad_s.map((speed) => speed.toFixed(2)).join(", ");
  const measured = odometryPose(readings, robot);
  const pairs = [
    ["True pose", poseText(planarPose(robot.world_from_robot))],
    ["z, roll, pitch", tiltText(robot.world_from_robot)],
    ["By odometry", measured ? poseText(measured) : "\u2013"],
    ["Wheels, left, right", `${speeds} rad/s`],
  ];
  const status = [...readings.values()].find(({ word }) => word === "STA");
  return status ? [...pairs, ...statusPairs(status)] : pairs;
}

/** Battery and lights in words, then the joints. */
function statusPairs({ fields, labels }) {
  const isLit = fields.get("lighttoggle")?.toLowerCase() === "true";
  // Robots without steered wheels report angles of 0 for them.
  const isJoint = ([name, value]) =>
    !STATUS_FIELDS.has(name) && !(name.endsWith("steer") && Number(value) === 0);
  const joints = [...fields].filter(isJoint).slice(0, MAX_FIELDS);
  return [
    ["Battery", `${fields.get("battery") ?? "\u2013"} s`],
    ["Lights", isLit ? `on, ${fields.get("lightintensity") ?? "\u2013"} %` : "off"],
    ...joints.map(([name, value]) => [shorten(labels.get(name), 24), `${shorten(value, 24)} rad`]),
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
