/** The robot of this page: it lives as long as the connection of the commands. */

import { make, makeButton, shorten } from "./panel.js";
import { robotOf } from "./scan_geometry.js";

/** Spawning, sharing and removing the robot of this page. */
export class OwnRobot {
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
  #remove = makeButton("", () => this.#reset());

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
    context.on("placed", (place) => this.#setPlace(place));
    context.commands.on("close", () => this.#lose("the connection was lost"));
    context.on("state", () => this.#follow());
    const heading = make("h3", {}, "A robot of your own");
    this.element = make("div", { className: "block own" }, heading, this.#form, this.#owned);
    this.element.append(this.#message);
  }

  #makeForm() {
    const [x, y, heading] = this.#pose;
    const place = makeButton("Press on the map", () => this.#startPlacing());
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
      const moved = reply.moved_to?.map((value) => value.toFixed(2));
      this.#say(moved ? `The place was not free: it stands at ${moved.join(", ")} m.` : "");
    } catch (error) {
      this.#say(`Not spawned: ${error.message}`, "error");
    }
    this.update();
  }

  /** Watch the robot as soon as a state lists it, and notice when none does any more. */
  #follow() {
    if (robotOf(this.#context, this.#own)) {
      if (this.#isNew) this.#context.select(this.#own);
      this.#isNew = false;
    } else if (!this.#isNew) {
      this.#lose("see the server's log");
    }
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
