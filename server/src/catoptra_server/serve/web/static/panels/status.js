/** The status line: what the picture shows, how old it is, and by which plan it was rendered. */

import { bodyOf, make, setText, shorten } from "../panel.js";

const FIELDS = [
  ["robot", "Robot"],
  ["camera", "Camera"],
  ["time", "Time"],
  ["rate", "Frames"],
  ["age", "Age"],
  ["bound", "Bound"],
  ["plan", "Plan"],
];

/** Create the panel. */
export function create(section, context) {
  const values = new Map();
  const list = make("dl", { className: "status" });
  for (const [id, label] of FIELDS) {
    const value = make("dd", { id: `status-${id}` }, "\u2013");
    values.set(id, value);
    list.append(make("div", { className: id }, make("dt", {}, label), value));
  }
  bodyOf(section).append(list);
  const update = () => {
    if (document.hidden) return;
    const texts = textsOf(context);
    for (const id in texts) setText(values.get(id), texts[id]);
    // Only the plan is longer than its place.
    values.get("plan").title = texts.plan;
  };
  // By time, not by frame: the age of a picture grows while none follows it.
  setInterval(update, 250);
  context.on("selection", update);
  context.on("connection", update);
}

function textsOf({ selected, frame, state, statistics, server }) {
  const header = frame?.header;
  const age_ms = header ? 1000 * header.age_s + performance.now() - frame.received_ms : null;
  const time_s = state?.reply.time_s ?? header?.time_s;
  return {
    robot: shorten(selected.robot || header?.robot || "none", 24),
    camera: shorten(selected.camera || header?.camera || "none", 32),
    time: time_s === undefined ? "\u2013" : `${time_s.toFixed(1)} s`,
    rate: statistics ? `${statistics.rate_hz.toFixed(0)} / s` : "\u2013",
    // Under lockstep the picture is up to date until time passes.
    age: age_ms === null || server.clock === "lockstep" ? "\u2013" : ageText(age_ms),
    bound: header?.error_bound_px == null ? "\u2013" : `${header.error_bound_px.toPrecision(3)} px`,
    plan: header?.plan ?? "\u2013",
  };
}

const ageText = (age_ms) =>
  age_ms < 1000 ? `${Math.round(age_ms)} ms` : `${(age_ms / 1000).toFixed(1)} s`;
