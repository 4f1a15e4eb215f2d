// The page's model of messages: packets, belief, statistics, scene, settings. No browser.
import assert from "node:assert/strict";
import test from "node:test";
import { arc, followPlan } from "../../tools/view/page/model/belief.js";
import { twistOfKeys, twistOfPad } from "../../tools/view/page/drive.js";
import { kindOf, known, parseText, place, twin } from "../../tools/view/page/model/known_settings.js";
import { Model } from "../../tools/view/page/model/model.js";
import { ARRIVED, FLYING, LATE, LOST, Lane } from "../../tools/view/page/model/packets.js";
import { between, radioOf, snr_db } from "../../tools/view/page/model/radio.js";
import { boxWith, oneLap, sceneOf } from "../../tools/view/page/model/scene.js";
import { Series, Trail } from "../../tools/view/page/model/series.js";
import { ChannelStatistics, jitter } from "../../tools/view/page/model/statistics.js";
import { peerOf } from "../../tools/view/page/numbers.js";
import { isWanted, splitTopic, topicsOf } from "../../tools/view/page/model/topics.js";

const near = (actual, expected, tolerance = 1e-9) =>
  assert.ok(Math.abs(actual - expected) <= tolerance, `${actual} is not ${expected}`);
const truth = (utime, more = {}) => ({
  utime,
  x_m: 0,
  y_m: 0,
  yaw_rad: 0,
  v_mps: 1,
  error_m: 0.1,
  epsilon_m: 0.1,
  x_ref_m: 0,
  y_ref_m: 0,
  ...more,
});
const pose = (seq, more = {}) => ({
  utime: seq * 1e6,
  seq,
  x_m: seq,
  y_m: 0,
  yaw_rad: 0,
  plan_session: -1,
  plan_id: -1,
  ...more,
});

function hear(model, topic, fields, time_s = fields.utime / 1e6) {
  model.hear({ topic, schema: "x", time_s, bytes: 100, fields }, time_s);
}

const fates = (lane) => lane.packets.map((packet) => packet.fate);

test("a packet that came is not lost, one that was overtaken is", () => {
  const lane = new Lane();
  for (const seq of [1, 2, 3]) lane.sent(seq, seq * 0.1);
  lane.arrived(1, 0.15);
  lane.arrived(3, 0.35);
  lane.settle(0.6);
  assert.deepEqual(fates(lane), [ARRIVED, LOST, ARRIVED]);
  near(lane.received(0.6, 10), 2 / 3);
});

test("a packet under way is not lost yet", () => {
  const lane = new Lane();
  lane.sent(1, 0);
  lane.arrived(1, 0.5);
  lane.sent(2, 1);
  lane.settle(1.6);
  assert.deepEqual(fates(lane), [ARRIVED, FLYING]);
});

test("behind a newer one is late, and no loss", () => {
  const lane = new Lane();
  lane.sent(1, 0);
  lane.sent(2, 0.1);
  lane.arrived(2, 0.2);
  lane.arrived(1, 0.25);
  assert.deepEqual(fates(lane), [LATE, ARRIVED]);
  near(lane.received(1, 10), 1);
});

test("one that was taken for lost and comes after all is late", () => {
  const lane = new Lane();
  for (const seq of [1, 2]) lane.sent(seq, 0);
  lane.arrived(2, 0);
  lane.settle(1);
  lane.arrived(1, 1.5);
  assert.deepEqual(fates(lane), [LATE, ARRIVED]);
});

test("an arrival may be heard before its sending", () => {
  const lane = new Lane();
  lane.arrived(1, 0.2);
  lane.sent(1, 0.2);
  assert.deepEqual(fates(lane), [ARRIVED]);
});

test("without any reception, nothing counts as lost unless a relay is there", () => {
  const lane = new Lane();
  lane.sent(1, 0);
  lane.settle(10);
  assert.deepEqual(fates(lane), [FLYING]);
  lane.settle(10, true);
  assert.deepEqual(fates(lane), [LOST]);
});

