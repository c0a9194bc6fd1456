/** The path of a robot: positions apart from each other, in bounded memory. */

const MIN_DISTANCE_M = 0.01;
const MAX_POINTS = 4000;
/** Farther apart within a tenth of a second only by being placed anew. */
const JUMP_M = 3;

export class Path {
  points = [];

  /** Add a position; a full path drops every second point of its older half. */
  add({ x, y }) {
    const last = this.points.at(-1);
    const step_m = last ? Math.hypot(x - last.x, y - last.y) : Infinity;
    if (step_m < MIN_DISTANCE_M) return;
    if (step_m > JUMP_M) this.points = [];
    this.points.push({ x, y });
    if (this.points.length > MAX_POINTS)
      this.points = this.points.filter((_, index) => index > MAX_POINTS / 2 || index % 2 === 0);
  }
}
