// How a vehicle, its trail and what its controller believes look on the map.

import { colour } from "./theme.js";

/** Calls draw with the origin at the pose, x forward, in metres. */
function atPose(c, camera, pose, draw) {
  c.save();
  c.translate(camera.x(pose.x_m), camera.y(pose.y_m));
  c.rotate(-pose.yaw_rad);
  c.scale(camera.scale, -camera.scale);
  draw();
  c.restore();
}

/** Vehicles are drawn at least this long, so that they are seen from afar. */
function enlarged(camera, body) {
  return Math.max(1, 26 / (body.length_m * camera.scale));
}

function chassis(c, body, k) {
  c.beginPath();
  c.rect(
    (body.centre_m - body.length_m / 2) * k,
    (-body.width_m / 2) * k,
    body.length_m * k,
    body.width_m * k,
  );
}

/** The origin is the axle's midpoint, x forward, in metres. */
export function drawBody(c, camera, body, isShown) {
  const k = enlarged(camera, body);
  c.fillStyle = colour("ink");
  for (const side of [-1, 1]) {
    c.fillRect(-body.wheel_m * k, ((side * body.track_m) / 2 - 0.1) * k, 2 * body.wheel_m * k, 0.2 * k);
  }
  chassis(c, body, k);
  c.fillStyle = colour("truth");
  c.fill();
  c.lineWidth = (isShown ? 2.5 : 1) / camera.scale;
  c.strokeStyle = colour(isShown ? "ink" : "panel");
  c.stroke();
  const front = (body.centre_m + body.length_m / 2) * k;
  c.beginPath(); // an arrow that says where its front is
  c.moveTo(front - 0.25 * k, 0);
  c.lineTo(front - 1.1 * k, 0.36 * k);
  c.lineTo(front - 1.1 * k, -0.36 * k);
  c.closePath();
  c.fillStyle = colour("panel");
  c.fill();
}

export function drawVehicle(c, camera, vehicle, body, isShown, isNamed) {
  const pose = vehicle.place;
  if (!pose) return;
  atPose(c, camera, pose, () => drawBody(c, camera, body, isShown));
  if (!isNamed) return;
  c.font = `${isShown ? 700 : 500} 12px system-ui, sans-serif`;
  c.textAlign = "center";
  c.textBaseline = "bottom";
  c.fillStyle = colour("ink");
  c.fillText(vehicle.key || vehicle.name, camera.x(pose.x_m), camera.y(pose.y_m) - 12);
}

/** Newer parts are stronger. */
export function drawTrail(c, camera, vehicle, isShown) {
  const { x, y } = vehicle.trail;
  const pose = vehicle.place;
  if (x.length < 2 || !pose) return;
  c.strokeStyle = colour("truth");
  c.lineWidth = isShown ? 3 : 1.5;
  c.lineJoin = "round";
  const parts = 3;
  for (let part = 0; part < parts; ++part) {
    const from = Math.floor((x.length * part) / parts);
    const to = Math.floor((x.length * (part + 1)) / parts);
    c.globalAlpha = 0.35 + (0.55 * (part + 1)) / parts;
    c.beginPath();
    const first = Math.max(0, from - 1);
    c.moveTo(camera.x(x[first]), camera.y(y[first]));
    for (let i = first + 1; i < to; ++i) c.lineTo(camera.x(x[i]), camera.y(y[i]));
    if (part === parts - 1) c.lineTo(camera.x(pose.x_m), camera.y(pose.y_m));
    c.stroke();
  }
  c.globalAlpha = 1;
}

function ghost(c, camera, pose, body, stroke, dash) {
  const k = enlarged(camera, body);
  atPose(c, camera, pose, () => {
    chassis(c, body, k);
    c.strokeStyle = stroke;
    c.lineWidth = 3 / camera.scale;
    c.setLineDash(dash.map((pixels) => pixels / camera.scale));
    c.stroke();
    c.setLineDash([]);
    const front = (body.centre_m + body.length_m / 2) * k;
    c.beginPath();
    c.moveTo(front - 0.8 * k, 0.32 * k);
    c.lineTo(front - 0.15 * k, 0);
    c.lineTo(front - 0.8 * k, -0.32 * k);
    c.stroke();
  });
}

function polyline(c, camera, way) {
  c.beginPath();
  way.forEach((pose, i) => c[i ? "lineTo" : "moveTo"](camera.x(pose.x_m), camera.y(pose.y_m)));
  c.stroke();
}

