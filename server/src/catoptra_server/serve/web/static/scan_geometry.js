/**
 * Poses on the floor and the rays of range sensors.
 *
 * Frames are SAE: x forward, y right, angles clockwise seen from above, in radians. A pose is
 * {x, y, yaw} in the frame of its parent.
 */

import { numbersOf, readingKey } from "./readings.js";

/** Of robots of unknown classes, and of one that is being placed. */
export const DEFAULT_SIZE_M = [0.5, 0.4, 0.3];

/** Angle in (-pi, pi]. */
export const wrapped = (angle_rad) =>
  angle_rad - 2 * Math.PI * Math.ceil((angle_rad - Math.PI) / (2 * Math.PI));

/** Degrees with a sign, for people. */
export const degrees = (angle_rad, digits = 1) =>
  `${((angle_rad * 180) / Math.PI).toFixed(digits)}\u00b0`;

/** Pose on the floor of a transform of the wire. */
export function planarPose({ position_m, rotation }) {
  return { x: position_m[0], y: position_m[1], yaw: Math.atan2(rotation[3], rotation[0]) };
}

/** parent_from_child of parent_from_middle and middle_from_child, or of a point there. */
export function compose(outer, { x, y, yaw = 0 }) {
  const [cosine, sine] = [Math.cos(outer.yaw), Math.sin(outer.yaw)];
  return {
    x: outer.x + cosine * x - sine * y,
    y: outer.y + sine * x + cosine * y,
    yaw: wrapped(outer.yaw + yaw),
  };
}

/** Rays {angle_rad, range_m, has_echo} of a range scanner, right to left, in the robot's frame. */
export function scanRays(reading, sensor) {
  const ranges = numbersOf(reading.fields.get("range") ?? "");
  const [fov] = numbersOf(reading.fields.get("fov") ?? "");
  const fov_rad = fov ?? sensor.fov_rad;
  // The text of Resolution is truncated: over 180 steps that would turn the last ray by a degree.
  const step_rad = ranges.length > 1 ? fov_rad / (ranges.length - 1) : 0;
  const first_rad = sensor.yaw_rad + (ranges.length > 1 ? fov_rad / 2 : 0);
  return ranges.map((range_m, index) => ({
    angle_rad: first_rad - index * step_rad,
    range_m,
    has_echo: hasEcho(range_m, sensor),
  }));
}

/** Whether a range is a measurement; without an echo sensors report their largest range. */
export const hasEcho = (range_m, sensor) => range_m < sensor.max_range_m - 0.0002;

/** End of a ray in the robot's frame. */
export const rayEnd = (sensor, angle_rad, range_m) => ({
  x: sensor.x_m + range_m * Math.cos(angle_rad),
  y: sensor.y_m + range_m * Math.sin(angle_rad),
});

/** Pose in the world by the robot's odometry; null without that sensor. */
export function odometryPose(readings, robot) {
  const reading = readings.get(readingKey("Odometry", "Odometry"));
  const numbers = numbersOf(reading?.fields.get("pose") ?? "");
  if (numbers.length !== 3) return null;
  const [x, y, yaw] = numbers;
  return compose(planarPose(robot.world_from_start), { x, y, yaw });
}

/** The description of a robot's class in server.json, if any. */
export const classOf = (server, className) =>
  server.classes.find((candidate) => candidate.class_name === className);

/** The robot of the newest state that has the name; null for none. */
export const robotOf = ({ state }, name) =>
  state?.reply.robots.find((robot) => robot.name === name) ?? null;

/** Name of the robot whose readings the page receives. */
export const selectedName = ({ state, selected }) => state?.reply.robot || selected.robot;

/** Length, width and height of a robot in metres. */
export const sizeOf = (server, robot) =>
  classOf(server, robot.class_name)?.size_m ?? DEFAULT_SIZE_M;

/** True poses of the recent past, to place readings and notes at the time they belong to. */
export class PoseHistory {
  #samples = [];

  /** Keep the newest hundred poses; time that goes back starts anew. */
  add(time_s, pose) {
    const last = this.#samples.at(-1);
    if (last && time_s < last.time_s) this.#samples = [];
    if (last?.time_s === time_s) return;
    this.#samples.push({ time_s, pose });
    if (this.#samples.length > 100) this.#samples.shift();
  }

  clear() {
    this.#samples = [];
  }

  /** Pose at a time, between the two samples around it; null before the first. */
  at(time_s) {
    const samples = this.#samples;
    const after = samples.findIndex((sample) => sample.time_s >= time_s);
    if (after < 0) return samples.at(-1)?.pose ?? null;
    if (samples[after].time_s === time_s) return samples[after].pose;
    if (after === 0) return null;
    return between(samples[after - 1], samples[after], time_s);
  }
}

function between(before, after, time_s) {
  const weight = (time_s - before.time_s) / (after.time_s - before.time_s);
  const [a, b] = [before.pose, after.pose];
  return {
    x: a.x + weight * (b.x - a.x),
    y: a.y + weight * (b.y - a.y),
    yaw: wrapped(a.yaw + weight * wrapped(b.yaw - a.yaw)),
  };
}
