// State of a vehicle with a laser scanner: where its beams ended, how sure it is of its place, who drives.
// No DOM. Angles are radians, times seconds of the run.

const KEPT = 128;
const BEYOND_S = 0.1; // so far beyond what is known is guessed

const wrapped = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

/** Where a vehicle was, lately. */
export class PoseHistory {
  constructor() {
    this.clear();
  }

  clear() {
    this.poses = [];
  }

  get newest_s() {
    return this.poses.at(-1)?.t_s ?? -Infinity;
  }

  add(t_s, { x_m, y_m, yaw_rad }) {
    if (t_s <= this.newest_s) return;
    this.poses.push({ t_s, x_m, y_m, yaw_rad });
    if (this.poses.length > 2 * KEPT) this.poses.splice(0, KEPT);
  }

  /** Between two of them, or shortly before the first and after the last; null else. */
  at(t_s) {
    const { poses } = this;
    if (!poses.length || t_s > this.newest_s + BEYOND_S || t_s < poses[0].t_s - BEYOND_S) return null;
    let next = poses.length - 1;
    while (next > 1 && poses[next - 1].t_s > t_s) --next;
    const b = poses[next];
    const a = poses[next - 1] ?? b;
    const share = b.t_s > a.t_s ? (t_s - a.t_s) / (b.t_s - a.t_s) : 0;
    return {
      x_m: a.x_m + share * (b.x_m - a.x_m),
      y_m: a.y_m + share * (b.y_m - a.y_m),
      yaw_rad: a.yaw_rad + share * wrapped(b.yaw_rad - a.yaw_rad),
    };
  }
}

export function endOfScan_s(scan) {
  return scan.utime / 1e6 + (scan.range_m.length - 1) * scan.time_increment_s;
}

/**
 * Where the beams ended, [x1, y1, x2, y2 ...] in the world, each from where the vehicle was when it was
 * measured, `poseAt(t_s)`; without those that saw nothing or whose pose is not known.
 */
export function pointsOfScan(scan, poseAt) {
  const points = [];
  scan.range_m.forEach((range, i) => {
    const pose = range > 0 ? poseAt(scan.utime / 1e6 + i * scan.time_increment_s) : null;
    if (!pose) return;
    const beam = scan.mount_yaw_rad + scan.angle_min_rad + i * scan.angle_increment_rad;
    const x = scan.mount_x_m + range * Math.cos(beam);
    const y = scan.mount_y_m + range * Math.sin(beam);
    const [cos, sin] = [Math.cos(pose.yaw_rad), Math.sin(pose.yaw_rad)];
    points.push(pose.x_m + cos * x - sin * y, pose.y_m + sin * x + cos * y);
  });
  return points;
}

/** Of a normal distribution in the plane: 95 % are within this many standard deviations, √(-2 ln 0.05). */
const RADIUS_95 = Math.sqrt(-2 * Math.log(0.05));

/** The ellipse that holds the place with 95 %: semi-axes in metres, and where the first points. */
export function ellipse95({ cov_x_x_m2: xx, cov_x_y_m2: xy, cov_y_y_m2: yy }) {
  const middle = (xx + yy) / 2;
  const half = Math.hypot((xx - yy) / 2, xy);
  return {
    a_m: RADIUS_95 * Math.sqrt(Math.max(0, middle + half)),
    b_m: RADIUS_95 * Math.sqrt(Math.max(0, middle - half)),
    angle_rad: Math.atan2(2 * xy, xx - yy) / 2,
  };
}

/** Whether an error lies within the ellipse. */
export function isWithin95({ cov_x_x_m2: xx, cov_x_y_m2: xy, cov_y_y_m2: yy }, dx_m, dy_m) {
  const determinant = xx * yy - xy * xy;
  if (!(determinant > 0)) return false;
  return (yy * dx_m * dx_m - 2 * xy * dx_m * dy_m + xx * dy_m * dy_m) / determinant <= RADIUS_95 * RADIUS_95;
}

export const LOCALISATION = { searching: 0, tracking: 1, degenerate: 2 };
export const LOCALISATION_NAMES = ["searching", "tracking", "degenerate"];

const FIXES_KEPT_S = 10;
const FIXES_KEPT = 600;

/** The localiser's words, each beside where the vehicle really was then. */
export class Fixes {
  constructor() {
    this.clear();
  }

  clear() {
    this.all = []; // {t_s, said, dx_m, dy_m, dyaw_rad}: what it said minus the truth
    this.waiting = []; // for the truth of their time
    this.newest = null;
  }

  hear(said, truth) {
    if (this.newest && said.utime <= this.newest.utime) return;
    this.newest = said;
    this.waiting.push(said);
    if (this.waiting.length > 20) this.waiting.shift(); // no truth arrives
    this.settle(truth);
  }

  /** The truth is known up to later. */
  settle(truth) {
    while (this.waiting.length && this.waiting[0].utime / 1e6 <= truth.newest_s) {
      const said = this.waiting.shift();
      const t_s = said.utime / 1e6;
      const pose = truth.at(t_s);
      if (!pose || said.state === LOCALISATION.searching) continue;
      this.all.push({
        t_s,
        said,
        dx_m: said.x_m - pose.x_m,
        dy_m: said.y_m - pose.y_m,
        dyaw_rad: wrapped(said.yaw_rad - pose.yaw_rad),
      });
      const old = this.all.findIndex((fix) => fix.t_s > t_s - FIXES_KEPT_S);
      this.all.splice(0, Math.max(old, this.all.length - FIXES_KEPT));
    }
  }
}

/** Where something that moves by itself is: [[t, x, y]...] in order, straight on between them. */
export function placeAt(places, t_s) {
  let low = 0;
  let high = places.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (places[middle][0] <= t_s) low = middle + 1;
    else high = middle;
  }
  const b = places[Math.min(low, places.length - 1)];
  const a = places[Math.max(0, low - 1)];
  const share = b[0] > a[0] ? (t_s - a[0]) / (b[0] - a[0]) : 0;
  return [a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])];
}

/** Who drives, and how that is to be taken; autonomy_state_t. */
export function driverOf(autonomy) {
  const LEVELS = ["good", "bad", "warn", "remote", "none"];
  return {
    level: LEVELS[autonomy.state] ?? "none",
    text: String(autonomy.state_name ?? "").toUpperCase(),
    reason: autonomy.reason ?? "",
  };
}
