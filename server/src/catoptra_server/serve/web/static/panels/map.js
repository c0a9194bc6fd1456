/**
 * The map: floor plan, landmarks and robots from above, with the true, the measured and the
 * believed pose of the selected robot, and what its sensors report.
 */

import { clearedCanvas, onColourScheme, onResize } from "../canvas.js";
import { fetchJson } from "../connection.js";
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

/** Create the panel; the plan follows, so that the pictures do not wait for it. */
export function create(section, context) {
  const map = new MapPanel(section, context);
  fetchJson("/api/floor_plan.json").then(
    (plan) => map.setPlan(plan),
    (error) => context.report(error),
  );
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

  setPlan(plan) {
    this.#plan = plan;
    this.#redraw();
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

  #draw() {
    const { pen, width, height } = clearedCanvas(this.#canvas);
    this.#view.setSize(width, height);
    const state = this.#context.state;
    const robots = (state?.reply.robots ?? []).slice(0, MAX_ROBOTS);
    const robot = (state?.reply.robots ?? []).find(({ name }) => name === this.#paths.robot);
    if (!this.#isFitted)
      this.#view.fit(boundsOf(this.#plan, this.#context.server), this.#layers.clientHeight);
    if (robot && this.#isFollowing) {
      const { x, y } = planarPose(robot.world_from_robot);
      this.#view.centre = { x, y };
    }
    draw.drawGrid(pen, this.#view, width, height);
    draw.drawWalls(pen, this.#view, this.#plan.segments);
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
