// The page's model of scans, localisations and the autonomy state. No browser.
import assert from "node:assert/strict";
import test from "node:test";
import { Fixes, PoseHistory, driverOf, ellipse95, isWithin95, placeAt, pointsOfScan } from "../../tools/view/page/model/onboard.js";
import { Model } from "../../tools/view/page/model/model.js";
import { sceneOf } from "../../tools/view/page/model/scene.js";

const near = (actual, expected, tolerance = 1e-9) =>
  assert.ok(Math.abs(actual - expected) <= tolerance, `${actual} is not ${expected}`);
const SCAN = { utime: 1e6, mount_x_m: 0.5, mount_y_m: 0, mount_yaw_rad: 0, angle_min_rad: 0,
  angle_increment_rad: Math.PI / 2, time_increment_s: 0.1, range_m: [2, 0, 1] };
const truth = (utime, x_m, more = {}) => ({ utime, x_m, y_m: 0, yaw_rad: 0, x_ref_m: 0, y_ref_m: 0, ...more });
const said = (utime, x_m, more = {}) => ({ utime, x_m, y_m: 0, yaw_rad: 0, state: 1, cov_x_x_m2: 1e-4, cov_x_y_m2: 0,
  cov_y_y_m2: 1e-4, ...more });

function hear(model, topic, fields, time_s = fields.utime / 1e6) {
  model.hear({ topic, schema: "", time_s, bytes: 1, fields }, 0);
}

test("beams end where they point, those that saw nothing nowhere", () => {
  const points = pointsOfScan(SCAN, () => ({ x_m: 10, y_m: 20, yaw_rad: Math.PI / 2 }));
  assert.equal(points.length, 4);
  [10, 22.5, 10, 19.5].forEach((expected, i) => near(points[i], expected));
});

test("each beam is seen from where the vehicle was when it was measured", () => {
  const points = pointsOfScan(SCAN, (t_s) => ({ x_m: t_s, y_m: 0, yaw_rad: 0 }));
  [1 + 2.5, 0, 1.2 - 0.5, 0].forEach((expected, i) => near(points[i], expected));
  assert.deepEqual(pointsOfScan(SCAN, () => null), [], "an unknown place gives no points");
});

test("between two poses the vehicle was between them, also where its yaw wraps", () => {
  const history = new PoseHistory();
  assert.equal(history.at(0), null);
  history.add(1, { x_m: 0, y_m: 0, yaw_rad: 3 });
  history.add(2, { x_m: 2, y_m: 4, yaw_rad: -3 });
  const { x_m, y_m, yaw_rad } = history.at(1.5);
  near(x_m, 1);
  near(y_m, 2);
  near(Math.cos(yaw_rad), -1);
  assert.equal(history.at(2.5), null);
  assert.equal(history.at(0.5), null);
  near(history.at(2.05).x_m, 2.1);
});

test("a scan is placed by the truth of its time, which comes later", () => {
  const model = new Model();
  hear(model, "SIM/TRUTH", truth(0.9e6, 0));
  hear(model, "AGV/SCAN", SCAN, 1.2);
  assert.deepEqual(model.shown.points, []);
  hear(model, "SIM/TRUTH", truth(1.1e6, 1));
  assert.deepEqual(model.shown.points, []);
  hear(model, "SIM/TRUTH", truth(1.3e6, 2));
  [0.5 + 2.5, 0, 1.5 - 0.5, 0].forEach((expected, i) => near(model.shown.points[i], expected));
});

test("without a truth a scan is placed at the vehicle's reported pose", () => {
  const model = new Model();
  hear(model, "AGV/POSE", { utime: 1e6, seq: 0, x_m: 3, y_m: 0, yaw_rad: 0 });
  hear(model, "AGV/SCAN", SCAN, 1.2);
  near(model.shown.points[0], 5.5);
});

test("the ellipse has the covariance's axes and holds 95 %", () => {
  const { a_m, b_m, angle_rad } = ellipse95({ cov_x_x_m2: 5, cov_x_y_m2: 3, cov_y_y_m2: 5 }); // 8 and 2
  const chi = Math.sqrt(5.991464547107979); // of two degrees of freedom
  near(a_m, chi * Math.sqrt(8), 1e-12);
  near(b_m, chi * Math.sqrt(2), 1e-12);
  near(angle_rad, Math.PI / 4);
  const along = [Math.SQRT1_2, Math.SQRT1_2];
  const covariance = { cov_x_x_m2: 5, cov_x_y_m2: 3, cov_y_y_m2: 5 };
  assert.ok(isWithin95(covariance, 0.999 * a_m * along[0], 0.999 * a_m * along[1]));
  assert.ok(!isWithin95(covariance, 1.001 * a_m * along[0], 1.001 * a_m * along[1]));
  assert.ok(!isWithin95(covariance, 1.001 * b_m * along[0], -1.001 * b_m * along[1]));
});

test("a localisation is compared with the truth of its own time", () => {
  const history = new PoseHistory();
  const fixes = new Fixes();
  history.add(1, truth(1e6, 1));
  fixes.hear(said(1.5e6, 1.52), history);
  assert.equal(fixes.all.length, 0, "not known yet");
  history.add(2, truth(2e6, 2));
  fixes.settle(history);
  near(fixes.all[0].dx_m, 0.02);
  fixes.hear(said(1.5e6, 9), history);
  assert.equal(fixes.all.length, 1, "the same, from the other side of the network");
  fixes.hear(said(1.8e6, 9, { state: 0 }), history);
  assert.equal(fixes.all.length, 1, "one that searches says nothing");
  assert.equal(fixes.newest.state, 0);
});

test("errors are kept for ten seconds", () => {
  const history = new PoseHistory();
  const fixes = new Fixes();
  for (let t = 0; t <= 30; ++t) {
    history.add(t, truth(t * 1e6, t));
    fixes.hear(said(t * 1e6, t), history);
  }
  assert.deepEqual(fixes.all.map(({ t_s }) => t_s), [21, 22, 23, 24, 25, 26, 27, 28, 29, 30]);
});

test("what moves is between its places, and stands before and after them", () => {
  const places = [[0, 1, 1], [2, 1, 1], [4, 5, 1], [9, 5, 1]];
  for (const [t, x] of [[-1, 1], [0, 1], [1, 1], [3, 3], [4, 5], [8, 5], [20, 5]]) {
    assert.deepEqual(placeAt(places, t), [x, 1], `${t} s`);
  }
  assert.deepEqual(placeAt([[0, 7, 8]], 3), [7, 8]);
});

test("obstacles of the scenario are in the scene", () => {
  const outline = [[0, 0], [1, 0], [1, 1]];
  const scene = sceneOf({ obstacles: [outline], moving: [{ outline, places: [[0, 1, 2]] }] });
  assert.deepEqual(scene.obstacles, [outline]);
  assert.equal(scene.moving.length, 1);
  assert.deepEqual(sceneOf(null).moving, []);
});

test("who drives is taken from the newest word, on either side of the network", () => {
  const model = new Model();
  hear(model, "AGV/POSE", { utime: 0, seq: 0, x_m: 3, y_m: 0, yaw_rad: 0 });
  assert.equal(model.shown.autonomy, null);
  hear(model, "AGV/AUTONOMY", { utime: 2e6, state: 1, state_name: "protective stop", reason: "0.4 m ahead" });
  hear(model, "CTRL/AUTONOMY", { utime: 1e6, state: 0, state_name: "autonomous", reason: "" });
  assert.deepEqual(driverOf(model.shown.autonomy), { level: "bad", text: "PROTECTIVE STOP", reason: "0.4 m ahead" });
});
