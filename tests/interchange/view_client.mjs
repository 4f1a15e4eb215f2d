// Foxglove's client against tether view: what is advertised, sent and set is as its makers understand it.
// Usage: node view_client.mjs URL PROTOCOL log|run

import * as foxglove from "@foxglove/schemas/jsonschema.js";
import protocolPackage from "@foxglove/ws-protocol";
import Ajv from "ajv";
import { WebSocket } from "ws";

const { FoxgloveClient } = protocolPackage;
const [url, protocol, kind] = process.argv.slice(2);
const socket = new WebSocket(url, [protocol]);
const client = new FoxgloveClient({ ws: socket });
const ajv = new Ajv({ strict: false, validateFormats: false });
const text = new TextDecoder("utf-8", { fatal: true });

const channels = new Map(); // by subscription
const counts = new Map(); // by topic
const parameters = new Map();
const answered = new Set();
const status = [];
let info;
let times = 0;

function check(condition, what) {
  if (condition) return;
  console.log(`FAILED: ${what}`);
  process.exit(1);
}

async function until(condition, what) {
  for (const end = Date.now() + 10_000; !condition(); ) {
    check(Date.now() < end, `not within 10 s: ${what}; status: ${JSON.stringify(status)}`);
    await new Promise((resolve) => setTimeout(resolve, 10));
  }
}

client.on("error", (error) => check(false, `${error}`));
client.on("serverInfo", (message) => (info = message));
client.on("status", (message) => status.push(message));
client.on("time", () => (times += 1));
client.on("advertise", (added) => {
  for (const channel of added) {
    check(channel.encoding === "json" && channel.schemaEncoding === "jsonschema", channel.topic);
    const name = channel.schemaName;
    const validators = [ajv.compile(JSON.parse(channel.schema))];
    if (name.startsWith("foxglove.")) validators.push(ajv.compile(foxglove[name.replace("foxglove.", "")]));
    channels.set(client.subscribe(channel.id), { ...channel, validators });
  }
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const { topic, schemaName, validators } = channels.get(subscriptionId);
  const value = JSON.parse(text.decode(data));
  for (const validator of validators) {
    check(validator(value), `${topic}, ${schemaName}: ${JSON.stringify(validator.errors)}`);
  }
  if (value.utime !== undefined && topic === "SIM/TRUTH") {
    check(timestamp === BigInt(value.utime) * 1000n, `${topic}: ${timestamp} is not ${value.utime}`);
  }
  counts.set(topic, (counts.get(topic) ?? 0) + 1);
});
client.on("parameterValues", ({ parameters: values, id }) => {
  for (const { name, value } of values) parameters.set(name, value);
  if (id !== undefined) answered.add(id);
});

async function set(name, value, refused) {
  const id = `${name}=${value}`;
  const before = status.length;
  client.setParameters([{ name, value }], id);
  await until(() => answered.has(id), `the answer to ${id}`);
  check(status.length === before + (refused ? 1 : 0), `${id}: ${JSON.stringify(status)}`);
  if (refused) check(status.at(-1).message.includes(refused), status.at(-1).message);
  else check(parameters.get(name) === value, `${name} is ${parameters.get(name)}`);
}

await until(() => info !== undefined, "who the server is");
check(socket.protocol === protocol, `the protocol is ${socket.protocol}`);
check(info.capabilities.includes("parametersSubscribe"), `capabilities: ${info.capabilities}`);
client.getParameters([], "all");
await until(() => answered.has("all"), "all parameters");
client.subscribeParameterUpdates([]);
const wanted = ["SIM/TRUTH", "CTRL/POSE", "AGV/CMD_VEL", "NET/UPLINK", "VIEW/SCENE", "VIEW/FRAMES", "VIEW/REFERENCE"];
await until(() => wanted.every((topic) => counts.get(topic) > 0), "a message of each channel");

await set("playback.speed", 4);
await set("playback.speed", 1000, "has to be a number in [0.1, 100]");
await set("playback.playing", false);
if (kind === "log") {
  await set("playback.position_s", 7.5);
  await set("playback.position_s", 2.5);
} else {
  await set("playback.playing", true);
  await set("network.uplink.prr", 0.25);
  await set("network.downlink.model", "markov");
  await set("network.uplink.prr", 2, "must be a number in [0, 1]");
  check(parameters.get("network.uplink.prr") === 0.25, "after a refusal it is as it was");
  await until(() => parameters.get("network.in_effect").includes("network.downlink.markov.bad.prr"), "in effect");
  const operator = client.advertise({ topic: "CAN/REQUEST", encoding: "json", schemaName: "request" });
  client.sendMessage(operator, new TextEncoder().encode(JSON.stringify({ request: "ESTOP" })));
  await until(() => counts.get("CAN/REQUEST") === 1, "what was published");
  client.sendMessage(operator, new TextEncoder().encode(JSON.stringify({ request: "dance" })));
  await until(() => status.at(-1).message.includes("DISARM"), "the refusal of nonsense");
}
check(times > 0, "the time was not told");
const messages = [...counts.values()].reduce((sum, count) => sum + count, 0);
console.log(`${messages} messages on ${counts.size} channels are valid by their schemas`);
process.exit(0);
