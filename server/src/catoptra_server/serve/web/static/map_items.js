/** What lies on the map above the floor plan: start poses, landmarks, robots and their beliefs. */

import { beliefsOf } from "./beliefs.js";
import { drawMark, placeNames } from "./landmarks.js";
import * as draw from "./map_drawing.js";
import { shorten } from "./panel.js";
import { readingKey } from "./readings.js";
import {
  classOf,
  compose,
  odometryPose,
  planarPose,
  rayEnd,
  scanRays,
  sizeOf,
} from "./scan_geometry.js";

/** More names than these would cover each other and the map. */
const MAX_NAMED = 20;

export class MapItems {
  #context;
  #view;
  #choice;
  #paths;

  /** Draw by a PlanarView the layers of a LayerChoice, with the paths of the selected robot. */
  constructor(context, view, choice, paths) {
    this.#context = context;
    this.#view = view;
    this.#choice = choice;
    this.#paths = paths;
  }

  /** Draw robots, of which one or none is selected. */
  draw(pen, robots, robot) {
    const labels = this.#drawStarts(pen);
    if (this.#choice.shows("landmark")) labels.push(...this.#drawLandmarks(pen));
    pen.font = draw.FONT;
    placeNames(pen, labels, pen.canvas.clientWidth, (name, left, top, { colour }) =>
      draw.drawLabel(pen, name, left, top, colour),
    );
    for (const other of robots)
      if (other !== robot) this.#drawRobot(pen, other, "muted", robots.length <= MAX_NAMED);
    if (robot) this.#drawSelected(pen, this.#context.state, robot);
  }

  #drawStarts(pen) {
    return this.#context.server.start_poses.slice(0, 200).map((start) => {
      draw.drawStart(pen, this.#view, start);
      const [x, y] = this.#view.toScreen(...start.location_m);
      return { name: shorten(start.name, 24), x, y, colour: "ink" };
    });
  }

  #drawLandmarks(pen) {
    const current = this.#context.landmarks;
    const landmarks = current?.length ? current : this.#context.server.landmarks;
    return landmarks.map(({ name, x_m, y_m, status }) => {
      const [x, y] = this.#view.toScreen(x_m, y_m);
      drawMark(pen, x, y, status ?? "hidden", 5);
      return { name: shorten(name, 24), x, y, colour: "muted" };
    });
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
    if (this.#choice.shows("scan")) draw.drawPoints(pen, view, this.#scanPoints(state, robot), "scan");
    if (this.#choice.shows("odometry")) {
      draw.drawPath(pen, view, this.#paths.odometry.points, "odometry", [6, 4]);
      const measured = odometryPose(state.readings, robot);
      const look = { isFilled: false, dash: [4, 3] };
      if (measured) draw.drawRobot(pen, view, measured, size, "odometry", look);
    }
    if (this.#choice.shows("true")) draw.drawPath(pen, view, this.#paths.true.points, "true");
    this.#drawRobot(pen, robot, "true", true);
    if (!this.#choice.shows("filter")) return;
    for (const path of this.#paths.filters.values())
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
      const pose = this.#paths.history.at(reading.time_s) ?? planarPose(robot.world_from_robot);
      for (const { angle_rad, range_m, has_echo } of scanRays(reading, sensor))
        if (has_echo) points.push(compose(pose, rayEnd(sensor, angle_rad, range_m)));
    }
    return points;
  }
}
