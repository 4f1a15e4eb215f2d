// Static parts of the scene: walls, obstacles, the planned path, the vehicle's shape; from what the server says
// of the run (/api/run.json). Whatever it does not say is left out.

/**
 * {walls: [[[x, y]...]...], obstacles: [[[x, y]...]...], moving: [...], path: [[x, y]...], otherPaths, vehicle: {...},
 * bodies, lostBeyond_m, box: [x1, y1, x2, y2]}; `driven`: the path as far as it was seen, if the server knows none;
 * `shown`: of a fleet, the vehicle whose path it is, as the server describes it.
 */
export function sceneOf(run, driven = [], shown = undefined) {
  const half = run?.half_extent_m ?? run?.scenario?.world?.half_extent_m;
  const walls = (run?.walls ?? []).filter((wall) => wall.length > 1);
  if (Number.isFinite(half))
    walls.push([
      [-half, -half],
      [half, -half],
      [half, half],
      [-half, half],
      [-half, -half],
    ]);
  const planned = run?.paths?.[shown?.path ?? 0] ?? (run?.path ?? []).map(([, x, y]) => [x, y]);
  const scene = {
    walls,
    obstacles: run?.obstacles ?? [],
    moving: run?.moving ?? [], // [{outline: [[x, y]...] around its place, places: [[t, x, y]...]}...]
    path: oneLap(planned.length ? planned : driven),
    otherPaths: (run?.paths ?? []).filter((path) => path !== planned).map((path) => oneLap(path)),
    vehicle: footprint({ ...run?.scenario?.vehicle, ...run?.shape }),
    bodies: new Map(), // by the name of a fleet's vehicle
    lostBeyond_m: run?.scenario?.run?.lost_beyond_m ?? 5,
  };
  for (const { name, shape, scenario } of run?.vehicles ?? [])
    scene.bodies.set(name, footprint({ ...run.scenario?.vehicle, ...scenario?.vehicle, ...shape }));
  const lines = [...walls, ...scene.obstacles, scene.path, ...scene.otherPaths];
  scene.isEmpty = !lines.some((line) => line.length);
  scene.box = boxOf(lines);
  return scene;
}

function distanceToSegment([x, y], [ax, ay], [bx, by]) {
  const [dx, dy] = [bx - ax, by - ay];
  const length2 = dx * dx + dy * dy;
  const share = length2 ? Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / length2)) : 0;
  return Math.hypot(x - ax - share * dx, y - ay - share * dy);
}

function isNear(point, line, within_m) {
  for (let i = 1; i < line.length; ++i)
    if (distanceToSegment(point, line[i - 1], line[i]) < within_m) return true;
  return false;
}

/**
 * A path up to where it begins to repeat itself: dashes of several laps on each other would make a solid
 * line. One that only crosses its start, as an eight does, goes on.
 */
export function oneLap(path, within_m = 0.15) {
  let isAway = false;
  for (let i = 1; i < path.length; ++i) {
    const [x, y] = path[i];
    isAway ||= Math.hypot(x - path[0][0], y - path[0][1]) > 10 * within_m;
    if (!isAway || distanceToSegment(path[0], path[i - 1], path[i]) >= within_m) continue;
    const lap = path.slice(0, i + 1);
    const rest = path.slice(i + 1);
    const every = Math.max(1, Math.floor(rest.length / 200));
    if (rest.every((point, k) => k % every !== 0 || isNear(point, lap, within_m))) return lap;
  }
  return path;
}

/** The chassis as it stands around the drive axle's midpoint. */
export function footprint(vehicle) {
  return {
    length_m: vehicle.chassis_length_m ?? 2,
    width_m: vehicle.chassis_width_m ?? 1,
    centre_m: -(vehicle.axle_x_m ?? -0.5), // ahead of the axle
    track_m: vehicle.track_m ?? 1.2,
    wheel_m: vehicle.wheel_radius_m ?? 0.4,
  };
}

/**
 * `box` (null: nothing yet) with a place in it, `around_m` on each side; the same box if the place was in
 * it already. It grows by steps, so that what is fitted to it does not move all the time.
 */
export function boxWith(box, place, around_m) {
  const [x1, y1, x2, y2] = box ?? [Infinity, Infinity, -Infinity, -Infinity];
  const { x_m: x, y_m: y } = place;
  if (x - around_m >= x1 && x + around_m <= x2 && y - around_m >= y1 && y + around_m <= y2) return box;
  const step_m = around_m + (box ? 0.1 * Math.max(x2 - x1, y2 - y1) : 3);
  return [
    x - around_m < x1 ? Math.min(x1, x - step_m) : x1,
    y - around_m < y1 ? Math.min(y1, y - step_m) : y1,
    x + around_m > x2 ? Math.max(x2, x + step_m) : x2,
    y + around_m > y2 ? Math.max(y2, y + step_m) : y2,
  ];
}

export function boxOf(lines) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (const line of lines) {
    for (const [x, y] of line) {
      box[0] = Math.min(box[0], x);
      box[1] = Math.min(box[1], y);
      box[2] = Math.max(box[2], x);
      box[3] = Math.max(box[3], y);
    }
  }
  return Number.isFinite(box[0]) ? box : [-5, -5, 5, 5];
}
