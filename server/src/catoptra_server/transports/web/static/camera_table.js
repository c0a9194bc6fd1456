/**
 * The model of an omnidirectional camera as a table of image radii, from the server: the page knows
 * no mirror's formula.
 */

import { fetchJson } from "./connection.js";

const STEEPEST_SLOPE = 1.2;
/** Cosine of the tilt up to which a camera's axis is the robot's vertical. */
const LEVEL = 1 - 1e-6;

/** Pixels of directions in the mirror frame, and directions of pixels. */
export class CameraTable {
  #inverse;

  /** Take the reply of /api/camera_table.json. */
  constructor(json) {
    this.width_px = json.width_px;
    this.height_px = json.height_px;
    this.centre_px = json.centre_px;
    this.max_theta_rad = json.max_theta_rad;
    this.azimuth_matrix = json.azimuth_matrix;
    this.radius_px = Float64Array.from(json.radius_px);
    const [a, b, c, d] = json.azimuth_matrix;
    const determinant = a * d - b * c;
    this.#inverse = [d, -b, -c, a].map((value) => value / determinant);
  }

  /** Image radius of the rim of the mirror. */
  get rim_radius_px() {
    return this.radius_px.at(-1);
  }

  /** Image radius of an incidence angle, by linear interpolation; null beyond the rim. */
  radiusFromTheta(theta_rad) {
    if (!(theta_rad >= 0 && theta_rad <= this.max_theta_rad)) return null;
    const last = this.radius_px.length - 1;
    const position = (theta_rad / this.max_theta_rad) * last;
    const i = Math.min(Math.floor(position), last - 1);
    return this.radius_px[i] + (position - i) * (this.radius_px[i + 1] - this.radius_px[i]);
  }

  /** Incidence angle of an image radius; null beyond the rim. */
  thetaFromRadius(radius_px) {
    const radii = this.radius_px;
    if (!(radius_px >= 0 && radius_px <= this.rim_radius_px)) return null;
    let [low, high] = [0, radii.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (radii[middle] <= radius_px) low = middle;
      else high = middle;
    }
    const fraction = (radius_px - radii[low]) / (radii[high] - radii[low]);
    return ((low + fraction) / (radii.length - 1)) * this.max_theta_rad;
  }

  /** Pixel [u, v] of incidence angle and azimuth; null beyond the rim. */
  pixelFromAngles(theta_rad, azimuth_rad) {
    const radius_px = this.radiusFromTheta(theta_rad);
    if (radius_px === null) return null;
    const [a, b, c, d] = this.azimuth_matrix;
    const [x, y] = [Math.cos(azimuth_rad), Math.sin(azimuth_rad)];
    const [u, v] = this.centre_px;
    return [u + radius_px * (a * x + b * y), v + radius_px * (c * x + d * y)];
  }

  /** Pixel [u, v] of a direction of any length in the mirror frame; null beyond the rim. */
  pixelFromDirection([x, y, z]) {
    return this.pixelFromAngles(Math.atan2(Math.hypot(x, y), z), Math.atan2(y, x));
  }

  /** {theta_rad, azimuth_rad} of a pixel; null outside the mirror. */
  anglesFromPixel([u, v]) {
    const [du, dv] = [u - this.centre_px[0], v - this.centre_px[1]];
    const [a, b, c, d] = this.#inverse;
    const [x, y] = [a * du + b * dv, c * du + d * dv];
    const theta_rad = this.thetaFromRadius(Math.hypot(x, y));
    return theta_rad === null ? null : { theta_rad, azimuth_rad: Math.atan2(y, x) };
  }

  /** Pixels around the rim, closed. */
  rim() {
    return turn().map((azimuth_rad) => this.pixelFromAngles(this.max_theta_rad, azimuth_rad));
  }

  /** Whether a pixel lies within the image. */
  contains([u, v]) {
    return u >= 0 && v >= 0 && u <= this.width_px && v <= this.height_px;
  }
}

/** Azimuths of a full turn in steps of two degrees, from -pi to pi. */
export function turn() {
  return Array.from({ length: 181 }, (_, i) => ((i - 90) * Math.PI) / 90);
}

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
