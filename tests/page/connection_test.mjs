// The page's side of Foxglove's protocol, without a network.
import assert from "node:assert/strict";
import test from "node:test";
import {
  Connection,
  clientMessage,
  parseBinary,
  parseText,
  retryDelay_ms,
} from "../../tools/view/page/model/connection.js";

/** A message as a server sends it: opcode, subscription, nanoseconds, payload. */
function data(subscription, time_ns, payload) {
  const bytes = new TextEncoder().encode(payload);
  const buffer = new ArrayBuffer(13 + bytes.length);
  const view = new DataView(buffer);
  view.setUint8(0, 1);
  view.setUint32(1, subscription, true);
  view.setBigUint64(5, time_ns, true);
  new Uint8Array(buffer, 13).set(bytes);
  return buffer;
}

class FakeSocket {
  constructor(url, protocols) {
    Object.assign(this, { url, protocols, readyState: 1, sent: [] });
    FakeSocket.last = this;
  }
  send(what) {
    this.sent.push(what);
  }
  close() {
    this.readyState = 3;
    this.onclose?.();
  }
  say(message) {
    this.onmessage({ data: message instanceof ArrayBuffer ? message : JSON.stringify(message) });
  }
  get texts() {
    return this.sent.filter((what) => typeof what === "string").map((text) => JSON.parse(text));
  }
}

function connected(
  handlers = {},
  capabilities = ["clientPublish", "parameters", "parametersSubscribe"],
  wants,
) {
  const connection = new Connection("ws://host/", handlers, {
    Socket: FakeSocket,
    ...(wants ? { wants } : {}),
  });
  connection.open();
  FakeSocket.last.onopen();
  FakeSocket.last.say({ op: "serverInfo", name: "tether", capabilities });
  return { connection, socket: FakeSocket.last };
}

test("a message has its subscription, its time and its fields", () => {
  const message = parseBinary(data(7, 1_500_000_001n, '{"x_m":1.5,"name":"ε"}'));
  assert.equal(message.subscription, 7);
  assert.ok(Math.abs(message.time_s - 1.500000001) < 1e-12);
  assert.deepEqual(message.fields, { x_m: 1.5, name: "ε" });
});

test("times since 1970 are exact to a microsecond", () => {
  const message = parseBinary(data(1, 1_764_000_000_123_456_789n, "{}"));
  assert.ok(Math.abs(message.time_s - 1764000000.123456789) < 1e-6);
});

test("nonsense is no message and throws nothing", () => {
  assert.equal(parseBinary(new ArrayBuffer(0)), null);
  assert.equal(parseBinary(new ArrayBuffer(5)), null);
  assert.equal(parseBinary(data(1, 0n, "{cut off")), null);
  assert.equal(parseBinary(data(1, 0n, "null")), null);
  assert.equal(parseText("no JSON"), null);
  assert.equal(parseText("[1]"), null);
  assert.equal(parseText("null"), null);
});

test("what the page publishes begins with opcode and channel", () => {
  const bytes = clientMessage(258, { request: 3 });
  assert.deepEqual([...bytes.slice(0, 5)], [1, 2, 1, 0, 0]);
  assert.equal(new TextDecoder().decode(bytes.slice(5)), '{"request":3}');
});

test("it asks for all parameters, and for their changes, if the server has any", () => {
  const { socket } = connected();
  assert.deepEqual(
    socket.texts.map((text) => text.op),
    ["getParameters", "subscribeParameterUpdates"],
  );
  assert.deepEqual(connected({}, []).socket.texts, []);
});

test("it subscribes to channels in JSON that it wants, and passes their messages on", () => {
  const heard = [];
  const { socket } = connected(
    { onMessage: (message) => heard.push(message) },
    [],
    (channel) => channel.topic !== "C",
  );
  const channel = (id, topic, encoding) => ({
    id,
    topic,
    encoding,
    schemaName: "tether.pose_t",
    schema: "{}",
  });
  socket.say({
    op: "advertise",
    channels: [channel(4, "A", "json"), channel(5, "B", "cdr"), channel(6, "C", "json")],
  });
  assert.deepEqual(socket.texts, [{ op: "subscribe", subscriptions: [{ id: 4, channelId: 4 }] }]);
  socket.say(data(4, 0n, '{"seq":1}'));
  socket.say(data(6, 0n, '{"seq":2}'));
  assert.deepEqual(
    heard.map((message) => [message.topic, message.fields.seq]),
    [["A", 1]],
  );
});

test("a channel that is gone is heard no more, and can come back", () => {
  const heard = [];
  const { socket } = connected({ onMessage: (message) => heard.push(message) }, []);
  const channels = [{ id: 4, topic: "A", encoding: "json" }];
  socket.say({ op: "advertise", channels });
  socket.say({ op: "unadvertise", channelIds: [4] });
  socket.say(data(4, 0n, "{}"));
  assert.equal(heard.length, 0);
  socket.say({ op: "advertise", channels });
  socket.say(data(4, 0n, "{}"));
  assert.equal(heard.length, 1);
});

test("it advertises a channel once before it publishes there", () => {
  const { connection, socket } = connected({}, ["clientPublish"]);
  assert.ok(connection.publish("CAN/REQUEST", "tether.drive_request_t", { request: 1 }));
  assert.ok(connection.publish("CAN/REQUEST", "tether.drive_request_t", { request: 3 }));
  assert.equal(socket.texts.filter((text) => text.op === "advertise").length, 1);
  assert.equal(socket.sent.filter((what) => typeof what !== "string").length, 2);
});

test("it does not publish where the server does not let it, or is not there", () => {
  const { connection, socket } = connected({}, []);
  assert.equal(connection.publish("CAN/REQUEST", "x", {}), false);
  const other = connected();
  other.socket.readyState = 3;
  assert.equal(other.connection.publish("CAN/REQUEST", "x", {}), false);
  assert.deepEqual(socket.sent, []);
});

test("it waits longer with each attempt to connect again, at most 5 s", () => {
  assert.deepEqual([0, 1, 2, 10].map(retryDelay_ms), [250, 500, 1000, 5000]);
});

test("a lost connection is reported and tried again", async () => {
  const states = [];
  const { connection, socket } = connected({ onState: (state) => states.push(state) });
  socket.close();
  await new Promise((resolve) => setTimeout(resolve, 300));
  assert.deepEqual(states, ["connecting", "open", "closed", "connecting"]);
  assert.notEqual(FakeSocket.last, socket);
  connection.close();
});
