// Many vehicles: one picture of a vehicle, stamped for each, and all trails as one line. Drawing each of them again,
// as for a few, is too slow for a hundred.

import { drawBody } from "./marks.js";
import { colour } from "./theme.js";

export const MANY = 12;

export class Fleet {
  constructor() {
    this.key = "";
    this.stamps = new Map(); // of a vehicle's shape -> its picture
    this.names = new Map(); // of a vehicle -> its picture
  }

  /** `bodyOf(vehicle)`: its shape. */
  draw(c, camera, vehicles, shown, bodyOf, ratio) {
    this.drawTrails(c, camera, vehicles);
    this.forgetIfChanged([camera.scale, ratio, colour("truth"), colour("ink")].join());
    for (const vehicle of vehicles) {
      const pose = vehicle.place;
      if (!pose || vehicle === shown) continue;
      const stamp = this.stampFor(camera, bodyOf(vehicle), ratio);
      const half = stamp.width / ratio / 2;
      const x = camera.x(pose.x_m);
      const y = camera.y(pose.y_m);
      if (x < -half || y < -half || x > camera.width + half || y > camera.height + half) continue;
      const cos = ratio * Math.cos(pose.yaw_rad);
      const sin = ratio * Math.sin(pose.yaw_rad);
      c.setTransform(cos, -sin, sin, cos, ratio * x, ratio * y);
      c.drawImage(stamp, -half, -half, 2 * half, 2 * half);
      c.setTransform(ratio, 0, 0, ratio, 0, 0);
      const name = this.nameFor(vehicle, ratio);
      c.drawImage(name, x - name.width / ratio / 2, y - 26, name.width / ratio, name.height / ratio);
    }
  }

  drawTrails(c, camera, vehicles) {
    c.strokeStyle = colour("truth");
    c.globalAlpha = 0.4;
    c.lineWidth = 1.5;
    c.beginPath();
    for (const { trail } of vehicles) {
      for (let i = 0; i < trail.x.length; ++i) {
        if (i === 0) c.moveTo(camera.x(trail.x[i]), camera.y(trail.y[i]));
        else c.lineTo(camera.x(trail.x[i]), camera.y(trail.y[i]));
      }
    }
    c.stroke();
    c.globalAlpha = 1;
  }

  forgetIfChanged(key) {
    if (key === this.key) return;
    this.key = key;
    this.stamps.clear();
    this.names.clear();
  }

  /** A vehicle that looks along +x, its axle's midpoint in the middle. */
  stampFor(camera, body, ratio) {
    const shape = Object.values(body).join();
    let stamp = this.stamps.get(shape);
    if (stamp) return stamp;
    const pixels = Math.max(40, 2.4 * camera.scale * (body.length_m / 2 + Math.abs(body.centre_m)));
    stamp = document.createElement("canvas");
    stamp.width = stamp.height = Math.ceil(pixels * ratio);
    const c = stamp.getContext("2d");
    c.setTransform(ratio * camera.scale, 0, 0, -ratio * camera.scale, stamp.width / 2, stamp.height / 2);
    drawBody(c, camera, body, false);
    this.stamps.set(shape, stamp);
    return stamp;
  }

  nameFor(vehicle, ratio) {
    let picture = this.names.get(vehicle.key);
    if (picture) return picture;
    picture = document.createElement("canvas");
    picture.width = 40 * ratio;
    picture.height = 14 * ratio;
    const c = picture.getContext("2d");
    c.scale(ratio, ratio);
    c.font = "500 12px system-ui, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "bottom";
    c.fillStyle = colour("ink");
    c.fillText(vehicle.key || vehicle.name, 20, 14);
    this.names.set(vehicle.key, picture);
    return picture;
  }
}
