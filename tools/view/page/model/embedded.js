// A log that is in the page's own file, as `tether log page` writes it (recording.hpp): instead of a
// server, it answers the page in the same protocol.

import { FASTEST, Player, SLOWEST } from "./player.js";
import { PLAYBACK } from "./topics.js";

const EVERY_MS = 10;
const TELL_EVERY_S = 0.1;
const NEWLINE = 10;
const SPACE = 32;
const MESSAGE_DATA = 1;

/** The recording that a document holds, as a promise; null if it holds none. */
export function recordingIn(document) {
  const element = document.getElementById("recording");
  return element && unpack(element.textContent).then(parseRecording);
}

/** The bytes of gzip in base64. */
export async function unpack(base64) {
  const packed = Uint8Array.from(atob(base64.trim()), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function numberAt(bytes, begin, end) {
  let digits = "";
  for (let i = begin; i < end; ++i) digits += String.fromCharCode(bytes[i]);
  return Number(digits);
}

/**
 * A line of JSON, {title, zero_us, count, channels: [{id, topic, schemaName}], about}, then one for each
 * message, in order of time: microseconds, channel, JSON.
 */
export function parseRecording(bytes) {
  const headerEnd = bytes.indexOf(NEWLINE);
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(0, headerEnd)));
  const { count } = header;
  const recording = {
    header,
    bytes,
    times_s: new Float64Array(count), // since `zero`
    channels: new Uint16Array(count),
    begins: new Uint32Array(count),
    ends: new Uint32Array(count),
  };
  let at = headerEnd + 1;
  for (let i = 0; i < count; ++i) {
    const first = bytes.indexOf(SPACE, at);
    const second = bytes.indexOf(SPACE, first + 1);
    recording.times_s[i] = (numberAt(bytes, at, first) - header.zero_us) / 1e6;
    recording.channels[i] = numberAt(bytes, first + 1, second);
    recording.begins[i] = second + 1;
    recording.ends[i] = at = bytes.indexOf(NEWLINE, second + 1);
    ++at;
  }
  return recording;
}

/** The i-th message as a server sends it. */
export function dataMessage(recording, i, subscription) {
  const payload = recording.bytes.subarray(recording.begins[i], recording.ends[i]);
  const bytes = new Uint8Array(13 + payload.length);
  const view = new DataView(bytes.buffer);
  const time_us = Math.round(recording.times_s[i] * 1e6) + recording.header.zero_us;
  view.setUint8(0, MESSAGE_DATA);
  view.setUint32(1, subscription, true);
  view.setBigUint64(5, BigInt(Math.max(0, time_us)) * 1000n, true);
  bytes.set(payload, 13);
  return bytes.buffer;
}

/** Has what connection.js needs of a WebSocket. It begins to play at once. */
export class EmbeddedSocket {
  constructor(recording, clock_s = () => performance.now() / 1000) {
    this.readyState = 0;
    this.clock_s = clock_s;
    this.subscriptions = new Map(); // channel -> subscription
    this.told_s = -Infinity;
    Promise.resolve(recording).then((opened) => this.open(opened));
  }

  open(recording) {
    if (this.readyState !== 0) return;
    this.recording = recording;
    this.player = new Player(recording.times_s, recording.channels);
    this.player.play(this.clock_s());
    this.readyState = 1;
    this.onopen?.();
    this.say({ op: "serverInfo", name: recording.header.title, capabilities: ["parameters", "parametersSubscribe"],
      sessionId: "recording" });
    this.say({ op: "advertise", channels: recording.header.channels.map((channel) => ({ ...channel, encoding: "json" })) });
    this.advance();
    this.timer = setInterval(() => this.advance(), EVERY_MS);
  }

  close() {
    clearInterval(this.timer);
    this.readyState = 3;
    this.onclose?.();
  }

  say(message) {
    this.onmessage?.({ data: JSON.stringify(message) });
  }

  advance() {
    const now_s = this.clock_s();
    for (const i of this.player.due(now_s)) {
      const subscription = this.subscriptions.get(this.recording.channels[i]);
      if (subscription !== undefined) this.onmessage?.({ data: dataMessage(this.recording, i, subscription) });
    }
    if (now_s - this.told_s >= TELL_EVERY_S) this.tell();
  }

  tell(id) {
    const { player } = this;
    this.told_s = this.clock_s();
    const values = [
      [PLAYBACK.position, player.position(this.told_s)], [PLAYBACK.playing, player.playing(this.told_s)],
      [PLAYBACK.speed, player.speed], [PLAYBACK.start, player.start_s], [PLAYBACK.end, player.end_s],
    ];
    this.say({ op: "parameterValues", parameters: values.map(([name, value]) => ({ name, value })), id });
  }

  send(what) {
    const message = typeof what === "string" ? JSON.parse(what) : {};
    if (message.op === "subscribe") {
      for (const { id, channelId } of message.subscriptions) this.subscriptions.set(channelId, id);
    } else if (message.op === "getParameters") {
      this.tell(message.id);
    } else if (message.op === "setParameters") {
      for (const { name, value } of message.parameters) this.set(name, value);
      this.advance();
      this.tell(message.id);
    }
  }

  set(name, value) {
    const now_s = this.clock_s();
    const isNumber = Number.isFinite(value);
    if (name === PLAYBACK.playing && value === true) this.player.play(now_s);
    else if (name === PLAYBACK.playing && value === false) this.player.pause(now_s);
    else if (name === PLAYBACK.speed && value >= SLOWEST && value <= FASTEST) this.player.setSpeed(now_s, value);
    else if (name === PLAYBACK.position && isNumber) this.player.seek(now_s, value);
    else this.say({ op: "status", level: 2, message: `${name} cannot be set to ${JSON.stringify(value)}` });
  }
}
