// Both links as packets cross them, over time: each packet is a line from the moment when it was sent
// (at the sender's edge of the lane) to the moment when it came out; so delay is a slope. What was lost
// ends in a cross half-way; what came too late, behind a newer one, has a ring.

import { Surface } from "./canvas.js";
import { ARRIVED, FLYING, LATE, LOST } from "../model/packets.js";
import { colour } from "./theme.js";

const SHOWN_S = 12;
const LEFT = 88;
const RIGHT = 16;

/** Of models whose states are better and worse ones; of a map they are access points. */
const WITH_STATES = ["markov", "gilbert_elliott", "four_state", "chain"];
const GOOD_AND_BAD = ["markov", "gilbert_elliott"];

/** [{from_s, name}...]: since when a link's channel is in a state; no name for the good, or only, one. */
function statesOf(model, link) {
  const kind = model.linkSetting(`${link}.model`);
  if (kind !== undefined && !WITH_STATES.includes(kind)) return [];
  const bad = GOOD_AND_BAD.includes(kind) ? "bad" : null;
  return model.states[link].map(({ from_s, state }) => ({
    from_s,
    name: state === 0 ? "" : (bad ?? `state ${state}`),
  }));
}

export class Lanes {
  constructor(canvas) {
    this.surface = new Surface(canvas);
  }

  draw(model, now_s) {
    const c = this.surface.begin();
    const vehicle = model.shown;
    const half = (this.surface.height - 20) / 2;
    this.drawLane(
      c,
      "uplink",
      "poses",
      4,
      half,
      ["vehicle", "controller"],
      vehicle?.uplink,
      statesOf(model, "uplink"),
      now_s,
    );
    this.drawLane(
      c,
      "downlink",
      "commands",
      4 + half,
      half,
      ["controller", "vehicle"],
      vehicle?.downlink,
      statesOf(model, "downlink"),
      now_s,
    );
    this.drawTimes(c);
  }

  x(time_s, now_s) {
    return LEFT + (this.surface.width - LEFT - RIGHT) * (1 - (now_s - time_s) / SHOWN_S);
  }

  drawTimes(c) {
    c.font = "12px system-ui, sans-serif";
    c.fillStyle = colour("quiet");
    c.textBaseline = "alphabetic";
    for (let ago = 0; ago <= SHOWN_S; ago += 2) {
      const x = this.x(-ago, 0);
      c.textAlign = ago === 0 ? "right" : "center";
      c.fillText(ago === 0 ? "now" : `−${ago} s`, ago === 0 ? x + RIGHT - 4 : x, this.surface.height - 6);
    }
  }

  drawLane(c, name, cargo, top, height, ends, lane, states, now_s) {
    const from = top + 12;
    const to = top + height - 10;
    c.font = "650 13px system-ui, sans-serif";
    c.textAlign = "left";
    c.textBaseline = "middle";
    c.fillStyle = colour("ink");
    c.fillText(name, 10, (from + to) / 2 - 1);
    c.font = "11px system-ui, sans-serif";
    c.fillStyle = colour("quiet");
    c.fillText(ends[0], 10, from);
    c.fillText(ends[1], 10, to);
    c.fillText(cargo, 10, (from + to) / 2 + 13);
    this.drawStates(c, states, from, to, now_s);
    c.strokeStyle = colour("line");
    c.lineWidth = 1.5;
    for (const y of [from, to]) {
      c.beginPath();
      c.moveTo(LEFT, y);
      c.lineTo(this.surface.width - RIGHT, y);
      c.stroke();
    }
    if (lane) this.drawPackets(c, lane, from, to, now_s);
  }

  /** When the link's channel was in another state than its good, or only, one. */
  drawStates(c, states, from, to, now_s) {
    c.fillStyle = colour("lost");
    c.font = "600 12px system-ui, sans-serif";
    c.textAlign = "left";
    states.forEach(({ from_s, name }, i) => {
      const until_s = states[i + 1]?.from_s ?? now_s;
      if (!name || until_s < now_s - SHOWN_S) return;
      const x = Math.max(LEFT, this.x(from_s, now_s));
      const width = this.x(until_s, now_s) - x;
      c.globalAlpha = 0.16;
      c.fillRect(x, from, width, to - from);
      c.globalAlpha = 1;
      if (width > 40) c.fillText(name, x + 4, from - 6);
    });
  }

  drawPackets(c, lane, from, to, now_s) {
    c.save();
    c.beginPath();
    c.rect(LEFT, from - 8, this.surface.width - LEFT - RIGHT + 8, to - from + 16);
    c.clip();
    const good = [];
    const marks = [];
    for (let i = lane.packets.length - 1; i >= 0; --i) {
      const packet = lane.packets[i];
      if (packet.sent_s < now_s - SHOWN_S - 3) break;
      if (packet.fate === ARRIVED) good.push(packet);
      else marks.push(packet);
    }
    const apart = (this.surface.width - LEFT - RIGHT) / Math.max(1, good.length + marks.length);
    const dense = apart < 5; // no room for large marks
    this.drawGood(c, good, from, to, now_s, dense);
    for (const packet of marks) this.drawMark(c, packet, lane, from, to, now_s, dense);
    c.restore();
  }

  drawGood(c, packets, from, to, now_s, dense) {
    c.strokeStyle = c.fillStyle = colour("truth");
    c.lineWidth = dense ? 1 : 2;
    c.beginPath();
    for (const packet of packets) {
      c.moveTo(this.x(packet.sent_s, now_s), from);
      c.lineTo(this.x(packet.arrived_s, now_s), to);
    }
    c.stroke();
    c.beginPath();
    const r = dense ? 1.2 : 3.5;
    for (const packet of packets) {
      const x = this.x(packet.arrived_s, now_s);
      c.moveTo(x + r, to);
      c.arc(x, to, r, 0, 7);
    }
    c.fill();
  }

  drawMark(c, packet, lane, from, to, now_s, dense) {
    const x = this.x(packet.sent_s, now_s);
    const middle = (from + to) / 2;
    c.lineWidth = dense ? 1 : 2;
    if (packet.fate === LOST) {
      c.strokeStyle = colour("lost");
      const dies = this.x(packet.sent_s + lane.longest_s / 2, now_s);
      const r = dense ? 2.5 : 5;
      c.beginPath();
      c.moveTo(x, from);
      c.lineTo(dies, middle - r);
      c.moveTo(dies - r, middle - r);
      c.lineTo(dies + r, middle + r);
      c.moveTo(dies + r, middle - r);
      c.lineTo(dies - r, middle + r);
      c.stroke();
    } else if (packet.fate === LATE) {
      const end = this.x(packet.arrived_s, now_s);
      c.strokeStyle = colour("newest");
      c.beginPath();
      c.moveTo(x, from);
      c.lineTo(end, to - 5);
      c.moveTo(end + 5, to);
      c.arc(end, to, 5, 0, 7);
      c.stroke();
    } else if (packet.fate === FLYING) {
      const share = Math.min(0.95, (now_s - packet.sent_s) / Math.max(0.05, lane.longest_s || 0.3));
      const y = from + (to - from) * share;
      c.strokeStyle = c.fillStyle = colour("ink");
      c.beginPath();
      c.moveTo(x, from);
      c.lineTo(this.x(now_s, now_s), y);
      c.globalAlpha = 0.4;
      c.stroke();
      c.globalAlpha = 1;
      c.beginPath();
      c.arc(this.x(now_s, now_s), y, 5, 0, 7);
      c.fill();
    }
  }
}
