/** Rigid transforms of the protocol, {position_m, rotation}: parent = R child + p. */

/** The rotation that changes nothing. */
export const NO_TURN = [1, 0, 0, 0, 1, 0, 0, 0, 1];

/** Rotation of the mirror frame on the robot that a header states; that of none without one. */
export const robotFromMirror = (header) => header?.robot_from_mirror?.rotation ?? NO_TURN;

/** R v of nine row-major numbers and a vector. */
export function rotate(rotation, [x, y, z]) {
  return [0, 3, 6].map((i) => rotation[i] * x + rotation[i + 1] * y + rotation[i + 2] * z);
}

/** Transposed R, the inverse of a rotation, times v. */
export function rotateBack(rotation, [x, y, z]) {
  return [0, 1, 2].map((i) => rotation[i] * x + rotation[i + 3] * y + rotation[i + 6] * z);
}

/** Point in the child frame of a point in the parent frame. */
function childFromParent({ position_m, rotation }, point) {
  return rotateBack(rotation, point.map((value, i) => value - position_m[i]));
}

/** Direction at the camera of a header, in the camera frame, to a point in the world frame. */
export function cameraFromWorld(header, point) {
  const inRobot = childFromParent(header.world_from_robot, point);
  return childFromParent(header.robot_from_mirror, inRobot);
}

/**
 * Axes (forward, right, down) of a view in those of the robot: yaw to the right, pitch up, as in
 * `PerspectiveGeometry` of catoptra_client.
 */
export function viewAxes(yaw_rad, pitch_rad) {
  const [cy, sy] = [Math.cos(yaw_rad), Math.sin(yaw_rad)];
  const [cp, sp] = [Math.cos(pitch_rad), Math.sin(pitch_rad)];
  return { forward: [cy * cp, sy * cp, -sp], right: [-sy, cy, 0], down: [cy * sp, sy * sp, cp] };
}
