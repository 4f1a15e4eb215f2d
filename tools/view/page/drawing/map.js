// The factory from above: what stands still is drawn on a canvas of its own, when it changes; the
// vehicles on another above it, each time.

import { Camera } from "./camera.js";
import { Surface } from "./canvas.js";
import { Fleet, MANY } from "./fleet.js";
import { drawLocalisation, drawMoving, drawScan } from "./onboard.js";
import { drawBelief, drawTrail, drawVehicle } from "./marks.js";
import { radioOf } from "../model/radio.js";
import { boxWith, sceneOf } from "../model/scene.js";
import { colour, onTheme } from "./theme.js";

const AHEAD_S = 8;

export class FactoryMap {
  /** `ground` lies under `canvas` and is as large. */
  constructor(canvas, ground) {
    this.surface = new Surface(canvas);
    this.camera = new Camera(canvas, () => this.forget());
    this.ground = ground;
    this.scene = sceneOf(null);
    this.generation = -1;
    this.seen = null; // box of what stands still and of the places where vehicles have been
    this.seenIn = -1; // value of model.generation when last seen
    this.following = false;
    this.onScene = () => {};
    this.fleet = new Fleet();
    this.camera.resize(this.surface.width, this.surface.height);
    this.surface.onResize = () => {
      this.camera.resize(this.surface.width, this.surface.height);
      if (!this.camera.isFree) this.fit();
      this.forget();
    };
    onTheme(() => this.forget());
    this.fit();
  }

  forget() {
    this.isStale = true;
  }

  fit() {
    this.camera.fit(this.seen ?? this.scene.box);
  }

  seeBox([x1, y1, x2, y2]) {
    if (!this.seen) this.seen = [x1, y1, x2, y2];
    this.seen = boxWith(boxWith(this.seen, { x_m: x1, y_m: y1 }, 0), { x_m: x2, y_m: y2 }, 0);
  }

  /** All vehicles stay on the map until the user moves it. */
  see(vehicles) {
    const { length_m, centre_m } = this.scene.vehicle;
    const before = this.seen;
    for (const { place } of vehicles)
      if (place) this.seen = boxWith(this.seen, place, length_m / 2 + Math.abs(centre_m));
    if (this.seen !== before && !this.camera.isFree) this.fit();
  }

  /** Follows what the model knows of the scenario. */
  update(model) {
    const reference = model.shown?.reference;
    const points = model.about?.path?.length ? 0 : (reference?.x.length ?? 0);
    const about = model.aboutVehicle(model.shown);
    const generation = [model.generation, Math.floor(points / 10), about?.name, model.radioSettings()].join();
    if (generation === this.generation) return;
    this.generation = generation;
    const driven = points ? reference.x.map((x, i) => [x, reference.y[i]]) : [];
    this.scene = sceneOf(model.about, driven, about);
    if (this.seenIn !== model.generation) this.seen = null;
    this.seenIn = model.generation;
    if (!this.scene.isEmpty) this.seeBox(this.scene.box);
    this.scene.radio = radioOf((name) => model.linkSetting(name), this.scene.box);
    if (!this.camera.isFree) this.fit();
    this.forget();
    this.onScene();
  }

  draw(model, now_s) {
    this.update(model);
    const { camera, surface } = this;
    const shown = model.shown;
    this.see(model.vehicles.values());
    if (this.following && shown?.place) {
      camera.centre = [shown.place.x_m, shown.place.y_m];
      camera.isFree = true;
      this.isStale = true;
    }
    if (this.isStale) this.drawGround();
    const c = surface.begin();
    const vehicles = [...model.vehicles.values()];
    const isFleet = vehicles.length > MANY;
    const bodyOf = ({ name }) => this.scene.bodies.get(name) ?? this.scene.vehicle;
    if (isFleet) this.fleet.draw(c, camera, vehicles, shown, bodyOf, surface.ratio);
    else for (const vehicle of vehicles) drawTrail(c, camera, vehicle, vehicle === shown);
    drawMoving(c, camera, this.scene.moving, now_s);
    if (shown) drawScan(c, camera, shown.points);
    if (shown) drawBelief(c, camera, shown, bodyOf(shown), now_s, AHEAD_S);
    for (const vehicle of isFleet ? (shown ? [shown] : []) : vehicles) {
      drawVehicle(c, camera, vehicle, bodyOf(vehicle), vehicle === shown, vehicles.length > 1);
    }
    if (shown?.fixes.newest) drawLocalisation(c, camera, shown.fixes.newest);
  }

