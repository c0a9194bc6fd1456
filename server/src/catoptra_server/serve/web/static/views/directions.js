/**
 * Directions that views draw, at the viewpoint and in the axes of the robot: landmarks and horizon
 * at the pose of the frame, the cursor, the perspective window. The frame's header says how the
 * mirror frame, in which the camera's model is, is turned to them.
 */

import { cameraFromWorld, NO_TURN, rotate, rotateBack, viewAxes } from "../transforms.js";

const STEPS_PER_SIDE = 16;

/** Pixel of a direction of any length; null where the camera shows nothing. */
export function pixelFromDirection({ mount, table }, direction) {
  return table.pixelFromDirection(rotateBack(mount, direction));
}

/** The same within the image; null outside. */
export function shownPixel(context, direction) {
  const pixel = pixelFromDirection(context, direction);
  return pixel && context.table.contains(pixel) ? pixel : null;
}

/** Unit direction of a pixel; null outside of what the camera shows, and without its model. */
export function directionFromPixel({ mount, table }, pixel) {
  const angles = table?.anglesFromPixel(pixel);
  return angles ? rotate(mount, directionFromAngles(angles)) : null;
}

/** Direction in which the present frame shows a point of the world. */
export function directionFromWorld({ frame, mount, table }, point) {
  const inMirror = cameraFromWorld(frame.header, point);
  return rotate(mount, table?.directionFromPoint(inMirror) ?? inMirror);
}

/**
 * Landmarks, {name, status, direction}, as the present frame shows them: the positions of the reply
 * are older than the frame.
 */
export function landmarkDirections(context) {
  const header = context.frame?.header;
  if (!header?.world_from_robot || !header.robot_from_mirror) return [];
  return context.landmarks
    .filter(({ pixel }) => pixel !== null)
    .map(({ name, status, x_m, y_m, z_m }) => ({
      name,
      status,
      direction: directionFromWorld(context, [x_m, y_m, z_m]),
    }));
}

/** Places of landmarks in a view, for drawLandmarks; `project` gives null outside the view. */
export function landmarkPlaces(context, project) {
  return landmarkDirections(context).flatMap(({ name, status, direction }) => {
    const position = project(direction);
    return position ? [{ x: position[0], y: position[1], name, status }] : [];
  });
}

/** Directions along the border of the perspective view, closed. */
export function windowOutline({ yaw_rad, pitch_rad, fov_rad, aspect }) {
  const { forward, right, down } = viewAxes(yaw_rad, pitch_rad);
  const halfWidth = Math.tan(0.5 * fov_rad);
  const halfHeight = halfWidth / aspect;
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]];
  const directions = [];
  corners.forEach(([x, y], i) => {
    const [nextX, nextY] = corners[(i + 1) % 4];
    for (let step = 0; step < STEPS_PER_SIDE; step += 1) {
      const part = step / STEPS_PER_SIDE;
      const across = halfWidth * (x + part * (nextX - x));
      const along = halfHeight * (y + part * (nextY - y));
      directions.push(forward.map((value, k) => value + across * right[k] + along * down[k]));
    }
  });
  directions.push(directions[0]);
  return directions;
}

/** Unit direction of the cursor; null without one on what the camera shows. */
export function cursorDirection(context) {
  const { pixel } = context.cursor;
  return pixel && directionFromPixel(context, pixel);
}

/** Unit direction in the mirror frame of incidence angle and azimuth. */
export function directionFromAngles({ theta_rad, azimuth_rad }) {
  const sine = Math.sin(theta_rad);
  return [sine * Math.cos(azimuth_rad), sine * Math.sin(azimuth_rad), Math.cos(theta_rad)];
}

/** The horizon of the world in steps of two degrees, from behind by the left to behind again. */
export function horizonDirections({ frame }) {
  const rotation = frame?.header.world_from_robot?.rotation ?? NO_TURN;
  const yaw_rad = Math.atan2(rotation[3], rotation[0]);
  return Array.from({ length: 181 }, (_, i) => {
    const azimuth_rad = yaw_rad + ((i - 90) * Math.PI) / 90;
    return rotateBack(rotation, [Math.cos(azimuth_rad), Math.sin(azimuth_rad), 0]);
  });
}

/** Yaw and pitch of a perspective view whose centre has this direction. */
export function aimFromDirection([x, y, z]) {
  return { yaw_rad: Math.atan2(y, x), pitch_rad: Math.atan2(-z, Math.hypot(x, y)) };
}

/** Why a view has no picture; "" if it has one. */
export function reasonForNoPicture(context) {
  if (context.state !== null && context.state.reply.robots.length === 0) {
    return "There is no robot: spawn one under Robots.";
  }
  if (context.state !== null && !context.selected.camera) return "This robot has no camera.";
  return context.frame === null ? "Waiting for the first picture." : "";
}

/** Why an unwarped view has no picture; "" if it has one. */
export function reasonForNoUnwarping(context) {
  const reason = reasonForNoPicture(context);
  if (reason) return reason;
  if (context.camera?.kind !== "omni") return "This picture needs no unwarping.";
  if (context.unwarper.fault) {
    return `Unwarping needs WebGL2: ${context.unwarper.fault}. Update the browser, or allow ` +
      "hardware or software 3D graphics in its settings.";
  }
  return context.unwarper.isReady ? "" : "Waiting for the camera's model.";
}
