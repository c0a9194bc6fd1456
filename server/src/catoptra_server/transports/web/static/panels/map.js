/**
 * The map: floor plan, landmarks and robots from above, with the true, the measured and the
 * believed pose of the selected robot, and what its sensors report.
 */

import { beliefsOf } from "../beliefs.js";
import { clearedCanvas, onColourScheme, onResize } from "../canvas.js";
import { drawMark } from "../landmarks.js";
import * as draw from "../map_drawing.js";
import {
  bodyOf,
  drawOnDemand,
  isOpen,
  make,
  remember,
  remembered,
  shorten,
  toolsOf,
} from "../panel.js";
import { Path } from "../path.js";
import { PlanarView } from "../planar_view.js";
import { readingKey } from "../readings.js";
import {
  DEFAULT_SIZE_M,
  PoseHistory,
  classOf,
  compose,
  odometryPose,
  planarPose,
  rayEnd,
  scanRays,
  sizeOf,
} from "../scan_geometry.js";

const LAYERS = [
  { id: "true", label: "True", title: "True path and pose" },
  { id: "odometry", label: "Odometry", title: "Path and pose by the robot's odometry" },
  { id: "filter", label: "Filter", title: "Path, pose and 2-sigma ellipse that clients publish" },
  { id: "scan", label: "Scan", title: "Echoes of the range scanners" },
  { id: "landmark", label: "Landmarks", title: "Landmarks by their status" },
];
const MAX_ROBOTS = 200;
/** More names than these would cover each other and the map. */
const MAX_NAMED = 20;

/** Create the panel; the plan follows, so that the pictures do not wait for it. */
export function create(section, context) {
  const map = new MapPanel(section, context);
  fetchPlan().then((plan) => map.setPlan(plan), (error) => context.report(error));
}

async function fetchPlan() {
  const reply = await fetch("/api/floor_plan.json");
  if (!reply.ok) throw new Error(`floor plan: ${reply.status} ${reply.statusText}`);
  return reply.json();
}

/** Extent of the plan, or of start poses and landmarks where the plan is empty. */
function boundsOf({ segments, bounds }, { start_poses, landmarks }) {
  if (segments.length) return bounds;
  const points = [
    ...start_poses.map(({ location_m }) => location_m),
    ...landmarks.map(({ x_m, y_m }) => [x_m, y_m]),
    [0, 0],
  ];
  const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
  const margin = 2;
  return [
    Math.min(...xs) - margin,
    Math.min(...ys) - margin,
    Math.max(...xs) + margin,
    Math.max(...ys) + margin,
  ];
}

class MapPanel {
  #section;
  #context;
  #canvas;
  #view;
  #redraw;
  #plan = { segments: [] };
  #isFitted = false;
  #hidden = new Set(remembered("catoptra.map.hidden", []));
  #followButton;
  #layers;
  #robot = "";
  #history = new PoseHistory();
  #truePath = new Path();
  #odometryPath = new Path();
  #filterPaths = new Map();
  #placed = null;
  #isPlacing = false;

