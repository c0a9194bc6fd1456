/**
 * Driving by keys, gamepad and stick, and the steps of a lockstep clock. The robot stops when
 * every control is released, and whenever the page may no longer see or hear what it drives.
 */

import { DriveControl, maxSpeed, targetOf } from "../drive_control.js";
import { listenToGamepad, listenToKeys, listenToStick, NEUTRAL } from "../drive_inputs.js";
import {
  bodyOf,
  isOpen,
  make,
  makeButton,
  makeSelect,
  remember,
  remembered,
  setText,
  shorten,
} from "../panel.js";
import { classOf } from "../scan_geometry.js";

const STEPS_S = [0.02, 0.1, 0.5, 1, 5];

/** Create the panel. */
export function create(section, context) {
  new DrivePanel(section, context);
}

class DrivePanel {
  #section;
  #context;
  #control;
  #status = make("p", { className: "drive-status", role: "status" });
  #speed = make("p", { className: "quiet" });
  #limit = make("input", { type: "range", min: "5", max: "100", step: "5" });
  #limitText = make("output");
  #gamepad = make("p", { className: "quiet", hidden: true });
  #stick;
  #duration = makeSelect(STEPS_S, (time) => `${time} s`, { ariaLabel: "Duration of a step" });
  #stepsAlong = make("input", { type: "checkbox" });
  #isStepping = false;

