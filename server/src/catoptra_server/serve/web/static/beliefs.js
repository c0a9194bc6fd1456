/**
 * What clients publish about a robot, checked: a note is any JSON object, and only keys of the
 * right form are drawn (pose, covariance, detections, text).
 */

const MAX_NOTES = 8;
const MAX_DETECTIONS = 100;
const MAX_TEXT = 2000;

const isNumbers = (value, length) =>
  Array.isArray(value) && value.length === length && value.every(Number.isFinite);

/**
 * The notes of a state as beliefs: name; time_s of its arrival; pose {x, y, yaw} in the world frame
 * or null; covariance, 3 x 3 rows of x, y, yaw, or null; detections; text.
 */
export function beliefsOf({ reply, notes }) {
  const times = new Map(reply.notes.map((note) => [note.name, note.time_s]));
  return [...notes].slice(0, MAX_NOTES).map(([name, note]) => belief(name, note, times.get(name)));
}

function belief(name, note, time_s) {
  const pose = isNumbers(note?.pose, 3) ? note.pose : null;
  return {
    name,
    time_s: time_s ?? null,
    pose: pose && { x: pose[0], y: pose[1], yaw: pose[2] },
    covariance: isNumbers(note?.covariance, 9) ? note.covariance : null,
    detections: Array.isArray(note?.detections)
      ? note.detections.slice(0, MAX_DETECTIONS).filter(isDetection).map(detection)
      : [],
    text: typeof note?.text === "string" ? note.text.slice(0, MAX_TEXT) : "",
  };
}

const isDetection = (value) => Number.isFinite(value?.bearing_rad);

const detection = (value) => ({
  landmark: String(value.landmark ?? ""),
  bearing_rad: value.bearing_rad,
  range_m: Number.isFinite(value.range_m) ? value.range_m : null,
  accepted: value.accepted !== false,
});

/**
 * The 2-sigma ellipse of the position: semi-axes in metres and the direction of the longer one;
 * null for a matrix that is no covariance.
 */
export function positionEllipse(covariance) {
  const [xx, xy, yy] = [covariance[0], (covariance[1] + covariance[3]) / 2, covariance[4]];
  const mean = (xx + yy) / 2;
  const difference = Math.hypot((xx - yy) / 2, xy);
  // Rounding may leave the smaller eigenvalue of a degenerate covariance just below 0.
  if (!(mean >= 0) || mean - difference < -1e-9 * mean) return null;
  return {
    major_m: 2 * Math.sqrt(mean + difference),
    minor_m: 2 * Math.sqrt(Math.max(0, mean - difference)),
    angle_rad: 0.5 * Math.atan2(2 * xy, xx - yy),
  };
}
