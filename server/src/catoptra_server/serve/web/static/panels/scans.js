/** Range scanners and sonars of the selected robot in its own frame, forward up. */

import { clearedCanvas, onColourScheme, onResize } from "../canvas.js";
import { drawLabel, fillFaintly, robotOutline, setLine, tracePositions } from "../map_drawing.js";
import { bodyOf, drawOnDemand, LayerChoice, make, shorten } from "../panel.js";
import { numbersOf, readingKey } from "../readings.js";
import {
  classOf,
  degrees,
  hasEcho,
  rayEnd,
  scanRays,
  sizeOf,
  wrapped,
} from "../scan_geometry.js";

const RANGES_M = [1, 2, 3, 5, 7, 10, 15, 20];
const MAX_SCANNERS = 20;

/** Create the panel. */
export function create(section, context) {
  new ScanPanel(section, context);
}

class ScanPanel {
  #context;
  #canvas = make("canvas", { role: "img", ariaLabel: "Ranges around the robot, forward up" });
  #chosen = make("div", { className: "controls", role: "group", ariaLabel: "Sensors" });
  #summary = make("p", { className: "quiet" });
  /** All but the summary: hidden for a robot without range sensors. */
  #view = make("div");
  #choice;
  #listed = "";
  #redraw;

  constructor(section, context) {
    this.#context = context;
    this.#view.append(this.#chosen, make("div", { className: "figure scan" }, this.#canvas));
    bodyOf(section).append(this.#view, this.#summary);
    this.#redraw = drawOnDemand(section, () => this.#draw());
    this.#choice = new LayerChoice("catoptra.scans.hidden", this.#redraw);
    context.on("state", this.#redraw);
    onResize(this.#canvas, this.#redraw);
    onColourScheme(this.#redraw);
  }

  #draw() {
    const { state, server } = this.#context;
    const robot = state?.reply.robots.find(({ name }) => name === state.reply.robot);
    const sensors = (robot && classOf(server, robot.class_name)?.sensors) ?? [];
    const groups = groupsOf(sensors).slice(0, MAX_SCANNERS);
    this.#list(groups);
    this.#view.hidden = groups.length === 0;
    if (!groups.length) {
      this.#summary.textContent = "The selected robot has no range sensor.";
      return;
    }
    const shown = groups.filter(({ label }) => this.#choice.shows(label));
    const beams = shown.flatMap((group) => beamsOf(group, state.readings));
    const { pen, width, height } = clearedCanvas(this.#canvas);
    const extent_m = extentOf(beams);
    const view = fanView(width, height, extent_m);
    drawRings(pen, view, extent_m);
    for (const beam of beams) drawBeam(pen, view, beam);
    drawBody(pen, view, sizeOf(server, robot));
    this.#summary.textContent = summaryOf(shown, beams);
  }

  /** A box for each scanner and one for the sonars together; made anew for another robot. */
  #list(groups) {
    const signature = groups.map(({ label }) => label).join("\n");
    if (signature === this.#listed) return;
    this.#listed = signature;
    this.#chosen.replaceChildren(
      ...groups.map(({ label, type }) => this.#choice.makeBox(label, shorten(label, 24), type)),
    );
  }
}

/** Range scanners one by one, the sonars as one. */
function groupsOf(sensors) {
  const scanners = sensors.filter(({ type }) => type === "RangeScanner");
  const sonars = sensors.filter(({ type }) => type === "Sonar");
  const groups = scanners.map((sensor) => ({
    type: "scan",
    label: sensor.name,
    sensors: [sensor],
  }));
  if (sonars.length) groups.push({ type: "sonar", label: "Sonars", sensors: sonars });
  return groups;
}

/** What a group reports: fans of rays, and cones. */
function beamsOf({ type, sensors }, readings) {
  if (type === "scan") {
    const reading = readings.get(readingKey("RangeScanner", sensors[0].name));
    return reading ? [{ type, sensor: sensors[0], rays: scanRays(reading, sensors[0]) }] : [];
  }
  const parts = readings.get(readingKey("Sonar", ""))?.parts ?? [];
  const ranges = new Map(parts.map(({ name, value }) => [name, numbersOf(value)[0]]));
  return sensors
    .filter(({ name }) => Number.isFinite(ranges.get(name)))
    .map((sensor) => {
      const range_m = ranges.get(sensor.name);
      const ray = { angle_rad: sensor.yaw_rad, range_m, has_echo: hasEcho(range_m, sensor) };
      return { type, sensor, rays: [ray] };
    });
}

/** A circle that shows nearly all echoes, so that one far corner does not shrink the rest. */
function extentOf(beams) {
  const echoes = beams.flatMap(({ sensor, rays }) =>
    rays.filter(({ has_echo }) => has_echo).map((ray) => distanceOf(sensor, ray)),
  );
  if (!echoes.length) return 5;
  echoes.sort((a, b) => a - b);
  const wanted_m = echoes[Math.floor(0.97 * (echoes.length - 1))] * 1.05;
  return RANGES_M.find((range) => range >= wanted_m) ?? RANGES_M.at(-1);
}

function distanceOf(sensor, { angle_rad, range_m }) {
  const { x, y } = rayEnd(sensor, angle_rad, range_m);
  return Math.hypot(x, y);
}

/** The robot's origin in the middle, x up. */
function fanView(width, height, extent_m) {
  const scale = (Math.min(width, height) / 2 - 14) / extent_m;
  return {
    scale,
    extent_m,
    toScreen: ({ x, y }) => [width / 2 + y * scale, height / 2 - x * scale],
  };
}

function drawRings(pen, view, extent_m) {
  const [left, top] = view.toScreen({ x: 0, y: 0 });
  for (const fraction of [0.25, 0.5, 0.75, 1]) {
    const radius = fraction * extent_m * view.scale;
    setLine(pen, "grid", 1);
    pen.beginPath();
    pen.arc(left, top, radius, 0, 2 * Math.PI);
    pen.stroke();
    if (fraction === 0.5 || fraction === 1)
      drawLabel(pen, `${fraction * extent_m} m`, left, top + radius, "muted", "center");
  }
  pen.beginPath();
  setLine(pen, "grid", 1);
  pen.moveTo(left, top - extent_m * view.scale);
  pen.lineTo(left, top + extent_m * view.scale);
  pen.moveTo(left - extent_m * view.scale, top);
  pen.lineTo(left + extent_m * view.scale, top);
  pen.stroke();
}

function drawBeam(pen, view, beam) {
  if (beam.type === "sonar") drawCone(pen, view, beam);
  else drawFan(pen, view, beam);
}

/** The free area as a fan, echoes as points; where there is none the edge is dashed. */
function drawFan(pen, view, { sensor, rays }) {
  // Without an echo to the edge of the figure: the true end is mostly far outside.
  const lengthOf = ({ has_echo, range_m }) =>
    has_echo ? range_m : Math.min(range_m, view.extent_m);
  const ends = rays.map((ray) => view.toScreen(rayEnd(sensor, ray.angle_rad, lengthOf(ray))));
  tracePositions(pen, [view.toScreen({ x: sensor.x_m, y: sensor.y_m }), ...ends]);
  pen.closePath();
  fillFaintly(pen, "scan", 0.12);
  setLine(pen, "scan", 1, [2, 5]);
  pen.beginPath();
  rays.forEach(({ has_echo }, index) => {
    const [left, top] = ends[index];
    if (has_echo) pen.fillRect(left - 1.25, top - 1.25, 2.5, 2.5);
    else if (index > 0 && !rays[index - 1].has_echo) pen.lineTo(left, top);
    else pen.moveTo(left, top);
  });
  pen.stroke();
}

/** The cone of a sonar with its echo as an arc; without one dashed, to the largest range. */
function drawCone(pen, view, { sensor, rays: [ray] }) {
  const [left, top] = view.toScreen({ x: sensor.x_m, y: sensor.y_m });
  const radius = ray.range_m * view.scale;
  const middle = ray.angle_rad - Math.PI / 2;
  const half = sensor.fov_rad / 2;
  pen.beginPath();
  pen.moveTo(left, top);
  pen.arc(left, top, radius, middle - half, middle + half);
  pen.closePath();
  setLine(pen, "sonar", 1, ray.has_echo ? [] : [3, 5]);
  if (!ray.has_echo) {
    pen.globalAlpha = 0.5;
    pen.stroke();
    pen.globalAlpha = 1;
    return;
  }
  fillFaintly(pen, "sonar", 0.16);
  setLine(pen, "sonar", 2);
  pen.beginPath();
  pen.arc(left, top, radius, middle - half, middle + half);
  pen.stroke();
}

function drawBody(pen, view, size_m) {
  setLine(pen, "true", 1.5);
  tracePositions(pen, robotOutline(size_m).map(view.toScreen));
  pen.closePath();
  pen.stroke();
}

/** The nearest echo, and how many rays have none. */
function summaryOf(groups, beams) {
  if (!groups.length) return "No range sensor is shown.";
  const rays = beams.flatMap(({ sensor, rays: all }) =>
    all.map((ray) => ({ ...ray, name: sensor.name })),
  );
  if (!rays.length) return "No reading yet.";
  const echoes = rays.filter(({ has_echo }) => has_echo);
  const without = `${rays.length - echoes.length} of ${rays.length} rays without an echo`;
  if (!echoes.length) return without;
  const nearest = echoes.reduce((a, b) => (b.range_m < a.range_m ? b : a));
  const angle_rad = wrapped(nearest.angle_rad);
  const side = angle_rad < 0 ? "left" : "right";
  const where = `${degrees(Math.abs(angle_rad))} to the ${side} (${shorten(nearest.name, 24)})`;
  return `Nearest: ${nearest.range_m.toFixed(2)} m, ${where}; ${without}`;
}
