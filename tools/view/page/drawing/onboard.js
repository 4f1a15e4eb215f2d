// Draws a vehicle's scan, its localiser's estimate, and moving obstacles.

import { LOCALISATION, ellipse95, placeAt } from "../model/onboard.js";
import { Surface } from "./canvas.js";
import { colour } from "./theme.js";

const POINT_PX = 3;

export function drawScan(c, camera, points) {
  c.fillStyle = colour("scan");
  c.beginPath();
  for (let i = 0; i < points.length; i += 2) {
    c.rect(camera.x(points[i]) - POINT_PX / 2, camera.y(points[i + 1]) - POINT_PX / 2, POINT_PX, POINT_PX);
  }
  c.fill();
}

export function drawMoving(c, camera, moving, now_s) {
  c.fillStyle = colour("moving");
  c.strokeStyle = colour("ink");
  c.lineWidth = 1.5;
  for (const { outline, places } of moving) {
    const [x, y] = placeAt(places, now_s);
    c.beginPath();
    for (const [dx, dy] of outline) c.lineTo(camera.x(x + dx), camera.y(y + dy));
    c.closePath();
    c.fill();
    c.stroke();
  }
}

/** The ellipse and a cross in its middle; x and y are pixels, `scale` pixels a metre. */
function ellipse(c, said, x, y, scale) {
  const { a_m, b_m, angle_rad } = ellipse95(said);
  c.strokeStyle = colour("localised");
  c.lineWidth = 2;
  c.setLineDash(said.state === LOCALISATION.degenerate ? [5, 4] : []);
  c.beginPath();
  c.ellipse(x, y, Math.max(1, a_m * scale), Math.max(1, b_m * scale), -angle_rad, 0, 2 * Math.PI);
  c.stroke();
  c.setLineDash([]);
  c.beginPath();
  c.moveTo(x - 4, y);
  c.lineTo(x + 4, y);
  c.moveTo(x, y - 4);
  c.lineTo(x, y + 4);
  c.stroke();
}

/** On the map, where the localiser takes the vehicle to be. */
export function drawLocalisation(c, camera, said) {
  if (said.state === LOCALISATION.searching) return;
  ellipse(c, said, camera.x(said.x_m), camera.y(said.y_m), camera.scale);
}

const RINGS_M = [0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50];

/** As many centimetres as it needs: the truth in the middle, the newest ellipse, and the last errors. */
export class ErrorPicture {
  constructor(canvas) {
    this.surface = new Surface(canvas);
  }

  draw(fixes) {
    const c = this.surface.begin();
    const newest = fixes.at(-1);
    if (!newest) return;
    const { width, height } = this.surface;
    const half = Math.min(width, height) / 2;
    const { a_m } = ellipse95(newest.said);
    const most_m = fixes.reduce((most, { dx_m, dy_m }) => Math.max(most, Math.hypot(dx_m, dy_m)), a_m);
    const ring_m = RINGS_M.find((ring) => ring >= 0.8 * most_m) ?? RINGS_M.at(-1);
    const scale = (0.72 * half) / ring_m;
    const place = (fix) => [width / 2 + fix.dx_m * scale, height / 2 - fix.dy_m * scale];
    c.strokeStyle = colour("line");
    c.lineWidth = 1;
    c.beginPath();
    c.arc(width / 2, height / 2, ring_m * scale, 0, 2 * Math.PI);
    c.stroke();
    c.fillStyle = colour("quiet");
    c.font = "600 12px system-ui, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "top";
    c.fillText(ring_m >= 1 ? `${ring_m} m` : `${+(100 * ring_m).toFixed(1)} cm`, width / 2, height / 2 + ring_m * scale + 2);
    c.fillStyle = colour("localised");
    c.globalAlpha = 0.35;
    for (const fix of fixes) {
      const [x, y] = place(fix);
      c.fillRect(x - 1.5, y - 1.5, 3, 3);
    }
    c.globalAlpha = 1;
    ellipse(c, newest.said, ...place(newest), scale);
    c.fillStyle = colour("truth");
    c.beginPath();
    c.arc(width / 2, height / 2, 4, 0, 2 * Math.PI);
    c.fill();
  }
}