test("a quarter circle ends beside its centre", () => {
  const end = arc({ x_m: 0, y_m: 0, yaw_rad: 0 }, 2, 1, Math.PI / 2);
  near(end.x_m, 2);
  near(end.y_m, 2);
  near(end.yaw_rad, Math.PI / 2);
});

test("a plan is followed from its start to its end, whatever the step of the points", () => {
  const plan = { start_utime: 1e6, step_us: 500000, v_mps: [1, 2], omega_radps: [0, 0] };
  const from = { x_m: 0, y_m: 0, yaw_rad: 0 };
  for (const every of [0.1, 0.3, Infinity]) {
    const way = followPlan(from, plan, 0.5, 1.75, every);
    near(way[way.length - 1].x_m, 0.5 * 1 + 0.25 * 2);
  }
  const beyond = followPlan(from, plan, 0.5, 10);
  near(beyond[beyond.length - 1].x_m, 1.5);
});

test("the age of information counts from the newest pose's measurement", () => {
  const model = new Model();
  hear(model, "SIM/TRUTH", truth(5e6));
  assert.ok(Number.isNaN(model.shown.age_s(5)));
  hear(model, "CTRL/POSE", pose(3), 5);
  hear(model, "CTRL/POSE", pose(2), 5); // late: no news
  near(model.shown.age_s(5), 2);
});

test("between poses the controller's belief follows the commands that were sent", () => {
  const model = new Model();
  hear(model, "SIM/TRUTH", truth(0));
  hear(model, "CTRL/POSE", pose(0));
  hear(model, "CTRL/CMD_VEL", { utime: 0, seq: 0, v_mps: 1, omega_radps: 0 });
  hear(model, "CTRL/CMD_VEL", { utime: 1e6, seq: 1, v_mps: 3, omega_radps: 0 });
  near(model.shown.predicted(2).x_m, 1 + 3);
});

test("a log that is wound back restarts the model", () => {
  const model = new Model();
  for (let t = 0; t < 20; ++t) hear(model, "SIM/TRUTH", truth(t * 1e6, { x_m: t }));
  const { generation } = model;
  hear(model, "SIM/TRUTH", truth(3e6, { x_m: 3 }));
  assert.equal(model.generation, generation + 1);
  assert.deepEqual(model.shown.trail.x, [3]);
  near(model.now_s(0), 3);
});

test("another run on the clock restarts the model", () => {
  const model = new Model();
  hear(model, "SIM/CLOCK", { utime: 5e6, seq: 1, run: 1, rate: 1 });
  const { generation } = model;
  hear(model, "SIM/CLOCK", { utime: 9e6, seq: 1, run: 2, rate: 1 });
  assert.equal(model.generation, generation + 1);
});

test("the shown time stands while a log is paused, else runs on for a moment only", () => {
  const model = new Model();
  model.hear({ topic: "SIM/TRUTH", time_s: 5, bytes: 1, fields: truth(5e6) }, 100);
  near(model.now_s(100.1), 5.1);
  near(model.now_s(109), 5.15);
  model.parameters.set("playback.playing", false);
  near(model.now_s(109), 5);
});

test("each vehicle has its own truth, poses and controller", () => {
  const model = new Model();
  hear(model, "AGV7/POSE", pose(1));
  hear(model, "AGV12/POSE", pose(2));
  hear(model, "CTRL7/POSE", pose(1));
  assert.deepEqual([...model.vehicles.keys()], ["7", "12"]);
  assert.equal(model.vehicles.get("7").believed.seq, 1);
  assert.equal(model.vehicles.get("12").believed, null);
});

test("what names no vehicle is of the run's own, whatever its name", () => {
  const model = new Model();
  hear(model, "SIM/TRUTH", truth(1e6));
  model.hearAbout({ vehicle: "Truck" });
  hear(model, "SIM/TRUTH", truth(2e6));
  hear(model, "Truck/POSE", pose(2));
  hear(model, "CTRL-Truck/POSE", pose(2));
  assert.deepEqual([...model.vehicles.keys()], ["Truck"]);
  assert.ok(model.shown.truth && model.shown.pose && model.shown.believed);
});

