/**
 * Driving: which robot, from a demand to wheel speeds, and when it stops.
 *
 * A demand is {forward, turn}, each -1 to 1, turn positive to the right. While it is not zero the
 * wheel speeds are sent at 20 Hz, since the server stops a robot whose driver is silent for 0.25 s.
 */

import { shorten } from "./panel.js";
import { classOf, robotOf } from "./scan_geometry.js";

const INTERVAL_MS = 50;
/** Wheel speed of turning on the spot, as a fraction of the limit: turning is the faster motion. */
const TURN_FRACTION = 0.5;
/** Without any reply for so long the robot no longer follows, so the page lets go. */
const MAX_SILENCE_MS = 500;

/** The robot that this page drives: its own, else the selected one if shared, else the reason. */
export function targetOf(context) {
  const { own, selected, commands } = context;
  const none = (reason) => ({ name: "", wire_name: "", robot: null, reason });
  if (!commands.isOpen) return none("there is no connection");
  if (own) return { name: own, wire_name: "", robot: robotOf(context, own), reason: "" };
  const robot = robotOf(context, selected.robot);
  if (!robot) return none("there is no robot yet: spawn one below");
  const { name } = robot;
  if (robot.shares_control) return { name, wire_name: name, robot, reason: "" };
  return none(`${shorten(name, 20)}'s owner does not share it: spawn one below`);
}

/** Wheel speeds in rad/s of a demand; the faster side is at most at the limit. */
export function wheelSpeeds({ forward, turn }, limit_rad_s) {
  const left = forward + TURN_FRACTION * turn;
  const right = forward - TURN_FRACTION * turn;
  const excess = Math.max(1, Math.abs(left), Math.abs(right));
  return [(left / excess) * limit_rad_s, (right / excess) * limit_rad_s];
}

/** Sum of demands, limited to -1 to 1. */
function sumOf(demands) {
  const limit = (value) => Math.max(-1, Math.min(1, value));
  const sum = (axis) => limit(demands.reduce((total, demand) => total + demand[axis], 0));
  return { forward: sum("forward"), turn: sum("turn") };
}

const isZero = ({ forward, turn }) => forward === 0 && turn === 0;

export class DriveControl {
  /** Speed limit of a wheel as a fraction of the class's maximum. */
  limit = 0.5;
  /** Commanded speeds, left and right, in rad/s. */
  speeds_rad_s = [0, 0];
  /** Why the robot stands still; empty before it has been driven. */
  reason = "";
  #context;
  #onChange;
  #demands = new Map();
  #isLatched = false;
  #timer = null;
  #driven = null;
  #unanswered = 0;
  /** Since when the server owes a reply. */
  #silentSince_ms = 0;

  /** `onChange()` is called when speeds or reason change. */
  constructor(context, onChange) {
    this.#context = context;
    this.#onChange = onChange;
  }

  get isMoving() {
    return this.#timer !== null;
  }

  /** Name of the robot driven last, to which the reason belongs. */
  get drivenName() {
    return this.#driven?.name ?? "";
  }

  /** Set the demand of one input; the demands of all inputs add up. */
  setDemand(source, demand) {
    this.#demands.set(source, demand);
    const sum = sumOf([...this.#demands.values()]);
    if ([...this.#demands.values()].every(isZero)) this.#isLatched = false;
    if (this.#isLatched) return;
    if (!isZero(sum) && !this.isMoving) this.#start();
    // A robot that stands already keeps the reason for which it stopped.
    if (isZero(sum) && this.isMoving) this.#halt("the controls were released");
  }

  /** Stop at once; inputs count again after all of them have been released. */
  stop(reason) {
    this.#isLatched = [...this.#demands.values()].some((demand) => !isZero(demand));
    this.#halt(reason);
  }

  /** Stop also a robot that this page did not set in motion, if it may drive it. */
  emergencyStop(reason) {
    const target = targetOf(this.#context);
    this.stop(reason);
    if (!target.name) return;
    this.#driven = target;
    this.#send(target, [0, 0]);
    this.#onChange();
  }

  #start() {
    const target = targetOf(this.#context);
    if (!target.name) return this.#note([0, 0], target.reason);
    this.#driven = target;
    this.#timer = setInterval(() => this.#drive(), INTERVAL_MS);
    this.#drive();
  }

  #drive() {
    const target = targetOf(this.#context);
    if (target.name !== this.#driven.name) return this.stop(target.reason || "another robot");
    const silence_ms = performance.now() - this.#silentSince_ms;
    if (this.#unanswered && silence_ms > MAX_SILENCE_MS)
      return this.stop("the server does not answer");
    const limit_rad_s = this.limit * maxSpeed(this.#context, target.robot);
    const speeds = wheelSpeeds(sumOf([...this.#demands.values()]), limit_rad_s);
    this.#send(target, speeds);
    this.#note(speeds, "");
  }

  #halt(reason) {
    const wasMoving = this.isMoving;
    clearInterval(this.#timer);
    this.#timer = null;
    if (wasMoving) this.#send(this.#driven, [0, 0]);
    this.#note([0, 0], reason);
  }

  #note(speeds, reason) {
    this.speeds_rad_s = speeds;
    this.reason = reason;
    this.#onChange();
  }

  async #send({ wire_name }, [left, right]) {
    const request = { kind: "drive", left, right, normalized: false, robot: wire_name };
    if (!this.#unanswered) this.#silentSince_ms = performance.now();
    this.#unanswered += 1;
    try {
      await this.#context.commands.request(request);
    } catch (error) {
      if (this.isMoving) this.stop(error.message);
    } finally {
      this.#unanswered -= 1;
      this.#silentSince_ms = performance.now();
    }
  }
}

/** Largest wheel speed of a robot's class; 0 of an unknown one, which then stands still. */
export const maxSpeed = ({ server }, robot) =>
  classOf(server, robot?.class_name ?? "")?.max_speed_rad_s ?? 0;
