// The client's side of Foxglove's WebSocket protocol (foxglove/ws-protocol, docs/spec.md), as far as
// this page needs it. Nothing here knows what the messages are about.

export const PROTOCOLS = ["foxglove.websocket.v1", "foxglove.sdk.v1"];

const MESSAGE_DATA = 1;
const TIME = 2;
const TWO_TO_32 = 4294967296;
const decoder = new TextDecoder();
const encoder = new TextEncoder();

/** Seconds of a little-endian u64 of nanoseconds: exact to 0.3 us for times since 1970. */
function seconds(view, offset) {
  return view.getUint32(offset + 4, true) * (TWO_TO_32 / 1e9) + view.getUint32(offset, true) / 1e9;
}

/** Content of a binary message; null if it is malformed or of an unknown kind. */
export function parseBinary(buffer) {
  const view = new DataView(buffer);
  if (view.byteLength >= 13 && view.getUint8(0) === MESSAGE_DATA) {
    let fields;
    try {
      fields = JSON.parse(decoder.decode(new Uint8Array(buffer, 13)));
    } catch {
      return null;
    }
    if (fields === null || typeof fields !== "object") return null;
    return {
      op: "message",
      subscription: view.getUint32(1, true),
      time_s: seconds(view, 5),
      bytes: view.byteLength - 13,
      fields,
    };
  }
  if (view.byteLength >= 9 && view.getUint8(0) === TIME) return { op: "time", time_s: seconds(view, 1) };
  return null;
}

/** What a text message says; null if it makes no sense. */
export function parseText(text) {
  try {
    const message = JSON.parse(text);
    return message !== null && typeof message === "object" && typeof message.op === "string" ? message : null;
  } catch {
    return null;
  }
}

/** The bytes of a message that the page publishes on a channel that it has advertised. */
export function clientMessage(channel, fields) {
  const payload = encoder.encode(JSON.stringify(fields));
  const bytes = new Uint8Array(5 + payload.length);
  bytes[0] = MESSAGE_DATA;
  new DataView(bytes.buffer).setUint32(1, channel, true);
  bytes.set(payload, 5);
  return bytes;
}

/** How long to wait before the n-th attempt in a row to connect again. */
export function retryDelay_ms(attempt) {
  return Math.min(5000, 250 * 2 ** Math.max(0, attempt));
}

/**
 * A connection that comes back by itself. `wants(channel)` says what to subscribe to. Handlers, all
 * of them optional: onState("connecting" | "open" | "closed"), onInfo(serverInfo),
 * onChannels([channel...]), onMessage({topic, schema, time_s, bytes, fields}), onParameters([...]),
 * onStatus({level, message}).
 */
export class Connection {
  constructor(url, handlers, { wants = () => true, Socket = globalThis.WebSocket } = {}) {
    this.url = url;
    this.handlers = handlers;
    this.wants = wants;
    this.Socket = Socket;
    this.attempt = 0;
    this.capabilities = [];
    this.forget();
  }

  forget() {
    this.channels = new Map(); // id of the channel -> channel
    this.subscriptions = new Map(); // id of the subscription, which is its channel's -> channel
    this.published = new Map(); // topic -> id of our channel
  }

  open() {
    this.tell("onState", "connecting");
    this.forget();
    const socket = new this.Socket(this.url, PROTOCOLS);
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.attempt = 0;
      this.tell("onState", "open");
    };
    socket.onmessage = (event) => {
      if (typeof event.data === "string") this.hearText(parseText(event.data));
      else this.hearBinary(parseBinary(event.data));
    };
    socket.onclose = () => {
      if (this.socket !== socket) return;
      this.tell("onState", "closed");
      this.timer = setTimeout(() => this.open(), retryDelay_ms(this.attempt++));
    };
  }

  close() {
    clearTimeout(this.timer);
    const socket = this.socket;
    this.socket = null;
    socket?.close();
  }

  tell(handler, ...what) {
    this.handlers[handler]?.(...what);
  }

  hearText(message) {
    switch (message?.op) {
      case "serverInfo":
        this.capabilities = message.capabilities ?? [];
        this.tell("onInfo", message);
        if (this.can("parameters")) this.sendText({ op: "getParameters", parameterNames: [], id: "all" });
        if (this.can("parametersSubscribe")) {
          this.sendText({ op: "subscribeParameterUpdates", parameterNames: [] });
        }
        break;
      case "advertise":
        this.subscribe(message.channels ?? []);
        break;
      case "unadvertise":
        for (const id of message.channelIds ?? []) {
          this.channels.delete(id);
          this.subscriptions.delete(id);
        }
        this.tell("onChannels", [...this.channels.values()]);
        break;
      case "parameterValues":
        this.tell("onParameters", message.parameters ?? [], message.id);
        break;
      case "status":
        this.tell("onStatus", { level: message.level, message: message.message });
        break;
      default: // of a later version, or nonsense: not for us
    }
  }

  hearBinary(message) {
    if (message?.op === "time") this.tell("onTime", message.time_s);
    if (message?.op !== "message") return;
    const channel = this.subscriptions.get(message.subscription);
    if (!channel) return;
    message.topic = channel.topic;
    message.schema = channel.schemaName;
    this.tell("onMessage", message);
  }

  subscribe(channels) {
    const wanted = [];
    for (const channel of channels) {
      this.channels.set(channel.id, channel);
      if (channel.encoding !== "json" || this.subscriptions.has(channel.id) || !this.wants(channel)) continue;
      this.subscriptions.set(channel.id, channel);
      wanted.push({ id: channel.id, channelId: channel.id });
    }
    if (wanted.length) this.sendText({ op: "subscribe", subscriptions: wanted });
    this.tell("onChannels", [...this.channels.values()]);
  }

  can(capability) {
    return this.capabilities.includes(capability);
  }

  get isOpen() {
    return this.socket?.readyState === 1;
  }

  sendText(message) {
    if (this.isOpen) this.socket.send(JSON.stringify(message));
  }

  setParameters(parameters) {
    this.sendText({ op: "setParameters", parameters, id: "set" });
  }

  /** Publishes a message on a topic; advertises it first. False: not connected, or not allowed to. */
  publish(topic, schema, fields) {
    if (!this.isOpen || !this.can("clientPublish")) return false;
    let id = this.published.get(topic);
    if (id === undefined) {
      id = this.published.size + 1;
      this.published.set(topic, id);
      this.sendText({ op: "advertise", channels: [{ id, topic, encoding: "json", schemaName: schema }] });
    }
    this.socket.send(clientMessage(id, fields));
    return true;
  }
}