test("the verdict says when the vehicle is lost", () => {
  const model = new Model();
  assert.equal(model.verdict().level, "none");
  hear(model, "SIM/TRUTH", truth(1e6));
  assert.equal(model.verdict().text, "ON THE PATH");
  hear(model, "SIM/TRUTH", truth(2e6, { error_m: 6 }));
  assert.equal(model.verdict().text, "OFF THE PATH");
  hear(model, "SIM/TRUTH", truth(9e6, { error_m: 6, lost: true }));
  assert.equal(model.verdict().text, "LOST");
  hear(model, "SIM/TRUTH", truth(10e6, { error_m: 0.2, lost: true }));
  assert.equal(model.verdict().text, "WAS LOST");
});

test("a live network that falls silent is no longer on the path, and what is known grows older", () => {
  const model = new Model();
  model.hearAbout({ kind: "live", scenario: { run: { duration_s: 60 } } });
  hear(model, "CTRL/POSE", pose(9), 10);
  hear(model, "SIM/TRUTH", truth(10e6));
  assert.equal(model.silence_s(11.4), 0);
  const silence_s = model.silence_s(13.2);
  assert.deepEqual(model.verdict(5, silence_s), { level: "warn", text: "NO NEWS for 3.2 s" });
  near(model.shown.age_s(model.now_s(13.2)), 1 + 3.2);
  hear(model, "SIM/TRUTH", truth(59.9e6));
  assert.equal(model.verdict(5, model.silence_s(62)).text, "RUN ENDED");
});

test("a pause or a gap in a log is no silence, but a lost connection is", () => {
  const model = new Model();
  model.hearAbout({ kind: "log" });
  hear(model, "SIM/TRUTH", truth(10e6));
  assert.equal(model.silence_s(20), 0);
  model.isCut = true;
  near(model.silence_s(20), 10);
  assert.equal(model.hasEnded, false);
});

test("rate, missed numbers and jitter are those of the last ten seconds", () => {
  const channel = new ChannelStatistics("A", "x");
  for (let i = 0; i < 400; ++i) if (i % 4 !== 3) channel.add(i * 0.05, 100, { seq: i });
  const summary = channel.summary(20);
  near(summary.loss, 0.25, 0.01);
  near(summary.rate_hz, 15, 0.2);
  near(summary.kB_per_s, 1.5, 0.05);
  near(jitter([0, 1, 2, 4, 5]).p50_s, 0);
  near(jitter([0, 1, 2, 4, 5]).p99_s, 1);
});

test("what is sent before t = 0, all stamped 0, does not count for rate and jitter", () => {
  const channel = new ChannelStatistics("A", "x");
  for (let i = 0; i < 100; ++i) channel.add(0, 100, { seq: i });
  for (let i = 1; i <= 40; ++i) channel.add(i * 0.05, 100, { seq: 99 + i });
  near(channel.summary(2).rate_hz, 20, 1e-6);
  near(channel.summary(2).p99_s, 0, 1e-6);
  assert.equal(channel.count, 140);
});

test("arrivals per second are those since the first packet, once that is a second ago", () => {
  const model = new Model();
  const lane = new Lane();
  for (let i = 0; i <= 300; ++i) {
    lane.sent(i, 0.05 * i);
    lane.arrived(i, 0.05 * i);
    const rate = model.arrivals_per_s(lane, 0.05 * i + 0.01);
    if (i < 19) assert.ok(Number.isNaN(rate));
    else if (i > 20) near(rate, 20, 1);
  }
});

test("plots keep their window, trails their points", () => {
  const series = new Series(["a"], 10);
  for (let t = 0; t < 1000; ++t) series.add(t / 10, { a: t === 5 ? NaN : t });
  assert.ok(series.time_s.length < 300);
  assert.ok(series.time_s[0] <= 89.9);
  assert.equal(series.columns.a.length, series.time_s.length);
  const trail = new Trail(100);
  for (let i = 0; i < 1000; ++i) trail.add(i, 0);
  assert.ok(trail.x.length >= 100 && trail.x.length <= 130);
  trail.add(999.01, 0);
  assert.equal(trail.x[trail.x.length - 1], 999);
});

