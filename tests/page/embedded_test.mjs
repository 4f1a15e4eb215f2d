// A log in the page's own file: the player, and the stand-in for the WebSocket. No browser.
import assert from "node:assert/strict";
import test from "node:test";
import { gzipSync } from "node:zlib";
import { Connection } from "../../tools/view/page/model/connection.js";
import { EmbeddedSocket, parseRecording, unpack } from "../../tools/view/page/model/embedded.js";
import { Player } from "../../tools/view/page/model/player.js";

// Channel 0 each second from 0 to 10 s, channel 1 at 2.5 s only.
const TIMES_S = [0, 1, 2, 2.5, 3, 4, 5, 6, 7, 8, 9, 10];
const CHANNELS = TIMES_S.map((t) => (t === 2.5 ? 1 : 0));
const player = () => new Player(TIMES_S, CHANNELS);
const timesOf = (numbers) => numbers.map((i) => TIMES_S[i]);

test("what is due comes once, in order, and from the start", () => {
  const one = player();
  one.play(100);
  assert.deepEqual(timesOf(one.due(100)), [0]);
  assert.deepEqual(timesOf(one.due(102.6)), [1, 2, 2.5]);
  assert.deepEqual(timesOf(one.due(102.7)), []);
});

test("a jump shows the latest of each channel before the new position, in order", () => {
  const one = player();
  one.seek(100, 7.5);
  assert.deepEqual(timesOf(one.due(100)), [2.5, 7]);
  one.seek(100, 1.5);
  assert.deepEqual(timesOf(one.due(100)), [1], "the other channel has not spoken yet");
  assert.equal(one.position(200), 1.5, "it stands");
});

test("it ends in a pause, and then plays from the start again", () => {
  const one = player();
  one.play(0);
  assert.equal(one.playing(9.9), true);
  assert.equal(one.playing(10), false);
  assert.equal(one.position(50), 10);
  one.due(50);
  one.play(60);
  assert.equal(one.position(61), 1);
  assert.deepEqual(timesOf(one.due(60)), [0]);
});

test("speed counts from when it is set, within its limits", () => {
  const one = player();
  one.play(0);
  one.setSpeed(1, 4);
  assert.equal(one.position(2), 5);
  one.pause(2);
  assert.equal(one.position(10), 5);
  one.setSpeed(10, 1000);
  assert.equal(one.speed, 100);
});

test("jumps beyond the ends go to the ends", () => {
  const one = player();
  one.seek(0, -5);
  assert.equal(one.position(0), 0);
  one.seek(0, 50);
  assert.equal(one.position(0), 10);
});

test("of too many at once only the latest of each channel come", () => {
  const many = new Player(Array.from({ length: 5000 }, (_, i) => i / 1000), Array.from({ length: 5000 }, (_, i) => i % 3));
  many.play(0);
  many.due(0);
  assert.equal(many.due(0.9).length, 900);
  assert.deepEqual(many.due(4.0), [3998, 3999, 4000]);
});

const HEADER = { title: "tether: run.lcmlog", zero_us: 1_700_000_000_000_000, count: 3, about: { kind: "log" },
  channels: [{ id: 0, topic: "AGV/POSE", schemaName: "tether.pose_t" }, { id: 1, topic: "VIEW/SCENE", schemaName: "foxglove.SceneUpdate" }] };
const TEXT = [JSON.stringify(HEADER), '1700000000000000 0 {"x_m":0,"name":"ä"}', "1700000001000000 1 {}",
  '1700000002000001 0 {"x_m":2}', ""].join("\n");

test("a recording is unpacked, its times counted from its zero", async () => {
  const recording = parseRecording(await unpack(gzipSync(TEXT).toString("base64")));
  assert.deepEqual([...recording.times_s], [0, 1, 2.000001]);
  assert.deepEqual([...recording.channels], [0, 1, 0]);
  assert.equal(recording.header.about.kind, "log");
});

test("the page's connection plays, is scrubbed, and receives errors for what cannot be set", async (t) => {
  const recording = parseRecording(new TextEncoder().encode(TEXT));
  const heard = [];
  const parameters = new Map();
  let refusal = "";
  let now_s = 0;
  const connection = new Connection("", {
    onMessage: ({ topic, time_s, fields }) => heard.push([topic, time_s, fields]),
    onParameters: (all) => all.forEach(({ name, value }) => parameters.set(name, value)),
    onStatus: ({ message }) => (refusal = message),
  }, { wants: ({ topic }) => topic === "AGV/POSE", Socket: function () { return new EmbeddedSocket(recording, () => now_s); } });
  t.after(() => connection.close());
  connection.open();
  await new Promise((resolve) => setTimeout(resolve, 1));
  assert.equal(connection.isOpen, true);
  assert.deepEqual(heard, [["AGV/POSE", 1_700_000_000, { x_m: 0, name: "ä" }]]);
  assert.equal(parameters.get("playback.playing"), true);
  assert.equal(parameters.get("playback.end_s"), 2.000001);
  connection.setParameters([{ name: "playback.playing", value: false }, { name: "playback.position_s", value: 5 }]);
  assert.deepEqual(heard.at(-1)[2], { x_m: 2 });
  assert.ok(Math.abs(heard.at(-1)[1] - 1_700_000_002.000001) < 1e-6);
  assert.equal(parameters.get("playback.playing"), false);
  assert.equal(parameters.get("playback.position_s"), 2.000001);
  connection.setParameters([{ name: "playback.speed", value: 0 }]);
  assert.match(refusal, /playback\.speed/);
  assert.equal(parameters.get("playback.speed"), 1);
});
