// The page with a fleet, as the server describes it. No browser.
import assert from "node:assert/strict";
import test from "node:test";
import { Model } from "../../tools/view/page/model/model.js";
import { sceneOf } from "../../tools/view/page/model/scene.js";

function hear(model, topic, fields) {
  const time_s = fields.utime / 1e6;
  model.hear({ topic, schema: "x", time_s, bytes: 100, fields }, time_s);
}

const fleetOf = () => ({
  kind: "run",
  vehicle: "AGV1",
  half_extent_m: 10,
  path: [[0, 0, 0, 0], [1, 9, 0, 0]],
  scenario: { controller: { law: "pid" }, channel: { uplink: { model: "fixed", prr: 1 } } },
  vehicles: [
    { name: "AGV1", path: 0, shape: { chassis_length_m: 2 }, scenario: {} },
    {
      name: "AGV2",
      path: 1,
      shape: { chassis_length_m: 5 },
      scenario: { controller: { law: "tracking" }, channel: { uplink: { prr: 0.3 } } },
    },
  ],
  paths: [
    [[0, 0], [9, 0]],
    [[0, 5], [9, 5]],
  ],
});

test("the first vehicle of a fleet is shown, regardless of who is heard first", () => {
  const model = new Model();
  model.hearAbout(fleetOf());
  hear(model, "SIM2/TRUTH", { utime: 0, x_m: 0, y_m: 0 });
  assert.equal(model.shown, null);
  hear(model, "SIM1/TRUTH", { utime: 0, x_m: 0, y_m: 0 });
  assert.equal(model.shown.name, "AGV1");
});

test("each vehicle's links are its own", () => {
  const model = new Model();
  model.hearAbout(fleetOf());
  hear(model, "NET1/UPLINK", { utime: 0, state: 0, delay_ms_p50: 10 });
  hear(model, "NET2/UPLINK", { utime: 0, state: 1, delay_ms_p50: 20 });
  for (const [key, delay_ms, state] of [["1", 10, 0], ["2", 20, 1]]) {
    model.selected = key;
    assert.equal(model.links.uplink.delay_ms_p50, delay_ms);
    assert.deepEqual(model.states.uplink, [{ from_s: 0, state }]);
    assert.equal(model.links.downlink, null);
  }
});

test("what a vehicle has of its own is said of it, until it is set", () => {
  const model = new Model();
  model.hearAbout(fleetOf());
  for (const key of ["1", "2"]) hear(model, `AGV${key}/POSE`, { utime: 0, seq: 1 });
  model.parameters.set("network.uplink.prr", 1); // the server tells the first vehicle's
  const seen = (key) => {
    model.selected = key;
    return [model.scenarioSetting("controller.law"), model.linkSetting("uplink.prr")];
  };
  assert.deepEqual(seen("1"), ["pid", 1]);
  assert.deepEqual(seen("2"), ["tracking", 0.3]);
  model.parameters.set("network.uplink.prr", 0.8);
  assert.deepEqual(seen("1"), ["pid", 0.8]);
  assert.deepEqual(seen("2"), ["tracking", 0.8]);
});

test("a fleet's scene has the path of the one that is looked at, the others', and all shapes", () => {
  const about = fleetOf();
  const scene = sceneOf(about, [], about.vehicles[1]);
  assert.deepEqual(scene.path, about.paths[1]);
  assert.deepEqual(scene.otherPaths, [about.paths[0]]);
  assert.equal(scene.bodies.get("AGV1").length_m, 2);
  assert.equal(scene.bodies.get("AGV2").length_m, 5);
});
