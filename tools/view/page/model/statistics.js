// Statistics of one channel, as `tether echo` has them, over the last seconds: rate, numbers that were
// skipped, jitter. Times come with the messages.

export const WINDOW_S = 10;

/** Value below which the share q of the sorted values lies. */
export function quantile(sorted, q) {
  if (sorted.length === 0) return NaN;
  return sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))];
}

/** Jitter as in `tether echo`: |interval - median interval|; its median and 99th percentile. */
export function jitter(times_s) {
  const intervals = [];
  for (let i = 1; i < times_s.length; ++i) intervals.push(times_s[i] - times_s[i - 1]);
  const middle = quantile(
    intervals.slice().sort((a, b) => a - b),
    0.5,
  );
  const off = intervals.map((interval) => Math.abs(interval - middle)).sort((a, b) => a - b);
  return { p50_s: quantile(off, 0.5), p99_s: quantile(off, 0.99) };
}

export class ChannelStatistics {
  constructor(topic, schema) {
    this.topic = topic;
    this.schema = schema;
    this.count = 0;
    this.latest = null;
    this.clear();
  }

  clear() {
    this.times_s = [];
    this.sizes = [];
    this.numbers = [];
    this.head = 0; // what is before it is older than the window
  }

  add(time_s, bytes, fields) {
    const last = this.times_s[this.times_s.length - 1];
    if (last !== undefined && time_s < last - 1) this.clear(); // a log was wound back
    ++this.count;
    this.latest = fields;
    if (time_s <= 0) return; // all that is sent before t = 0 has this stamp: it says nothing of a rate
    this.times_s.push(time_s);
    this.sizes.push(bytes);
    this.numbers.push(Number.isFinite(fields.seq) ? fields.seq : NaN);
    while (this.times_s[this.head] < time_s - WINDOW_S) ++this.head;
    if (this.head > 1000 && this.head > this.times_s.length / 2) {
      this.times_s = this.times_s.slice(this.head);
      this.sizes = this.sizes.slice(this.head);
      this.numbers = this.numbers.slice(this.head);
      this.head = 0;
    }
  }

  /** At the time `now_s`: rate_hz, loss (share of numbers that never came), jitter, kB/s, age. */
  summary(now_s) {
    let from = this.head;
    while (from < this.times_s.length && this.times_s[from] < now_s - WINDOW_S) ++from;
    const times = this.times_s.slice(from);
    const n = times.length;
    const last = this.times_s[this.times_s.length - 1];
    const span_s = n > 1 ? times[n - 1] - times[0] : 0;
    const seen = new Set(this.numbers.slice(from).filter((x) => !Number.isNaN(x)));
    let lowest = Infinity;
    let highest = -Infinity;
    for (const x of seen) {
      if (x < lowest) lowest = x;
      if (x > highest) highest = x;
    }
    const expected = seen.size ? highest - lowest + 1 : 0;
    const bytes = this.sizes.slice(from).reduce((sum, size) => sum + size, 0);
    return {
      count: this.count,
      rate_hz: span_s > 0 ? (n - 1) / span_s : 0,
      missed: expected - seen.size,
      loss: expected > 1 ? (expected - seen.size) / expected : 0,
      kB_per_s: span_s > 0 ? bytes / 1000 / span_s : 0,
      age_s: last === undefined ? NaN : Math.max(0, now_s - last),
      ...(n > 2 ? jitter(times) : { p50_s: NaN, p99_s: NaN }),
    };
  }
}
