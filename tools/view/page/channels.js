// Lists the channels of this server and counts their messages.

const state = document.getElementById("state");
const list = document.getElementById("channels");
const channels = new Map(); // by id: its element, topic and count
const here = new URL(location.href);
const socket = new WebSocket(`ws://${here.host}/${here.search}`, ["foxglove.websocket.v1"]);
socket.binaryType = "arraybuffer";
socket.onopen = () => (state.textContent = "connected");
socket.onclose = () => (state.textContent = "the server has ended");

const show = (channel) =>
  (channel.element.textContent = `${channel.topic} (${channel.type}): ${channel.count}`);

function advertised({ id, topic, schemaName }) {
  const channel = { topic, type: schemaName, count: 0, element: document.createElement("li") };
  channels.set(id, channel);
  list.append(channel.element);
  show(channel);
  // The channel's id does as the subscription's.
  socket.send(JSON.stringify({ op: "subscribe", subscriptions: [{ id, channelId: id }] }));
}

function unadvertised(id) {
  channels.get(id)?.element.remove();
  channels.delete(id);
}

function counted(data) {
  const view = new DataView(data);
  const channel = view.getUint8(0) === 1 && channels.get(view.getUint32(1, true));
  if (!channel) return;
  channel.count += 1;
  show(channel);
}

socket.onmessage = ({ data }) => {
  if (data instanceof ArrayBuffer) return counted(data);
  const message = JSON.parse(data);
  if (message.op === "serverInfo") document.getElementById("title").textContent = message.name;
  if (message.op === "advertise") message.channels.forEach(advertised);
  if (message.op === "unadvertise") message.channelIds.forEach(unadvertised);
};