  constructor(section, context) {
    this.#section = section;
    this.#context = context;
    this.#canvas = make("canvas", {
      role: "img",
      ariaLabel: "Map. Arrow keys move it, plus and minus zoom.",
    });
    this.#view = new PlanarView(this.#canvas, (isPan) => this.#viewChanged(isPan));
    this.#redraw = drawOnDemand(section, () => this.#draw());
    this.#layers = this.#layerChoice();
    bodyOf(section).append(this.#canvas, this.#layers);
    toolsOf(section).append(...this.#tools());
    onResize(this.#canvas, this.#redraw);
    onColourScheme(this.#redraw);
    context.on("state", (state) => this.#update(state));
    context.on("landmarks", this.#redraw);
    context.on("place", ({ active }) => this.#startPlacing(active));
    addEventListener("keydown", ({ key }) => {
      if (key === "Escape" && this.#isPlacing) this.#startPlacing(false);
    });
  }

  setPlan(plan) {
    this.#plan = plan;
    this.#redraw();
  }

  #tools() {
    const tool = (text, label, onclick) =>
      make(
        "button",
        { type: "button", className: "button small", ariaLabel: label, title: label, onclick },
        text,
      );
    const follow = "Follow the robot: keep it in the middle";
    this.#followButton = tool("Follow", follow, () => this.#toggleFollow());
    this.#setFollow(remembered("catoptra.map.follow", false));
    return [
      tool("\u2212", "Zoom out", () => this.#view.zoom(0.8)),
      tool("+", "Zoom in", () => this.#view.zoom(1.25)),
      tool("Fit", "Fit: show the whole map", () => this.#fit()),
      this.#followButton,
    ];
  }

  #layerChoice() {
    const items = LAYERS.map(({ id, label, title }) => {
      const box = make("input", { type: "checkbox", checked: !this.#hidden.has(id) });
      box.addEventListener("change", () => {
        if (box.checked) this.#hidden.delete(id);
        else this.#hidden.add(id);
        remember("catoptra.map.hidden", [...this.#hidden]);
        this.#redraw();
      });
      return make("label", { className: `layer ${id}`, title }, box, label);
    });
    return make("div", { className: "layers", role: "group", ariaLabel: "Layers" }, ...items);
  }

  get #isFollowing() {
    return this.#followButton.getAttribute("aria-pressed") === "true";
  }

  #setFollow(follow) {
    this.#followButton.setAttribute("aria-pressed", String(follow));
    remember("catoptra.map.follow", follow);
  }

  #toggleFollow() {
    this.#setFollow(!this.#isFollowing);
    this.#redraw();
  }

  #viewChanged(isPan) {
    this.#isFitted = true;
    if (isPan && this.#isFollowing) this.#setFollow(false);
    this.#redraw();
  }

  #fit() {
    this.#setFollow(false);
    this.#isFitted = false;
    this.#redraw();
  }

  /** Let the next press on the map place a robot; Escape leaves that to another time. */
  #startPlacing(active) {
    this.#placed = null;
    this.#isPlacing = active;
    const handler = (pose, isFinal) => {
      this.#placed = isFinal ? null : pose;
      this.#isPlacing = !isFinal;
      this.#redraw();
      if (isFinal)
        this.#context.emit("placed", { x_m: pose.x, y_m: pose.y, yaw_rad: pose.yaw });
    };
    this.#view.setPlacing(active ? handler : null);
    if (active) this.#reveal();
    this.#redraw();
  }

  /** Expand the panel and scroll to it. */
  #reveal() {
    if (!isOpen(this.#section)) this.#section.querySelector(".toggle").click();
    this.#section.scrollIntoView({ block: "nearest" });
  }

  /** Record paths, also while the panel is hidden; a few numbers each time. */
  #update(state) {
    const robot = state.reply.robots.find(({ name }) => name === state.reply.robot);
    if (state.reply.robot !== this.#robot) this.#restart(state.reply.robot);
    if (robot) {
      const pose = planarPose(robot.world_from_robot);
      this.#history.add(state.reply.time_s, pose);
      this.#truePath.add(pose);
      const measured = odometryPose(state.readings, robot);
      if (measured) this.#odometryPath.add(measured);
      for (const { name, pose: believed } of beliefsOf(state))
        if (believed) this.#filterPath(name).add(believed);
    }
    this.#redraw();
  }

  #restart(name) {
    this.#robot = name;
    this.#history.clear();
    this.#truePath = new Path();
    this.#odometryPath = new Path();
    this.#filterPaths.clear();
  }

  #filterPath(name) {
    // Names are the choice of a client: one that changes them must not fill the memory.
    if (!this.#filterPaths.has(name) && this.#filterPaths.size >= 8) this.#filterPaths.clear();
    if (!this.#filterPaths.has(name)) this.#filterPaths.set(name, new Path());
    return this.#filterPaths.get(name);
  }

  #draw() {
    const { pen, width, height } = clearedCanvas(this.#canvas);
    this.#view.setSize(width, height);
    const state = this.#context.state;
    const robots = (state?.reply.robots ?? []).slice(0, MAX_ROBOTS);
    const robot = (state?.reply.robots ?? []).find(({ name }) => name === this.#robot);
    if (!this.#isFitted)
      this.#view.fit(boundsOf(this.#plan, this.#context.server), this.#layers.clientHeight);
    if (robot && this.#isFollowing) {
      const { x, y } = planarPose(robot.world_from_robot);
      this.#view.centre = { x, y };
    }
    draw.drawGrid(pen, this.#view, width, height);
    draw.drawWalls(pen, this.#view, this.#plan.segments);
    this.#drawStarts(pen);
    if (this.#shows("landmark")) this.#drawLandmarks(pen);
    for (const other of robots)
      if (other !== robot) this.#drawRobot(pen, other, "muted", robots.length <= MAX_NAMED);
    if (robot) this.#drawSelected(pen, state, robot);
    if (this.#isPlacing) this.#drawPlacing(pen, width);
    draw.drawAxes(pen, 14, 42);
    draw.drawScale(pen, this.#view, width - 10, 24);
  }

  #shows = (layer) => !this.#hidden.has(layer);

  #drawStarts(pen) {
    for (const start of this.#context.server.start_poses.slice(0, 200)) {
      draw.drawStart(pen, this.#view, start);
      if (this.#view.scale < 45) continue;
      const [left, top] = this.#view.toScreen(...start.location_m);
      draw.drawLabel(pen, shorten(start.name, 24), left + 8, top + 8, "muted");
    }
  }

  #drawLandmarks(pen) {
    const current = this.#context.landmarks;
    const landmarks = current?.length ? current : this.#context.server.landmarks;
    for (const { name, x_m, y_m, status } of landmarks) {
      const [left, top] = this.#view.toScreen(x_m, y_m);
      drawMark(pen, left, top, status ?? "hidden", 5);
      if (this.#view.scale > 90) draw.drawLabel(pen, shorten(name, 24), left + 9, top, "muted");
    }
  }

  #drawRobot(pen, robot, name, isNamed) {
    const pose = planarPose(robot.world_from_robot);
    const size = sizeOf(this.#context.server, robot);
    draw.drawRobot(pen, this.#view, pose, size, name);
    if (!isNamed) return;
    const [left, top] = this.#view.toScreen(pose.x, pose.y);
    const above = (size[0] / 2) * this.#view.scale + 12;
    draw.drawLabel(pen, shorten(robot.name, 24), left, top - above, name, "center");
  }

  #drawSelected(pen, state, robot) {
    const view = this.#view;
    const size = sizeOf(this.#context.server, robot);
    const beliefs = beliefsOf(state);
    if (this.#shows("scan")) draw.drawPoints(pen, view, this.#scanPoints(state, robot), "scan");
    if (this.#shows("odometry")) {
      draw.drawPath(pen, view, this.#odometryPath.points, "odometry", [6, 4]);
      const measured = odometryPose(state.readings, robot);
      const look = { isFilled: false, dash: [4, 3] };
      if (measured) draw.drawRobot(pen, view, measured, size, "odometry", look);
    }
    if (this.#shows("true")) draw.drawPath(pen, view, this.#truePath.points, "true");
    this.#drawRobot(pen, robot, "true", true);
    if (!this.#shows("filter")) return;
    for (const path of this.#filterPaths.values())
      draw.drawPath(pen, view, path.points, "filter", [2, 3]);
    for (const belief of beliefs) {
      const from = belief.pose ?? planarPose(robot.world_from_robot);
      for (const detection of belief.detections) draw.drawDetection(pen, view, from, detection);
      if (belief.pose) draw.drawBelief(pen, view, belief);
    }
  }

  /** Echoes of all scanners in the world, each from the pose at the time of its scan. */
  #scanPoints({ readings }, robot) {
    const sensors = classOf(this.#context.server, robot.class_name)?.sensors ?? [];
    const points = [];
    for (const sensor of sensors) {
      const reading = readings.get(readingKey("RangeScanner", sensor.name));
      if (sensor.type !== "RangeScanner" || !reading) continue;
      const pose = this.#history.at(reading.time_s) ?? planarPose(robot.world_from_robot);
      for (const { angle_rad, range_m, has_echo } of scanRays(reading, sensor))
        if (has_echo)
          points.push(compose(pose, { ...rayEnd(sensor, angle_rad, range_m), yaw: 0 }));
    }
    return points;
  }

  #drawPlacing(pen, width) {
    const hint = "Press for the position, drag for the heading, Esc to cancel";
    draw.drawLabel(pen, hint, width / 2, 56, "ink", "center");
    if (this.#placed) draw.drawRobot(pen, this.#view, this.#placed, DEFAULT_SIZE_M, "accent");
  }
}
