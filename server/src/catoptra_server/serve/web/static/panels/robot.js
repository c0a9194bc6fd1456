/** The robots: which there are, spawning one's own, sharing its control, and the state of one. */

import { OwnRobot } from "../own_robot.js";
import { bodyOf, drawOnDemand } from "../panel.js";
import { RobotDetails } from "../robot_details.js";
import { RobotList } from "../robot_list.js";

/** Create the panel. */
export function create(section, context) {
  const parts = [new RobotList(context), new OwnRobot(context), new RobotDetails(context)];
  bodyOf(section).append(...parts.map(({ element }) => element));
  const draw = drawOnDemand(section, () => parts.forEach((part) => part.update()));
  for (const event of ["state", "selection", "connection"]) context.on(event, draw);
}