  constructor(section, context) {
    this.#section = section;
    this.#context = context;
    this.#control = new DriveControl(context, () => {
      context.isDriving = this.#control.isMoving;
      this.#show();
      this.#stepAlong();
    });
    this.#limit.value = remembered("catoptra.drive.limit", 50);
    this.#control.limit = this.#limit.value / 100;
    bodyOf(section).append(...this.#elements());
    const releases = this.#listen();
    this.#stopWhenUnattended(releases);
    context.on("state", () => this.#show());
    context.on("selection", () => this.#show());
    context.on("connection", () => this.#show());
    this.#show();
  }

  #elements() {
    const knob = make("span", { className: "knob" });
    const label = "Stick: drag to drive. The keys W A S D and the arrows do the same.";
    this.#stick = make("div", { className: "stick", role: "img", ariaLabel: label }, knob);
    const halt = () => this.#control.emergencyStop("Stop was pressed");
    const stop = makeButton("Stop", halt, { className: "button stop", title: "Space bar" });
    this.#limit.addEventListener("input", () => this.#setLimit());
    const limit = make("label", { className: "limit" }, "Limit", this.#limit, this.#limitText);
    // On the picture where there is room, else in front of the panel.
    document.getElementById("stick").append(this.#stick);
    return [this.#status, this.#speed, limit, stop, ...this.#stepControls(), this.#gamepad];
  }

  /** Button and duration of a step, and whether driving makes steps; none in real time. */
  #stepControls() {
    if (this.#context.server.clock !== "lockstep") return [];
    this.#duration.value = "0.1";
    const button = makeButton("Step", () => this.#step());
    return [button, this.#duration, make("label", {}, this.#stepsAlong, "while driving")];
  }

  async #step() {
    if (this.#isStepping) return;
    this.#isStepping = true;
    const time_s = Number(this.#duration.value);
    // At most as fast as real time, in which people drive.
    const pause = new Promise((resolve) => setTimeout(resolve, 1000 * time_s));
    try {
      await this.#context.commands.request({ kind: "step", time_s });
      if (this.#stepsAlong.checked && this.#control.isMoving) await pause;
    } catch (error) {
      this.#stepsAlong.checked = false;
      this.#setStatus(`No step: ${error.message}`, "error");
    } finally {
      this.#isStepping = false;
    }
    this.#stepAlong();
  }

  /** Let time pass while the robot is driven, if the user wants so. */
  #stepAlong() {
    if (this.#stepsAlong.checked && this.#control.isMoving) this.#step();
  }

  #setLimit() {
    this.#control.limit = this.#limit.value / 100;
    remember("catoptra.drive.limit", Number(this.#limit.value));
    this.#show();
  }

  /** @returns {(() => void)[]} functions that release the controls */
  #listen() {
    const control = this.#control;
    const releaseKeys = listenToKeys({
      isReady: () => isOpen(this.#section) && targetOf(this.#context).name !== "",
      onDemand: (demand) => control.setDemand("keys", demand),
      isMoving: () => this.#isRobotMoving(),
      onStop: () => control.emergencyStop("the space bar was pressed"),
    });
    const releaseStick = listenToStick(this.#stick, this.#stick.firstChild, (demand) =>
      control.setDemand("stick", demand),
    );
    listenToGamepad(
      (demand) => control.setDemand("gamepad", isOpen(this.#section) ? demand : NEUTRAL),
      (name) => {
        this.#gamepad.textContent = name && `Gamepad: ${shorten(name, 60)}`;
        this.#gamepad.hidden = !name;
      },
    );
    return [releaseKeys, releaseStick];
  }

  #isRobotMoving() {
    const { robot } = targetOf(this.#context);
    return this.#control.isMoving || Boolean(robot?.wheel_speeds_rad_s.some((speed) => speed));
  }

  #stopWhenUnattended(releases) {
    const stop = (reason) => {
      if (!this.#control.isMoving) return;
      this.#control.stop(reason);
      for (const release of releases) release();
    };
    addEventListener("blur", () => stop("the window lost the focus"));
    addEventListener("pagehide", () => stop("the page was left"));
    document.addEventListener("freeze", () => stop("the page was frozen"));
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) stop("the page was hidden");
    });
    this.#context.commands.on("close", () => stop("the connection was lost"));
  }

  #show() {
    const target = targetOf(this.#context);
    setText(this.#speed, this.#speedText(target.robot));
    setText(this.#limitText, this.#limitInMetres(target.robot));
    this.#setStatus(...this.#stateOf(target));
    this.#stick.classList.toggle("disabled", !target.name);
  }

  /** Sentence about the robot, and its class. */
  #stateOf({ name, wire_name, robot, reason }) {
    const shortName = shorten(name, 30);
    if (this.#control.isMoving) return [`Driving ${shortName}.`, "ok"];
    if (!name) return [`Stopped: ${reason}.`, ""];
    const { reason: stopReason, drivenName } = this.#control;
    if (stopReason && drivenName === name) return [`Stopped: ${stopReason}.`, ""];
    const isDriven = robot?.wheel_speeds_rad_s.some((speed) => speed !== 0);
    if (wire_name && isDriven) return [`Another client drives ${shortName}; you may too.`, ""];
    return [`Ready to drive ${shortName}: keys W A S D or arrows, gamepad, stick.`, ""];
  }

  /** Speed and turn by the wheels of a robot; its wheel speeds where the class is unknown. */
  #speedText(robot) {
    if (!robot) return "";
    const [left, right] = robot.wheel_speeds_rad_s;
    const size = classOf(this.#context.server, robot.class_name);
    if (!size?.wheel_radius_m) return `${left.toFixed(1)}, ${right.toFixed(1)} rad/s`;
    const forward_m_s = 0.5 * (left + right) * size.wheel_radius_m;
    const turn_rad_s = ((left - right) * size.wheel_radius_m) / size.wheel_separation_m;
    return `${forward_m_s.toFixed(2)} m/s, ${turn_rad_s.toFixed(2)} rad/s`;
  }

  #limitInMetres(robot) {
    const radius_m = classOf(this.#context.server, robot?.class_name ?? "")?.wheel_radius_m;
    if (!radius_m) return `${this.#limit.value} %`;
    const speed_m_s = this.#control.limit * maxSpeed(this.#context, robot) * radius_m;
    return `${speed_m_s.toFixed(2)} m/s`;
  }

  #setStatus(text, className) {
    setText(this.#status, text);
    this.#status.className = `drive-status ${className}`;
  }
}
