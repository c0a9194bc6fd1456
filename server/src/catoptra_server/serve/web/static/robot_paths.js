/** Paths of the selected robot: true, by odometry, and believed by each client. */

import { beliefsOf } from "./beliefs.js";
import { Path } from "./path.js";
import { odometryPose, planarPose, PoseHistory } from "./scan_geometry.js";

export class RobotPaths {
  /** Name of the robot. */
  robot = "";
  history = new PoseHistory();
  true = new Path();
  odometry = new Path();
  /** By the name of the note. */
  filters = new Map();

  /** Add the poses of a state; another robot begins anew. */
  add({ reply, readings, notes }) {
    if (reply.robot !== this.robot) Object.assign(this, new RobotPaths(), { robot: reply.robot });
    const robot = reply.robots.find(({ name }) => name === reply.robot);
    if (!robot) return;
    const pose = planarPose(robot.world_from_robot);
    this.history.add(reply.time_s, pose);
    this.true.add(pose);
    const measured = odometryPose(readings, robot);
    if (measured) this.odometry.add(measured);
    for (const { name, pose: believed } of beliefsOf({ reply, notes }))
      if (believed) this.#filter(name).add(believed);
  }

  #filter(name) {
    // Names are the choice of a client: one that changes them must not fill the memory.
    if (!this.filters.has(name) && this.filters.size >= 8) this.filters.clear();
    if (!this.filters.has(name)) this.filters.set(name, new Path());
    return this.filters.get(name);
  }
}
