// Which messages of a recording are to be shown when, as log_player.hpp has it in the server. No DOM, no
// clock: the caller passes the time.

export const SLOWEST = 0.1;
export const FASTEST = 100;
/** Of more messages than this that come at once only the latest of each channel are shown. */
export const MOST_AT_ONCE = 1000;

export class Player {
  /** `times_s` in order, `channels` the number of each message's channel; at the start, paused. */
  constructor(times_s, channels) {
    this.times_s = times_s;
    this.channels = channels;
    this.start_s = times_s[0] ?? 0;
    this.end_s = times_s[times_s.length - 1] ?? 0;
    this.held_s = this.start_s; // position at since_s
    this.since_s = 0;
    this.speed = 1;
    this.isOn = false;
    this.next = 0;
    this.jumped = true;
  }

  position(now_s) {
    if (!this.isOn) return this.held_s;
    return Math.min(this.end_s, this.held_s + (now_s - this.since_s) * this.speed);
  }

  /** False once it has come to its end. */
  playing(now_s) {
    return this.isOn && this.position(now_s) < this.end_s;
  }

  hold(now_s) {
    this.held_s = this.position(now_s);
    this.since_s = now_s;
  }

  /** From the start again, if it stands at the end. */
  play(now_s) {
    this.hold(now_s);
    if (this.held_s === this.end_s) this.seek(now_s, this.start_s);
    this.isOn = true;
  }

  pause(now_s) {
    this.hold(now_s);
    this.isOn = false;
  }

  setSpeed(now_s, speed) {
    this.hold(now_s);
    this.speed = Math.min(FASTEST, Math.max(SLOWEST, speed));
  }

  seek(now_s, position_s) {
    this.hold(now_s);
    this.held_s = Math.min(this.end_s, Math.max(this.start_s, position_s));
    this.jumped = true;
  }

  /** How many messages are not later than this. */
  countUntil(time_s) {
    let low = 0;
    let high = this.times_s.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.times_s[middle] <= time_s) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /** Of the messages from `begin` up to `end`, without that, the last of each channel, in order. */
  latest(begin, end) {
    const seen = new Set();
    const found = [];
    for (let i = end - 1; i >= begin; --i) {
      if (seen.has(this.channels[i])) continue;
      seen.add(this.channels[i]);
      found.push(i);
    }
    return found.reverse();
  }

  /** Numbers of the messages that have become due since the last call; after a jump the latest of each
   * channel before the new position. */
  due(now_s) {
    const end = this.countUntil(this.position(now_s));
    const begin = this.jumped ? 0 : this.next;
    const onlyLatest = this.jumped || end - begin > MOST_AT_ONCE;
    this.next = end;
    this.jumped = false;
    if (onlyLatest) return this.latest(begin, end);
    return Array.from({ length: Math.max(0, end - begin) }, (_, i) => begin + i);
  }
}
