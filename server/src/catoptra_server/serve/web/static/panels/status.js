/** The line of facts: what is shown, how often, how exact it is, what it costs, where the robot is. */

import { format } from "../bars.js";
import { beliefsOf } from "../beliefs.js";
import { bodyOf, make, setText, shorten } from "../panel.js";
import { robotOf } from "../scan_geometry.js";

const FACTS = ["robot", "rate", "bound", "cost", "age", "belief"];

/** Create the panel. */
export function create(section, context) {
  const items = FACTS.map((id) => make("li", { id: `status-${id}`, className: id, hidden: true }));
  bodyOf(section).append(make("ul", { className: "status" }, ...items));
  const update = () => {
    if (document.hidden) return;
    const texts = textsOf(context);
    FACTS.forEach((id, i) => {
      setText(items[i], texts[id]);
      items[i].hidden = texts[id] === "";
    });
  };
  // By time, not by frame: the age of a picture grows while none follows it.
  setInterval(update, 500);
  context.on("selection", update);
  context.on("connection", update);
}

function textsOf(context) {
  const { selected, frame, statistics, server } = context;
  const header = frame?.header;
  const robot = selected.robot || header?.robot;
  const bound_px = header?.error_bound_px ?? null;
  const age_ms = header ? 1000 * header.age_s + performance.now() - frame.received_ms : null;
  return {
    robot: robot ? `Robot ${shorten(robot, 24)}` : "No robot",
    rate: header ? `${statistics.rate_hz.toFixed(0)} pictures/s` : "",
    bound: bound_px === null ? "" : `off by at most ${format(Number(bound_px.toPrecision(2)))} px`,
    cost: header ? `${format(Number(durationOf(header).toPrecision(2)))} ms a picture` : "",
    // Under lockstep the picture is up to date until time passes.
    age: age_ms === null || server.clock === "lockstep" ? "" : ageText(age_ms),
    belief: beliefText(context),
  };
}

/** Milliseconds of all stages of a frame. */
export const durationOf = ({ stage_ms }) =>
  Object.values(stage_ms).reduce((sum, ms) => sum + ms, 0);

const ageText = (age_ms) =>
  age_ms < 1000 ? `${Math.round(age_ms)} ms old` : `${(age_ms / 1000).toFixed(1)} s old`;

/** Distance of the first published pose from the true one. */
function beliefText(context) {
  const robot = robotOf(context, context.selected.robot);
  const belief = robot && beliefsOf(context.state).find(({ pose }) => pose !== null);
  if (!belief) return "";
  const [x, y] = robot.world_from_robot.position_m;
  const distance_m = Math.hypot(belief.pose.x - x, belief.pose.y - y);
  return distance_m < 1
    ? `localized to ${Math.ceil(100 * distance_m)} cm`
    : `believes to be ${distance_m.toFixed(1)} m away`;
}
