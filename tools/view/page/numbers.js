// The large numbers, the verdict, the drivetrain's state.

import { LOCALISATION, LOCALISATION_NAMES, driverOf, ellipse95, isWithin95 } from "./model/onboard.js";

const NONE = "–";

/** As toFixed(), but never "-0.00". */
export function fixed(value, digits) {
  return value.toFixed(digits).replace(/^-(?=[0.]*$)/, "");
}

function put(id, value, digits, level = "") {
  const output = document.getElementById(id);
  const text = Number.isFinite(value) ? fixed(value, digits) : NONE;
  if (output.value !== text) output.value = text;
  const box = output.parentElement;
  if (box.dataset.level !== level) box.dataset.level = level;
}

/** Two digits after the point below 10, one above: what can be read at a glance. */
function digits(value) {
  return Math.abs(value) < 10 ? 2 : 1;
}

/** As large as the box lets it be. */
function fit(box, text) {
  const key = `${text.textContent.length} ${box.clientWidth} ${document.body.className}`;
  if (!box.clientWidth || box.dataset.fitted === key) return;
  box.dataset.fitted = key;
  box.style.fontSize = "";
  if (box.scrollWidth <= box.clientWidth) return;
  const style = getComputedStyle(box);
  const padding = parseFloat(style.paddingLeft) + parseFloat(style.paddingRight);
  const share = (box.clientWidth - padding) / (box.scrollWidth - parseFloat(style.paddingLeft));
  box.style.fontSize = `${0.98 * Math.min(1, share) * parseFloat(style.fontSize)}px`;
}

export function showNumbers(model, now_s, lostBeyond_m, silence_s = 0) {
  const vehicle = model.shown;
  const truth = vehicle?.truth;
  const age_s = vehicle ? vehicle.age_s(now_s) : NaN;
  const verdict = model.verdict(lostBeyond_m, silence_s);
  document.getElementById("numbers").dataset.old = silence_s > 0;
  const sign = document.getElementById("verdict");
  if (sign.dataset.level !== verdict.level) sign.dataset.level = verdict.level;
  const text = document.getElementById("verdict-text");
  if (text.textContent !== verdict.text) text.textContent = verdict.text;
  fit(sign, text);
  const error = truth?.error_m;
  put("n-error", error, digits(error), error > lostBeyond_m ? "bad" : error > 1 ? "warn" : "");
  put("n-epsilon", truth?.epsilon_m, digits(truth?.epsilon_m));
  put("n-age", age_s, digits(age_s), age_s > 2 ? "warn" : "");
  put("n-speed", truth?.v_mps ?? vehicle?.drivetrain?.v_mps, 2);
  const { uplink, downlink } = model.links;
  put("n-up", 100 * vehicle?.uplink.received(now_s, 10), 0);
  put("n-down", 100 * vehicle?.downlink.received(now_s, 10), 0);
  put("n-up-delay", uplink?.delay_ms_p50, 0);
  put("n-down-delay", downlink?.delay_ms_p50, 0);
}

/** `get("prr")`: of this link. */
function channelText(get) {
  const name = get("model");
  if (name === undefined) return "?";
  const jitter = get("jitter.law");
  const more = jitter && jitter !== "none" ? `, ${jitter} jitter` : "";
  return name === "fixed"
    ? `PRR ${get("prr")}, ${get("delay_ms")} ms${more}`
    : name.replaceAll("_", " ") + more;
}

/** The scenario in a few words, links as they are set now: [[name, value]...]. */
export function factsOf(model) {
  const facts = [];
  const law = model.scenarioSetting("controller.law");
  if (law) {
    const isExternal = model.scenarioSetting("controller.external");
    facts.push(["law", isExternal ? "of another program" : law.replaceAll("_", " ")]);
  }
  if (!model.hasRelay) facts.push(["links", "no relay heard"]);
  for (const link of model.hasRelay ? ["uplink", "downlink"] : []) {
    if (model.linkSetting(`${link}.model`) !== undefined)
      facts.push([link, channelText((key) => model.linkSetting(`${link}.${key}`))]);
  }
  const rate_hz = model.scenarioSetting("sensor.rate_hz");
  if (rate_hz) facts.push(["poses", `${rate_hz} per s`]);
  const policy = model.scenarioSetting("actuator.policy");
  if (policy) facts.push(["without news", policy]);
  return facts;
}