  drawGround() {
    const { ground, surface, camera, scene } = this;
    this.isStale = false;
    if (ground.width !== surface.canvas.width || ground.height !== surface.canvas.height) {
      ground.width = surface.canvas.width;
      ground.height = surface.canvas.height;
    }
    const c = ground.getContext("2d");
    c.setTransform(surface.ratio, 0, 0, surface.ratio, 0, 0);
    c.clearRect(0, 0, surface.width, surface.height);
    this.drawGrid(c);
    if (scene.radio) this.drawRadio(c, scene.radio);
    for (const obstacle of scene.obstacles) {
      this.trace(c, obstacle);
      c.closePath();
      c.fillStyle = colour("obstacle");
      c.fill();
      c.strokeStyle = colour("wall");
      c.lineWidth = 1.5;
      c.stroke();
    }
    c.strokeStyle = colour("wall");
    c.lineWidth = Math.max(4, 0.12 * camera.scale);
    c.lineJoin = "miter";
    for (const wall of scene.walls) {
      this.trace(c, wall);
      c.stroke();
    }
    c.strokeStyle = colour("path");
    c.lineWidth = 1.5;
    c.setLineDash([10, 6]);
    for (const path of scene.otherPaths) {
      this.trace(c, path);
      c.stroke();
    }
    c.lineWidth = 3;
    this.trace(c, scene.path);
    c.stroke();
    c.setLineDash([]);
    this.drawScaleBar(c);
  }

  trace(c, line) {
    c.beginPath();
    line.forEach(([x, y], i) => c[i ? "lineTo" : "moveTo"](this.camera.x(x), this.camera.y(y)));
  }

  gridStep() {
    for (const step of [1, 2, 5, 10, 20, 50, 100]) if (step * this.camera.scale >= 45) return step;
    return 200;
  }

  drawGrid(c) {
    const { camera, surface } = this;
    const step = this.gridStep();
    const half = [surface.width / 2 / camera.scale, surface.height / 2 / camera.scale];
    c.strokeStyle = colour("grid");
    c.lineWidth = 1;
    c.beginPath();
    for (
      let x = Math.ceil((camera.centre[0] - half[0]) / step) * step;
      x <= camera.centre[0] + half[0];
      x += step
    ) {
      c.moveTo(Math.round(camera.x(x)) + 0.5, 0);
      c.lineTo(Math.round(camera.x(x)) + 0.5, surface.height);
    }
    for (
      let y = Math.ceil((camera.centre[1] - half[1]) / step) * step;
      y <= camera.centre[1] + half[1];
      y += step
    ) {
      c.moveTo(0, Math.round(camera.y(y)) + 0.5);
      c.lineTo(surface.width, Math.round(camera.y(y)) + 0.5);
    }
    c.stroke();
  }

  drawScaleBar(c) {
    const { camera, surface } = this;
    const metres = this.gridStep();
    const length = metres * camera.scale;
    const y = surface.height - 14;
    c.strokeStyle = c.fillStyle = colour("ink");
    c.lineWidth = 2;
    c.beginPath();
    c.moveTo(14, y - 5);
    c.lineTo(14, y);
    c.lineTo(14 + length, y);
    c.lineTo(14 + length, y - 5);
    c.stroke();
    c.font = "600 13px system-ui, sans-serif";
    c.textAlign = "left";
    c.textBaseline = "bottom";
    c.fillText(`${metres} m`, 18, y - 3);
  }

  /** Where packets get lost, the stronger, the more; rings around the access points. */
  drawRadio(c, radio) {
    const { camera } = this;
    const picture = radioPicture(radio, colour("radio-bad"));
    const [x, y] = [camera.x(radio.x_m), camera.y(radio.y_m + radio.height_m)];
    c.drawImage(picture, x, y, radio.width_m * camera.scale, radio.height_m * camera.scale);
    c.strokeStyle = c.fillStyle = colour("ink");
    c.lineWidth = 2;
    c.font = "600 12px system-ui, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const [x, y] of radio.points) {
      for (const r of [3, 7, 11]) {
        c.beginPath();
        c.arc(camera.x(x), camera.y(y), r, 0, 7);
        c[r === 3 ? "fill" : "stroke"]();
      }
      c.fillText("access point", camera.x(x), camera.y(y) + 14);
    }
  }
}

/** A pixel for each place, the denser, the more packets are lost there; enlarged smoothly. */
function radioPicture(radio, rgb) {
  const picture = document.createElement("canvas");
  picture.width = radio.columns;
  picture.height = radio.rows;
  const c = picture.getContext("2d");
  c.fillStyle = rgb;
  for (let row = 0; row < radio.rows; ++row) {
    for (let column = 0; column < radio.columns; ++column) {
      c.globalAlpha = 0.5 * (1 - radio.prr[row * radio.columns + column]);
      c.fillRect(column, radio.rows - 1 - row, 1, 1);
    }
  }
  return picture;
}
