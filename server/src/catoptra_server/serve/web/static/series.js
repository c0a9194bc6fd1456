/**
 * Numbers over time of the selected robot: every numeric reading, its pose, and the errors of
 * odometry and beliefs, in bounded memory.
 */

import { beliefsOf } from "./beliefs.js";
import { numbersOf } from "./readings.js";
import { PoseHistory, odometryPose, planarPose, wrapped } from "./scan_geometry.js";

/** Two minutes at 10 states a second. */
const CAPACITY = 1250;
const MAX_SERIES = 200;
const inUnit = (unit, ...names) => names.map((name) => [name, unit]);
const WHEELS = ["front right", "front left", "back right", "back left"];
/** Names and units of the numbers of known fields; others are numbered. */
const FIELDS = {
  "odometry.pose": [...inUnit("m", "x", "y"), ["yaw", "rad"]],
  location: inUnit("m", "x", "y", "z"),
  orientation: inUnit("rad", "roll", "pitch", "yaw"),
  "tachometer.vel": inUnit("rad/s", ...WHEELS.map((wheel) => `speed ${wheel}`)),
  "tachometer.pos": inUnit("rad", ...WHEELS.map((wheel) => `angle ${wheel}`)),
  battery: inUnit("s", "battery"),
};
const PART_UNITS = { Range: "m", Tick: "ticks" };
const SKIPPED = new Set(["type", "name", "time", "resolution", "fov", "view", "id"]);

/** Numbers of a reading with their labels and units. */
function seriesOfReading(reading) {
  const prefix = reading.word === "STA" ? "Status" : reading.name || reading.type;
  const series = reading.parts.map(({ name, quantity, value }) => ({
    group: reading.type,
    label: `${name} ${quantity.toLowerCase()}`,
    unit: PART_UNITS[quantity] ?? "",
    value: numbersOf(value)[0],
  }));
  for (const [field, text] of reading.fields) {
    if (SKIPPED.has(field)) continue;
    const numbers = numbersOf(text);
    if (reading.type === "RangeScanner" && field === "range") {
      const value = numbers.length ? Math.min(...numbers) : undefined;
      series.push({ group: prefix, label: `${prefix} nearest`, unit: "m", value });
    } else if (numbers.length <= 6) {
      series.push(...fieldSeries(reading, prefix, field, numbers));
    }
  }
  return series.filter(({ value }) => Number.isFinite(value));
}

function fieldSeries(reading, prefix, field, numbers) {
  const known = FIELDS[`${reading.type.toLowerCase()}.${field}`] ?? FIELDS[field];
  return numbers.map((value, index) => {
    const [name, unit] = known?.[index] ?? [numbers.length > 1 ? `${index + 1}` : "", ""];
    const words = [prefix, known ? "" : field, name];
    return { group: prefix, label: words.filter(Boolean).join(" "), unit, value };
  });
}

/** Distance and angle between two poses. */
function errorSeries(group, pose, truth) {
  const distance_m = Math.hypot(pose.x - truth.x, pose.y - truth.y);
  const angle_rad = Math.abs(wrapped(pose.yaw - truth.yaw));
  return [
    { group, label: `${group} position`, unit: "m", value: distance_m },
    { group, label: `${group} yaw`, unit: "rad", value: angle_rad },
  ];
}

/** The series of the newest two minutes; times are shared, a missing value is NaN. */
export class SeriesStore {
  times = new Float64Array(CAPACITY);
  /** Number of samples taken; the newest is at index (count - 1) % CAPACITY. */
  count = 0;
  /** Series by label: {label, group, unit, values}. */
  series = new Map();
  #robot = "";
  #history = new PoseHistory();

  /** Add the values of a state, unless no time has passed. */
  add(state) {
    const { reply } = state;
    const robot = reply.robots.find(({ name }) => name === reply.robot);
    if (reply.robot !== this.#robot || reply.time_s < this.newest_s) this.#clear(reply.robot);
    if (!robot || reply.time_s === this.newest_s) return;
    const index = this.count % CAPACITY;
    this.times[index] = reply.time_s;
    this.count += 1;
    for (const { values } of this.series.values()) values[index] = NaN;
    for (const sample of this.#samples(state, robot)) this.#set(index, sample);
  }

  /** Time of the newest sample; minus infinity without one. */
  get newest_s() {
    return this.count ? this.times[(this.count - 1) % CAPACITY] : -Infinity;
  }

  #clear(robot) {
    this.#robot = robot;
    this.count = 0;
    this.series.clear();
    this.#history.clear();
  }

  #samples(state, robot) {
    const truth = planarPose(robot.world_from_robot);
    const [left, right] = robot.wheel_speeds_rad_s;
    this.#history.add(state.reply.time_s, truth);
    const samples = [
      { group: "True pose", label: "True x", unit: "m", value: truth.x },
      { group: "True pose", label: "True y", unit: "m", value: truth.y },
      { group: "True pose", label: "True yaw", unit: "rad", value: truth.yaw },
      { group: "Wheels", label: "Left wheels", unit: "rad/s", value: left },
      { group: "Wheels", label: "Right wheels", unit: "rad/s", value: right },
    ];
    const measured = odometryPose(state.readings, robot);
    if (measured) {
      // Odometry has no time of its own; the status of the same cycle has.
      const status = [...state.readings.values()].find(({ word }) => word === "STA");
      const then = (status && this.#history.at(status.time_s)) ?? truth;
      samples.push(...errorSeries("Odometry error", measured, then));
    }
    for (const belief of beliefsOf(state)) samples.push(...this.#beliefSamples(belief));
    return [...samples, ...[...state.readings.values()].flatMap(seriesOfReading)];
  }

  /** Error against the truth at the time of the note, and the deviation it claims. */
  #beliefSamples({ name, time_s, pose, covariance }) {
    const truth = pose && this.#history.at(time_s);
    if (!truth) return [];
    const group = `${name.slice(0, 30)} error`;
    const samples = errorSeries(group, pose, truth);
    if (covariance) {
      const variance = covariance[0] + covariance[4];
      const value = 2 * Math.sqrt(Math.max(0, variance));
      samples.push({ group, label: `${group} position, 2 sigma`, unit: "m", value });
    }
    return samples;
  }

  #set(index, { label, group, unit, value }) {
    if (!this.series.has(label)) {
      if (this.series.size >= MAX_SERIES) return;
      const values = new Float64Array(CAPACITY).fill(NaN);
      this.series.set(label, { label, group, unit, values });
    }
    this.series.get(label).values[index] = value;
  }

  /** Times and values of the newest seconds, oldest first, null where there is none. */
  window(labels, duration_s) {
    const first = Math.max(0, this.count - CAPACITY);
    const indices = [];
    for (let sample = first; sample < this.count; sample += 1) {
      const index = sample % CAPACITY;
      if (this.times[index] >= this.newest_s - duration_s) indices.push(index);
    }
    const columns = labels.map((label) => {
      const values = this.series.get(label)?.values;
      return indices.map((index) => (Number.isFinite(values?.[index]) ? values[index] : null));
    });
    return [indices.map((index) => this.times[index]), ...columns];
  }
}