export function showFacts(list, model) {
  const entries = factsOf(model).flatMap(([name, value]) => [
    Object.assign(document.createElement("dt"), { textContent: name }),
    Object.assign(document.createElement("dd"), { textContent: value }),
  ]);
  list.replaceChildren(...entries);
  list.hidden = entries.length === 0;
}

/** Who drives, of a vehicle that can by itself. */
export function showDriver(line, autonomy) {
  line.hidden = !autonomy;
  if (!autonomy) return;
  const { level, text, reason } = driverOf(autonomy);
  line.dataset.level = level;
  line.querySelector("#driver-state").textContent = text;
  line.querySelector("#driver-reason").textContent = reason;
}

/** How sure the localiser is, and how right. */
export function showLocalisation(panel, { newest, all }) {
  panel.hidden = !newest;
  if (!newest) return;
  const isLost = newest.state === LOCALISATION.searching;
  const last = isLost ? null : all.at(-1);
  const state = panel.querySelector("#l-state");
  state.textContent = LOCALISATION_NAMES[newest.state] ?? "?";
  state.parentElement.dataset.level = newest.state === LOCALISATION.tracking ? "" : "warn";
  put("l-error", last ? 100 * Math.hypot(last.dx_m, last.dy_m) : NaN, 1);
  put("l-axis", isLost ? NaN : 100 * ellipse95(newest).a_m, 1);
  const within = all.filter(({ said, dx_m, dy_m }) => isWithin95(said, dx_m, dy_m)).length;
  put("l-share", all.length ? (100 * within) / all.length : NaN, 0);
}

/** Without a report for this long, tether-link itself is gone: it reports once a second. */
const LINK_SILENT_S = 3;

/** How a peer of tether-link stands, `since_s` after its report: {level, text}. */
export function peerOf(report, since_s) {
  if (since_s > LINK_SILENT_S) return { level: "warn", text: `no report for ${since_s.toFixed(0)} s` };
  if (!report.up) {
    const text = report.age_s < 0 ? "DOWN, never heard" : `DOWN for ${(report.age_s + since_s).toFixed(1)} s`;
    return { level: "bad", text };
  }
  const alive = report.path.filter((_, i) => report.path_alive[i]);
  const dead = report.path.filter((_, i) => !report.path_alive[i]);
  const paths = `up by ${alive.join(", ")}${dead.length ? `, not by ${dead.join(", ")}` : ""}`;
  if (!report.offset_known) return { level: dead.length ? "warn" : "good", text: `${paths} · clock unknown` };
  const clock = `clock ${fixed(report.offset_min_ms, 1)} to ${fixed(report.offset_max_ms, 1)} ms ahead of ours`;
  if (report.clocks_apart) return { level: "warn", text: `${paths} · CLOCKS APART: ${clock}` };
  return { level: dead.length ? "warn" : "good", text: `${paths} · ${clock}` };
}

export function showPeers(panel, model, heard_s) {
  panel.hidden = model.peers.size === 0;
  const lines = [...model.peers].map(([name, peer]) => {
    const { level, text } = peerOf(peer.report, model.isLive ? heard_s - peer.heard_s : 0);
    const line = document.createElement("p");
    line.dataset.level = level;
    line.append(Object.assign(document.createElement("strong"), { textContent: name }), ` ${text}`);
    return line;
  });
  panel.querySelector("#peers").replaceChildren(...lines);
}

export function showDrivetrain(panel, state) {
  panel.hidden = !state;
  if (!state) return;
  const name = panel.querySelector("#can-state");
  name.textContent = state.state_name.toUpperCase();
  name.dataset.state = state.state_name;
  panel.querySelector("#can-reason").textContent = state.reason;
  panel.querySelector("#can-detail").textContent =
    `bus ${state.bus} · command ${state.command_age_s < 0 ? "none yet" : `${state.command_age_s.toFixed(2)} s old`} · ` +
    `${fixed(state.v_mps, 2)} m/s, ${fixed(state.omega_radps, 2)} rad/s · stopped and disarmed ${state.disarms}×`;
}
