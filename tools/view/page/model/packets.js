// Fate of each packet on one direction of the relay. A packet is offered on one channel
// (AGV/POSE) and comes out on another (CTRL/POSE) with the same number.

export const FLYING = "flying";
export const ARRIVED = "arrived";
export const LATE = "late"; // behind one that was sent after it: of no use any more
export const LOST = "lost";

/** A packet that has not arrived this long after a later one, or after it was sent, counts as lost. */
const OVERTAKEN_S = 0.3;
const KEPT = 4000;

export class Lane {
  constructor() {
    this.clear();
  }

  clear() {
    this.packets = [];
    this.bySeq = new Map();
    this.early = new Map(); // arrivals that were heard before their sending: two ways to one page
    this.newest = -Infinity; // number of the newest that has arrived
    this.newestArrival_s = -Infinity;
    this.longest_s = 0; // longest way of the last ones
  }

  sent(seq, time_s) {
    if (this.bySeq.has(seq)) return;
    const packet = { seq, sent_s: time_s, arrived_s: NaN, fate: FLYING };
    this.packets.push(packet);
    this.bySeq.set(seq, packet);
    const came_s = this.early.get(seq);
    if (came_s !== undefined) {
      this.early.delete(seq);
      this.arrived(seq, came_s);
    }
    if (this.packets.length > 2 * KEPT) {
      for (const old of this.packets.splice(0, KEPT)) this.bySeq.delete(old.seq);
    }
  }

  arrived(seq, time_s) {
    const packet = this.bySeq.get(seq);
    if (!packet) {
      this.early.set(seq, time_s);
      if (this.early.size > 100) this.early.delete(this.early.keys().next().value);
      return;
    }
    if (packet.fate === ARRIVED || packet.fate === LATE) return; // a copy
    packet.arrived_s = Math.max(time_s, packet.sent_s);
    packet.fate = seq < this.newest ? LATE : ARRIVED;
    if (seq > this.newest) {
      this.newest = seq;
      this.newestArrival_s = time_s;
    }
    const way_s = packet.arrived_s - packet.sent_s;
    this.longest_s = Math.max(way_s, this.longest_s * 0.98);
  }

  /** Decides which of those under way are lost; without any reception so far, there is no receiver. */
  settle(now_s, isRelayed = false) {
    if (!isRelayed && this.newest === -Infinity) return;
    const patience_s = Math.max(OVERTAKEN_S, 2 * this.longest_s);
    for (let i = this.packets.length - 1; i >= 0; --i) {
      const packet = this.packets[i];
      if (now_s - packet.sent_s > 60) break;
      if (packet.fate !== FLYING) continue;
      const overtaken = this.newest > packet.seq && now_s - packet.sent_s > this.longest_s + 0.05;
      if (overtaken || now_s - packet.sent_s > patience_s) packet.fate = LOST;
    }
  }

  /** Of what was sent in the last `window_s` and is decided: share that arrived; NaN if nothing. */
  received(now_s, window_s) {
    let decided = 0;
    let came = 0;
    for (let i = this.packets.length - 1; i >= 0; --i) {
      const packet = this.packets[i];
      if (packet.sent_s < now_s - window_s) break;
      if (packet.fate === FLYING) continue;
      ++decided;
      if (packet.fate !== LOST) ++came;
    }
    return decided ? came / decided : NaN;
  }
}
