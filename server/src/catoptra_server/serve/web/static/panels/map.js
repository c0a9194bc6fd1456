/**
 * The map: floor plan, landmarks and robots from above, with the true, the measured and the
 * believed pose of the selected robot, and what its sensors report.
 */

import { clearedCanvas, onColourScheme, onResize } from "../canvas.js";
import { DECODING, fetchJson } from "../connection.js";
import { makeLegend } from "../landmarks.js";
import * as draw from "../map_drawing.js";
import { MapItems } from "../map_items.js";
import {
  bodyOf,
  drawOnDemand,
  isOpen,
  LayerChoice,
  make,
  makeButton,
  remember,
  remembered,
  toolsOf,
} from "../panel.js";
import { PlanarView } from "../planar_view.js";
import { RobotPaths } from "../robot_paths.js";
import { DEFAULT_SIZE_M, planarPose } from "../scan_geometry.js";

const LAYERS = [
  { id: "true", label: "True", title: "True path and pose" },
  { id: "odometry", label: "Odometry", title: "Path and pose by the robot's odometry" },
  { id: "filter", label: "Filter", title: "Path, pose and 2-sigma ellipse that clients publish" },
  { id: "scan", label: "Scan", title: "Echoes of the range scanners" },
  { id: "landmark", label: "Landmarks", title: "Landmarks by their status" },
];
const MAX_ROBOTS = 200;

/** Create the panel. */
export function create(section, context) {
  new MapPanel(section, context);
}

class MapPanel {
  #section;
  #context;
  #canvas;
  #view;
  #redraw;
  #plans = new Map();
  #isFitted = false;
  #choice;
  #followButton;
  #layers;
  #items;
  #paths = new RobotPaths();
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
    this.#items = new MapItems(context, this.#view, this.#choice, this.#paths);
    bodyOf(section).append(this.#canvas, this.#layers);
    toolsOf(section).append(...this.#tools());
    onResize(this.#canvas, this.#redraw);
    onColourScheme(this.#redraw);
    // Also while the panel is hidden; a few numbers each time.
    context.on("state", (state) => {
      this.#paths.add(state);
      this.#redraw();
    });
    context.on("landmarks", this.#redraw);
    context.on("place", ({ active }) => this.#startPlacing(active));
    addEventListener("keydown", ({ key }) => {
      if (key === "Escape" && this.#isPlacing) this.#startPlacing(false);
    });
  }

  /** Plan for a class, requested once. */
  #planOf(name) {
    if (name && !this.#plans.has(name))
      this.#load(name).catch((error) => this.#context.report(error));
    return this.#plans.get(name);
  }

  async #load(name) {
    this.#plans.set(name, undefined);
    const plan = await fetchJson(`/api/floor_plan.json?class=${encodeURIComponent(name)}`);
    const bytes = Uint8Array.from(atob(plan.picture), (c) => c.charCodeAt(0));
    plan.image = await createImageBitmap(new Blob([bytes]), DECODING);
    this.#plans.set(name, plan);
    this.#redraw();
    const group = this.#layers.lastChild;
    if (group.querySelector("i")) return;
    for (const [text, rgb] of Object.entries(plan.colours))
      group.append(make("i", { style: `background: rgb(${rgb})` }), text);
  }

  #tools() {
    const tool = (text, title, action) =>
      makeButton(text, action, { className: "button small", ariaLabel: title, title });
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
    this.#choice = new LayerChoice("catoptra.map.hidden", this.#redraw);
    const items = LAYERS.map(({ id, label, title }) =>
      this.#choice.makeBox(id, label, id, { title }),
    );
    const group = make("div", { role: "group", ariaLabel: "Layers" }, ...items, makeLegend());
    return make("details", { className: "layers" }, make("summary", {}, "Layers"), group);
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

  #draw() {
    const { pen, width, height } = clearedCanvas(this.#canvas);
    this.#view.setSize(width, height);
    const state = this.#context.state;
    const robots = (state?.reply.robots ?? []).slice(0, MAX_ROBOTS);
    const robot = (state?.reply.robots ?? []).find(({ name }) => name === this.#paths.robot);
    const { server } = this.#context;
    const plan = this.#planOf(robot?.class_name ?? server.classes[0]?.class_name);
    if (!this.#isFitted) this.#view.fit(plan?.bounds ?? [-5, -5, 5, 5], this.#layers.clientHeight);
    if (robot && this.#isFollowing) {
      const { x, y } = planarPose(robot.world_from_robot);
      this.#view.centre = { x, y };
    }
    if (plan) draw.drawPlan(pen, this.#view, plan);
    draw.drawGrid(pen, this.#view, width, height);
    this.#items.draw(pen, robots, robot);
    if (this.#isPlacing) this.#drawPlacing(pen, width);
    draw.drawAxes(pen, 14, 42);
    draw.drawScale(pen, this.#view, width - 10, 24);
  }

  #drawPlacing(pen, width) {
    const hint = "Press for the position, drag for the heading, Esc to cancel";
    draw.drawLabel(pen, hint, width / 2, 56, "ink", "center");
    if (this.#placed) draw.drawRobot(pen, this.#view, this.#placed, DEFAULT_SIZE_M, "accent");
  }
}
