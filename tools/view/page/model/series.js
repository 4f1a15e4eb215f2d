// Samples of several quantities at common times, the last `window_s` of them, for plots.

const GAP_S = 2;

export class Series {
  constructor(names, window_s) {
    this.names = names;
    this.window_s = window_s;
    this.clear();
  }

  clear() {
    this.time_s = [];
    this.columns = Object.fromEntries(this.names.map((name) => [name, []]));
  }

  get last_s() {
    return this.time_s.length ? this.time_s[this.time_s.length - 1] : -Infinity;
  }

  /** What is not given, or is not a number, is a gap. */
  add(time_s, values) {
    if (time_s > this.last_s + GAP_S && this.time_s.length) {
      // the time in between was not observed
      this.time_s.push(time_s - GAP_S);
      for (const name of this.names) this.columns[name].push(null);
    }
    this.time_s.push(time_s);
    for (const name of this.names) {
      const value = values[name];
      this.columns[name].push(Number.isFinite(value) ? value : null);
    }
    let old = 0;
    while (this.time_s[old] < time_s - this.window_s - 1) ++old;
    if (old > 100) {
      this.time_s.splice(0, old);
      for (const name of this.names) this.columns[name].splice(0, old);
    }
  }
}

/** A way that was driven: its latest points, at least `apart_m` from each other. */
export class Trail {
  constructor(most, apart_m = 0.05) {
    this.most = most;
    this.apart_m = apart_m;
    this.clear();
  }

  clear() {
    this.x = [];
    this.y = [];
  }

  add(x_m, y_m) {
    const n = this.x.length;
    if (n && Math.hypot(x_m - this.x[n - 1], y_m - this.y[n - 1]) < this.apart_m) return;
    this.x.push(x_m);
    this.y.push(y_m);
    if (n > 1.25 * this.most) {
      this.x.splice(0, n - this.most);
      this.y.splice(0, n - this.most);
    }
  }
}