test("walls, path and shape come from what the server says of the run", () => {
  const scene = sceneOf({
    half_extent_m: 22,
    path: [
      [0, 1, 2, 0],
      [1, 3, 4, 0],
    ],
    shape: { track_m: 0.5 },
    scenario: { vehicle: { axle_x_m: -1 } },
  });
  assert.deepEqual(scene.path, [
    [1, 2],
    [3, 4],
  ]);
  assert.deepEqual(scene.box, [-22, -22, 22, 22]);
  assert.equal(scene.vehicle.track_m, 0.5);
  assert.equal(scene.vehicle.centre_m, 1);
  assert.deepEqual(sceneOf(null).walls, []);
});

test("a path of several laps is one lap, whatever crosses its start", () => {
  const at = (turn) => [10 * Math.sin(turn), 10 * Math.sin(turn) * Math.cos(turn)];
  const laps = (count) => Array.from({ length: 400 * count }, (_, i) => at((2 * Math.PI * i) / 399.5));
  const lap = oneLap(laps(3));
  assert.ok(Math.abs(lap.length - 401) < 4, `${lap.length}`);
  assert.equal(oneLap(laps(1)).length, 400);
  assert.deepEqual(oneLap([]), []);
});

test("the map's box takes in a vehicle that leaves it, and stands still while none does", () => {
  const box = boxWith([-5, -5, 5, 5], { x_m: 0, y_m: 0 }, 1);
  assert.deepEqual(box, [-5, -5, 5, 5]);
  const [x1, y1, x2, y2] = boxWith(box, { x_m: 7, y_m: 0 }, 1);
  assert.deepEqual([x1, y1, y2], [-5, -5, 5]);
  assert.ok(x2 >= 8 && x2 <= 10);
  assert.deepEqual(boxWith(null, { x_m: 100, y_m: 50 }, 1), [96, 46, 104, 54]);
});

test("the radio map is that of the strongest access point", () => {
  near(
    snr_db(
      [
        [0, 0],
        [100, 0],
      ],
      60,
      3,
      10,
      0,
    ),
    30,
  );
  near(
    snr_db(
      [
        [0, 0],
        [100, 0, 80],
      ],
      60,
      3,
      90,
      0,
    ),
    50,
  );
  near(
    between(
      [
        [0, 0],
        [10, 1],
      ],
      2.5,
    ),
    0.25,
  );
  const settings = {
    "uplink.model": "map",
    "uplink.map.access_points": "[[0, 0]]",
    "uplink.map.snr50_db": 20,
  };
  const radio = radioOf((name) => settings[name], [-30, -30, 30, 30]);
  assert.equal(radio.prr.length, radio.rows * radio.columns);
  assert.ok(radio.prr[30 * 60 + 30] > 0.99);
  assert.ok(radio.prr[0] < 0.2);
  assert.equal(
    radioOf(() => "fixed", [-1, -1, 1, 1]),
    null,
  );
});

test("settings are sorted by link, with range and unit", () => {
  assert.deepEqual(place("network.uplink.markov.bad.prr"), {
    group: "network.uplink",
    label: "bad prr",
    isMain: true,
  });
  assert.deepEqual(place("controller.tau_s"), { group: "controller", label: "tau", isMain: true });
  assert.equal(known("network.uplink.delay_ms").unit, "ms");
  assert.equal(known("network.uplink.prr", { low: 0.1 }).min, 0.1);
  assert.deepEqual(known("network.uplink.model", { kind: "choice", choices: ["fixed"] }).words, ["fixed"]);
  assert.equal(twin("network.uplink.prr"), "network.downlink.prr");
  assert.equal(twin("controller.tau_s"), null);
});