/** The newest pose that the controller has, what follows from it for now, and the plan ahead. */
export function drawBelief(c, camera, vehicle, body, now_s, ahead_s) {
  const newest = vehicle.believed;
  if (!newest) return;
  const predicted = vehicle.predicted(now_s);
  const ahead = vehicle.wayAhead(now_s, ahead_s);
  c.lineCap = "round";
  if (ahead && ahead.length > 1) {
    c.strokeStyle = colour("predicted");
    c.lineWidth = 5;
    c.setLineDash([1, 9]);
    polyline(c, camera, ahead);
    c.setLineDash([]);
  }
  if (vehicle.place) {
    // how far off the truth the controller's newest knowledge is
    c.strokeStyle = colour("newest");
    c.lineWidth = 1.5;
    c.setLineDash([3, 4]);
    polyline(c, camera, [newest, vehicle.place]);
    c.setLineDash([]);
  }
  c.lineCap = "butt";
  if (predicted) ghost(c, camera, predicted, body, colour("predicted"), [4, 3]);
  ghost(c, camera, newest, body, colour("newest"), []);
  drawAge(c, camera, newest, vehicle.place, now_s - newest.utime / 1e6);
}

/** On the side where the vehicle is not. */
function drawAge(c, camera, pose, place, age_s) {
  if (age_s < 0.5) return;
  const text = `${age_s.toFixed(1)} s ago`;
  c.font = "700 14px system-ui, sans-serif";
  c.textAlign = "center";
  c.textBaseline = "middle";
  c.strokeStyle = colour("panel");
  c.lineWidth = 4;
  c.lineJoin = "round";
  const within = (value, margin, end) => Math.max(margin, Math.min(end - margin, value));
  const x = within(camera.x(pose.x_m), c.measureText(text).width / 2 + 4, camera.width);
  const above = place && place.y_m > pose.y_m + 0.1 ? 28 : -28;
  const y = within(camera.y(pose.y_m) + above, 12, camera.height);
  c.strokeText(text, x, y);
  c.fillStyle = colour("newest");
  c.fillText(text, x, y);
}

/** Small pictures of the marks, with their names. */
export const LEGEND = [
  {
    name: "vehicle and trail (truth)",
    draw: (c) => {
      line(c, "truth", 3, [], 0, 14);
      box(c, "truth", true, 14);
    },
  },
  { name: "planned path", draw: (c) => line(c, "path", 3, [7, 4], 1, 29) },
  { name: "newest pose the controller has", draw: (c) => box(c, "newest", false, 7, []) },
  { name: "its prediction for now", draw: (c) => box(c, "predicted", false, 7, [3, 2]) },
  {
    name: "plan ahead",
    draw: (c) => {
      c.lineCap = "round";
      line(c, "predicted", 4, [1, 7], 3, 28);
    },
  },
  {
    name: "packets are lost here (radio map)",
    isThere: ({ scene }) => scene.radio,
    draw: (c) => {
      c.globalAlpha = 0.5;
      box(c, "radio-bad", true, 7);
      c.globalAlpha = 1;
    },
  },
  {
    name: "laser scan",
    isThere: (map, vehicle) => vehicle?.points.length,
    draw: (c) => line(c, "scan", 3, [3, 4], 1, 29),
  },
  {
    name: "localiser's place, 95 %",
    isThere: (map, vehicle) => vehicle?.fixes.newest,
    draw: (c) => {
      c.strokeStyle = colour("localised");
      c.lineWidth = 2;
      c.beginPath();
      c.ellipse(15, 8, 11, 5, 0, 0, 7);
      c.stroke();
    },
  },
  {
    name: "moves by itself",
    isThere: ({ scene }) => scene.moving.length,
    draw: (c) => box(c, "moving", true, 7),
  },
];

function line(c, name, width, dash, from, to) {
  c.strokeStyle = colour(name);
  c.lineWidth = width;
  c.setLineDash(dash);
  c.beginPath();
  c.moveTo(from, 8);
  c.lineTo(to, 8);
  c.stroke();
  c.setLineDash([]);
}

function box(c, name, isFilled, x, dash = []) {
  c.strokeStyle = c.fillStyle = colour(name);
  c.lineWidth = 2.2;
  c.setLineDash(dash);
  c.beginPath();
  c.rect(x, 3.5, 15, 9);
  c[isFilled ? "fill" : "stroke"]();
  c.setLineDash([]);
}
