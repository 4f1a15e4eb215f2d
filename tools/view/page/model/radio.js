// The radio map under the factory: where packets of a link whose model is "map" get through, by its
// access points (docs/reference/channel.md). Shadowing, and rasters in files, only the relay knows.

const LINKS = ["uplink", "downlink"];

function rows(value) {
  if (typeof value !== "string") return value ?? [];
  try {
    return JSON.parse(value);
  } catch {
    return [];
  }
}

/** SNR in dB at (x, y): of the strongest access point. */
export function snr_db(points, snr1m_db, exponent, x, y) {
  let best = -Infinity;
  for (const [ax, ay, own] of points) {
    const distance = Math.max(1, Math.hypot(x - ax, y - ay));
    best = Math.max(best, (own ?? snr1m_db) - 10 * exponent * Math.log10(distance));
  }
  return best;
}

/** Linear between the points of [[x, y]...], constant beyond. */
export function between(curve, x) {
  if (x <= curve[0][0]) return curve[0][1];
  for (let i = 1; i < curve.length; ++i) {
    const [x1, y1] = curve[i - 1];
    const [x2, y2] = curve[i];
    if (x <= x2) return y1 + ((y2 - y1) * (x - x1)) / (x2 - x1);
  }
  return curve[curve.length - 1][1];
}

/**
 * {link, x_m, y_m, width_m, height_m, columns, rows, prr: [...], points} over `box`; null if no link has such a
 * map. `get("uplink.map.snr50_db")` says what is set now.
 */
export function radioOf(get, box) {
  for (const link of LINKS) {
    const key = (name) => get(`${link}.map.${name}`);
    if (get(`${link}.model`) !== "map") continue;
    const points = rows(key("access_points"));
    if (!points.length) continue;
    const curve = rows(key("prr_curve"));
    const middle = key("snr50_db") ?? 10;
    const slope = key("slope_db") ?? 1;
    const width_m = box[2] - box[0];
    const height_m = box[3] - box[1];
    const radio = {
      link,
      points,
      width_m,
      height_m,
      x_m: box[0],
      y_m: box[1],
      prr: [],
      columns: Math.max(1, Math.ceil((60 * width_m) / Math.max(width_m, height_m))),
      rows: Math.max(1, Math.ceil((60 * height_m) / Math.max(width_m, height_m))),
    };
    for (let row = 0; row < radio.rows; ++row) {
      for (let column = 0; column < radio.columns; ++column) {
        const x = radio.x_m + ((column + 0.5) * width_m) / radio.columns;
        const y = radio.y_m + ((row + 0.5) * height_m) / radio.rows;
        const snr = snr_db(points, key("snr_1m_db") ?? 60, key("path_loss_exponent") ?? 3, x, y);
        radio.prr.push(curve.length ? between(curve, snr) : 1 / (1 + Math.exp(-(snr - middle) / slope)));
      }
    }
    return radio;
  }
  return null;
}
