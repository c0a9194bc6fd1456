/**
 * The model of an omnidirectional camera as tables of the server (SPEC.md, chapter 10): the page
 * knows no formula of a mirror or a lens.
 */

import { fetchJson } from "./connection.js";

const STEEPEST_SLOPE = 1.2;
/** Tangential distortion is a hundredth of the radius at most: 3 to 6 steps of two digits each. */
const MAX_STEPS = 50;
const TOLERANCE_PX = 1e-7;
/** Cosine of the tilt up to which a camera's axis is the robot's vertical. */
const LEVEL = 1 - 1e-6;

/** Pixels of directions in the mirror frame, and directions of pixels. */
export class CameraTable {
  #inverse;

  /** Take the reply of /api/camera_table.json, and its fields. */
  constructor(json) {
    this.json = json;
    Object.assign(this, json);
    const [a, b, c, d] = json.azimuth_matrix;
    const determinant = a * d - b * c;
    this.#inverse = [d, -b, -c, a].map((value) => value / determinant);
  }

  /** Image radius of the rim. */
  get rim_radius_px() {
    return this.radius_px.at(-1);
  }

  /** Value at an incidence angle of a table, by linear interpolation. */
  #valueAt(values, theta_rad) {
    const last = values.length - 1;
    const position = (theta_rad / this.max_theta_rad) * last;
    const i = Math.min(Math.floor(position), last - 1);
    return values[i] + (position - i) * (values[i + 1] - values[i]);
  }

  /** Incidence angle of an image radius; that of the rim beyond. */
  #thetaFromRadius(radius_px) {
    const radii = this.radius_px;
    if (radius_px >= this.rim_radius_px) return this.max_theta_rad;
    let [low, high] = [0, radii.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (radii[middle] <= radius_px) low = middle;
      else high = middle;
    }
    const fraction = (radius_px - radii[low]) / (radii[high] - radii[low]);
    return ((low + fraction) / (radii.length - 1)) * this.max_theta_rad;
  }

  /** Displacement [u, v] by the tangential distortion of a decentred lens. */
  #decentring(theta_rad, x, y) {
    if (!this.decentring_px) return [0, 0];
    const [e, f, g, h, i, j] = this.decentring_matrix;
    const q = this.#valueAt(this.decentring_px, theta_rad);
    return [q * (e * x * x + f * x * y + g * y * y), q * (h * x * x + i * x * y + j * y * y)];
  }

  /** Pixel [u, v] of incidence angle and azimuth; null beyond the rim, and below a cone's apex. */
  pixelFromAngles(theta_rad, azimuth_rad) {
    if (!(theta_rad >= this.min_theta_rad && theta_rad <= this.max_theta_rad)) return null;
    const radius_px = this.#valueAt(this.radius_px, theta_rad);
    const [a, b, c, d] = this.azimuth_matrix;
    const [x, y] = [Math.cos(azimuth_rad), Math.sin(azimuth_rad)];
    const [u, v] = this.centre_px;
    const [du, dv] = this.#decentring(theta_rad, x, y);
    return [u + du + radius_px * (a * x + b * y), v + dv + radius_px * (c * x + d * y)];
  }

  /** Pixel [u, v] of a direction of any length in the mirror frame; null beyond the rim. */
  pixelFromDirection([x, y, z]) {
    return this.pixelFromAngles(Math.atan2(Math.hypot(x, y), z), Math.atan2(y, x));
  }

  /**
   * Direction in which the image shows a point, [x, y, z] in metres. The rays of a mirror without a
   * single viewpoint begin on its surface: that of the one through the point, by bisection.
   */
  directionFromPoint([x, y, z]) {
    if (!this.surface_r_m) return [x, y, z];
    const rho = Math.hypot(x, y);
    let [low, high] = [0, this.max_theta_rad];
    for (let step = 0; step < 50; step += 1) {
      const theta = 0.5 * (low + high);
      const along = rho - this.#valueAt(this.surface_r_m, theta);
      const above = z - this.#valueAt(this.surface_z_m, theta);
      if (along * Math.cos(theta) > above * Math.sin(theta)) low = theta;
      else high = theta;
    }
    const sine = Math.sin(low) / (rho || 1);
    return [sine * x, sine * y, Math.cos(low)];
  }

  /**
   * {theta_rad, azimuth_rad} of a pixel; null beyond the rim. A fixed point: the tangential
   * distortion at the angles of a pixel without it leads to the next such pixel.
   */
  anglesFromPixel([u, v]) {
    const [a, b, c, d] = this.#inverse;
    let shift = [0, 0];
    for (let step = 0; step < MAX_STEPS; step += 1) {
      const [du, dv] = [u - this.centre_px[0] - shift[0], v - this.centre_px[1] - shift[1]];
      const [x, y] = [a * du + b * dv, c * du + d * dv];
      const radius_px = Math.hypot(x, y);
      const theta_rad = this.#thetaFromRadius(radius_px);
      const azimuth_rad = Math.atan2(y, x);
      const next = this.#decentring(theta_rad, Math.cos(azimuth_rad), Math.sin(azimuth_rad));
      if (Math.hypot(next[0] - shift[0], next[1] - shift[1]) < TOLERANCE_PX)
        return radius_px <= this.rim_radius_px ? { theta_rad, azimuth_rad } : null;
      shift = next;
    }
    return null;
  }

  /** Table of the same pictures in the other hand, turned round left to right. */
  turned() {
    const { json } = this;
    const turn = (matrix) => matrix?.map((value, i) => (2 * i < matrix.length ? -value : value));
    return new CameraTable({
      ...json,
      picture: otherHand(json.picture),
      isTurned: !json.isTurned,
      centre_px: [json.width_px - json.centre_px[0], json.centre_px[1]],
      azimuth_matrix: turn(json.azimuth_matrix),
      decentring_matrix: turn(json.decentring_matrix),
    });
  }

  /** Whether a pixel lies within the image. */
  contains([u, v]) {
    return u >= 0 && v >= 0 && u <= this.width_px && v <= this.height_px;
  }
}

/** The other one of the two hands of a picture. */
export const otherHand = (picture) => (picture === "flipped" ? "mirrored" : "flipped");

/** Fetch the table of a camera; null for one without such a model. */
export async function fetchCameraTable(className, camera) {
  const query = new URLSearchParams({ class: className, camera });
  const json = await fetchJson(`/api/camera_table.json?${query}`);
  return json?.kind === "radial" ? new CameraTable(json) : null;
}

/**
 * Cylinder of square pixels about the robot's vertical, from the rim to 50 degrees below the
 * horizon, and from 50 degrees above it for a camera that does not look down: as `choose_cylinder`
 * of catoptra_client. `robot_from_mirror`: nine row-major numbers.
 */
export function chooseCylinder(table, columns, robot_from_mirror) {
  const looksDown = robot_from_mirror[8] > LEVEL;
  const rim_slope = looksDown ? 1 / Math.tan(table.max_theta_rad) : -STEEPEST_SLOPE;
  const top_slope = Math.max(rim_slope, -STEEPEST_SLOPE);
  const bottom_slope = Math.max(STEEPEST_SLOPE, top_slope + 1);
  const rows = Math.max(Math.round(((bottom_slope - top_slope) * columns) / (2 * Math.PI)), 1);
  const seam_azimuth_rad = -Math.PI;
  return { columns, rows, top_slope, bottom_slope, seam_azimuth_rad, robot_from_mirror };
}
