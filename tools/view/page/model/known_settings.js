// Known properties of settings, by their names: units, and ranges that are useful for a hand on a slider.
// What is allowed, and the words of menus, the server says (/api/run.json).

/** The first row whose pattern fits the name. `main`: shown without unfolding. */
const KNOWN = [
  [/(^|\.)(prr|loss|probability|p|r|one_minus_h|one_minus_k|p_bad|p\d\d)$/, { min: 0, max: 1, step: 0.01 }],
  [/\.jitter\.correlation$/, { min: -0.99, max: 0.99, step: 0.01 }],
  [/\.jitter\.(mean|sd)_ms$/, { min: 0, max: 500, step: 5, unit: "ms" }],
  [/delay_ms$/, { min: 0, max: 2000, step: 10, unit: "ms" }],
  [/mean_(good|bad|cycle)_s$/, { min: 0.1, max: 60, step: 0.1, unit: "s" }],
  [/mean_burst$/, { min: 1, max: 50, step: 0.5 }],
  [/bits_per_s$/, { min: 0, max: 1e6, step: 1000, unit: "bit/s" }],
  [/slot\.(period|jitter)_ms$/, { min: 0, max: 500, step: 1, unit: "ms" }],
  [/snr50_db$/, { min: 0, max: 40, step: 0.5, unit: "dB" }],
  [/tau_s$/, { min: 0, max: 6, step: 0.05, unit: "s" }],
  [/rate_hz$/, { min: 1, max: 100, step: 1, unit: "Hz" }],
  [/horizon_s$/, { min: 0.5, max: 60, step: 0.5, unit: "s" }],
];

/** Of a channel model: they are only offered while it is chosen. */
const OF_MODEL = /\.(markov|gilbert_elliott|four_state|chain|map)\./;
const MAIN = /(^|\.)(prr|delay_ms|model|jitter\.law|jitter\.sd_ms|jitter\.mean_ms|tau_s|law)$/;
const UNITS = { _ms: "ms", _s: "s", _hz: "Hz", _m: "m", _mps: "m/s", _db: "dB", _rad: "rad" };

/** {unit, min, max, step} of a slider, {words} of a menu, as far as known; `told`: the server's row. */
export function known(name, told = {}) {
  const row = KNOWN.find(([pattern]) => pattern.test(name));
  const suffix = /_(ms|s|hz|mps|m|db|rad)$/.exec(name);
  const about = { unit: suffix ? UNITS[suffix[0]] : "", ...(row ? row[1] : {}) };
  if (about.min !== undefined) about.min = Math.max(about.min, told.low ?? -Infinity);
  if (about.max !== undefined) about.max = Math.min(about.max, told.high ?? Infinity);
  if (told.kind === "choice") about.words = told.choices;
  return about;
}

/** "network.uplink.markov.bad.prr" -> {group: "network.uplink", label: "markov bad prr", isMain}. */
export function place(name) {
  const parts = name.split(".");
  const depth = parts[0] === "network" && parts.length > 2 && /^(up|down)link$/.test(parts[1]) ? 2 : 1;
  const group = parts.length > depth ? parts.slice(0, depth).join(".") : "";
  const rest = group ? parts.slice(depth) : parts;
  const isMain = OF_MODEL.test(name) || (MAIN.test(name) && rest.length <= (rest[0] === "jitter" ? 2 : 1));
  const words = OF_MODEL.test(name) ? rest.slice(1) : rest;
  return {
    group,
    label: words
      .join(" ")
      .replace(/_(ms|s|hz|mps|m|db|rad)$/, "")
      .replaceAll("_", " "),
    isMain,
  };
}

export const GROUP_TITLES = {
  "network.uplink": "Uplink: poses to the controller",
  "network.downlink": "Downlink: commands to the vehicle",
  network: "Network",
  controller: "Controller",
  actuator: "Vehicle, when nothing comes",
  "": "Other",
};

/** The same setting of the other direction; null for what has none. */
export function twin(name) {
  if (name.startsWith("network.uplink.")) return name.replace("uplink", "downlink");
  if (name.startsWith("network.downlink.")) return name.replace("downlink", "uplink");
  return null;
}

const COMPANIONS = [
  [/jitter\.law$/, /^(uniform|normal|pareto|paretonormal|gamma)$/, [["sd_ms", 20]]],
  [
    /link\.model$/,
    /^gilbert_elliott$/,
    [
      ["gilbert_elliott.prr", 0.8],
      ["gilbert_elliott.mean_burst", 3],
    ],
  ],
  [/link\.model$/, /^four_state$/, [["four_state.p13", 0.1]]],
  [/link\.model$/, /^map$/, [["map.access_points", "[[0, 0]]"]]],
];

/** What a choice needs to be set with it, where nothing is set yet: [[name, value]...]. */
export function companions(name, value, get) {
  for (const [pattern, words, settings] of COMPANIONS) {
    if (!pattern.test(name) || !words.test(value)) continue;
    const before = name.slice(0, name.lastIndexOf(".") + 1);
    return settings.map(([rest, start]) => [before + rest, start]).filter(([other]) => !get(other));
  }
  return [];
}

/** The kind of a parameter (run_json.hpp): as told, else by its value. */
export function kindOf(value, told = {}) {
  if (told.kind) return told.kind;
  if (typeof value === "number") return "number";
  if (typeof value === "boolean") return "switch";
  return Array.isArray(value) ? "list" : "text";
}

/** What a hand wrote, as a value of this kind; undefined: none is. */
export function parseText(kind, text) {
  if (kind === "number" || kind === "whole number") {
    const value = Number(text);
    return text.trim() === "" || !Number.isFinite(value) ? undefined : value;
  }
  if (kind !== "list") return text;
  try {
    const list = JSON.parse(text);
    return Array.isArray(list) ? list : undefined;
  } catch {
    return undefined;
  }
}
