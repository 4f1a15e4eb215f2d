// What stands still: walls, obstacles, the planned path, the vehicle's shape; from what the server says
// of the run (/api/run.json). Whatever it does not say is left out.

/**
 * {walls: [[[x, y]...]...], obstacles: [[[x, y]...]...], path: [[x, y]...], vehicle: {...},
 * lostBeyond_m, box: [x1, y1, x2, y2]}; `driven`: the path as far as it was seen, if the server knows none.
 */
export function sceneOf(run, driven = []) {
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
  const planned = (run?.path ?? []).map(([, x, y]) => [x, y]);
  const scene = {
    walls,
    obstacles: run?.obstacles ?? [],
    path: planned.length ? planned : driven,
    vehicle: footprint({ ...run?.scenario?.vehicle, ...run?.shape }),
    lostBeyond_m: run?.scenario?.run?.lost_beyond_m ?? 5,
  };
  scene.box = boxOf([...walls, ...scene.obstacles, scene.path]);
  return scene;
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