test("what a hand writes is of the parameter's kind, or nothing", () => {
  assert.equal(parseText("number", "0.45"), 0.45);
  assert.equal(parseText("number", ""), undefined);
  assert.equal(parseText("number", "1e999"), undefined);
  assert.deepEqual(parseText("list", "[1, 2]"), [1, 2]);
  assert.equal(parseText("list", "[1,"), undefined);
  assert.equal(parseText("rows", "[[1, 2]]"), "[[1, 2]]");
  assert.equal(kindOf(true), "switch");
});

test("no key drives without the dead man", () => {
  assert.equal(twistOfKeys(new Set(["KeyW"]), 1), null);
  assert.deepEqual(twistOfKeys(new Set(["Space", "KeyW", "KeyA"]), 2), { v_mps: 2, omega_radps: 0.8 });
  assert.deepEqual(twistOfKeys(new Set(["Space"]), 2), { v_mps: 0, omega_radps: 0 });
  assert.deepEqual(twistOfPad(0.05, 3, 1), { v_mps: 1, omega_radps: -0 });
});

test("topics are grouped by side and vehicle; what is drawn for Foxglove is not wanted", () => {
  assert.deepEqual(splitTopic("CTRL12/POSE"), { side: "CTRL12", name: "POSE", vehicle: "12", base: "CTRL" });
  assert.equal(splitTopic("LCM_SELF_TEST"), null);
  assert.deepEqual(topicsOf(["CAN7/REQUEST", "CTRL7/CMD_VEL"]), {
    request: "CAN7/REQUEST",
    twist: "CTRL7/CMD_VEL",
  });
  assert.deepEqual(topicsOf([]), { request: undefined, twist: undefined });
  assert.equal(isWanted({ schemaName: "foxglove.SceneUpdate" }), false);
  assert.equal(isWanted({ schemaName: "tether.pose_t" }), true);
});

const peer = (more = {}) => ({
  utime: 1.8e15,
  peer: "AGV1",
  up: true,
  age_s: 0.1,
  offset_known: true,
  offset_min_ms: -1.25,
  offset_max_ms: 0.5,
  clocks_apart: false,
  path: ["wifi", "5g"],
  path_alive: [true, true],
  ...more,
});

test("a peer is shown with the paths it is heard by and the offset of its clock", () => {
  assert.deepEqual(peerOf(peer(), 0.5), {
    level: "good",
    text: "up by wifi, 5g · clock -1.3 to 0.5 ms ahead of ours",
  });
  assert.deepEqual(peerOf(peer({ offset_known: false }), 0), { level: "good", text: "up by wifi, 5g · clock unknown" });
});

test("a peer whose clock is apart, or of which a path is silent, is warned of", () => {
  const apart = peerOf(peer({ clocks_apart: true, offset_min_ms: 60, offset_max_ms: 62 }), 0);
  assert.equal(apart.level, "warn");
  assert.match(apart.text, /CLOCKS APART: clock 60.0 to 62.0 ms/);
  const single = peerOf(peer({ path_alive: [true, false] }), 0);
  assert.equal(single.level, "warn");
  assert.match(single.text, /up by wifi, not by 5g/);
});

test("a lost peer is reported with its time, and a lost link as well", () => {
  assert.deepEqual(peerOf(peer({ up: false, age_s: 1.5 }), 0.7), { level: "bad", text: "DOWN for 2.2 s" });
  assert.deepEqual(peerOf(peer({ up: false, age_s: -1 }), 0.7), { level: "bad", text: "DOWN, never heard" });
  assert.deepEqual(peerOf(peer(), 4), { level: "warn", text: "no report for 4 s" });
});

test("a report of the link is of no vehicle, and neither sets the run's time nor is news of it", () => {
  const model = new Model();
  hear(model, "LINK/REPORT", peer(), 1);
  hear(model, "AGV/POSE", pose(3), 2);
  assert.deepEqual([...model.vehicles.keys()].length, 1);
  near(model.clock.run_s, 3);
  hear(model, "LINK/REPORT", peer({ peer: "AGV2" }), 9);
  assert.equal(model.heard_s, 2);
  assert.deepEqual([...model.peers.keys()], ["AGV1", "AGV2"]);
  assert.equal(model.peers.get("AGV2").heard_s, 9);
});
