// State of the page, from the messages that it received. No DOM, no clock: the caller passes the time.

import { Series } from "./series.js";
import { ChannelStatistics } from "./statistics.js";
import { PLAYBACK, isControlSide, isVehicleSide, splitTopic, vehicleKey } from "./topics.js";
import { Vehicle } from "./vehicle.js";

export const PLOTTED_S = 30;
const SAMPLE_S = 0.05;
const RATE_WINDOW_S = 5;
/** A step back of the run's time by more than this: another run, or a log that was wound back. */
const BACK_S = 0.5;
/** So far ahead of the last message does the shown time run on. */
const AHEAD_S = 0.15;
/** Silence that is more than a late message. */
const SILENT_S = 1.5;
/** A run whose last message is not further from its end was not cut off. */
const END_S = 0.3;

const PLOTTED = [
  "error_m",
  "epsilon_m",
  "age_s",
  "v_mps",
  "omega_radps",
  "v_sent_mps",
  "omega_sent_radps",
  "uplink_per_s",
  "downlink_per_s",
  "uplink_prr",
  "downlink_prr",
];

/** "a.b" in {a: {b: …}}; undefined if it is not there. */
const valueAt = (table, name) => name.split(".").reduce((inner, part) => inner?.[part], table);

const noReports = () => ({
  links: { uplink: null, downlink: null },
  states: { uplink: [], downlink: [] },
});

export class Model {
  constructor() {
    this.vehicles = new Map();
    this.channels = new Map(); // topic -> ChannelStatistics
    this.parameters = new Map(); // name -> value
    this.about = null; // what the server says of the run, /api/run.json
    this.main = ""; // key of the run's own vehicle
    this.selected = null; // key of the vehicle that is looked at
    this.series = new Series(PLOTTED, PLOTTED_S);
    this.generation = 0; // counts restarts of the model
    this.isCut = false; // the connection is gone
    this.restart();
  }

  restart() {
    for (const vehicle of this.vehicles.values()) vehicle.clear();
    for (const channel of this.channels.values()) channel.clear();
    this.series.clear();
    this.reports = new Map(); // of a vehicle's links, by its key: {links, states}
    this.peers = new Map(); // of tether-link, by name: {report, heard_s}
    this.clock = null; // {run_s, heard_s, source}
    this.rate = 1; // seconds of the run per second
    this.heard_s = NaN; // when the last message came
    this.run = 0;
    this.offset_s = null; // the messages' stamps minus the run's time
    this.isGuess = false;
    ++this.generation;
  }

  /** `heard_s`: seconds of a clock that never steps, when the message came here. */
  hear(message, heard_s) {
    const { topic, fields, time_s } = message;
    const part = splitTopic(topic);
    // by a view, of a relay that may not be there
    const isAsked = part?.base === "NET" && part.name.endsWith("SET");
    if (part?.base === "LINK") {
      // It is no news of a vehicle, and its time is not the run's.
      if (part.name === "REPORT") this.peers.set(fields.peer, { report: fields, heard_s });
    } else if (!isAsked) {
      this.heard_s = heard_s;
      if (part) this.hearPart(part, fields, time_s, heard_s);
    }
    let channel = this.channels.get(topic);
    if (!channel) this.channels.set(topic, (channel = new ChannelStatistics(topic, message.schema)));
    channel.add(time_s, message.bytes, fields);
  }

  hearPart(part, fields, time_s, heard_s) {
    if (part.base === "SIM" && (part.name === "CLOCK" || part.name === "TRUTH")) {
      this.hearClock(part, fields, time_s, heard_s);
    } else if (this.offset_s === null && Number.isFinite(fields.utime)) {
      this.offset_s = time_s - fields.utime / 1e6; // a guess, for logs without truth or clock
      this.isGuess = true;
    }
    if (!this.clock || this.clock.source !== "SIM") this.tick(fields.utime / 1e6, heard_s, "any");
    const at_s = time_s - (this.offset_s ?? 0);
    if (part.base === "SIM") {
      if (part.name === "TRUTH") this.vehicle(part.vehicle).hearTruth(fields, heard_s);
    } else if (part.base === "NET") {
      if (part.name.endsWith("UPLINK")) this.hearLink(part.vehicle, "uplink", fields);
      if (part.name.endsWith("DOWNLINK")) this.hearLink(part.vehicle, "downlink", fields);
    } else if (part.base === "CAN") {
      if (part.name === "STATE") this.vehicle(part.vehicle).drivetrain = fields;
      if (part.name === "ODOMETRY") this.vehicle(part.vehicle).odometry = fields;
    } else if (isControlSide(part)) {
      this.vehicle(part.vehicle).hearControlSide(part.name, fields, at_s);
    } else if (
      isVehicleSide(part) &&
      (part.name === "POSE" || this.vehicles.has(part.vehicle || this.main))
    ) {
      const vehicle = this.vehicle(part.vehicle);
      vehicle.name = part.side;
      vehicle.hearVehicleSide(part.name, fields, at_s);
    }
  }

  /** The relay reports at each change of a link's state, and now and then. */
  hearLink(named, link, report) {
    const key = named || this.main;
    if (!this.reports.has(key)) this.reports.set(key, noReports());
    const reports = this.reports.get(key);
    reports.links[link] = report;
    const states = reports.states[link];
    if (states.length && states[states.length - 1].state === report.state) return;
    states.push({ from_s: report.utime / 1e6, state: report.state });
    if (states.length > 400) states.splice(0, 200);
  }

  /** Newest reports {uplink, downlink} on the links of the vehicle that is looked at. */
  get links() {
    return this.reportsOfShown.links;
  }

  /** {uplink: [{from_s, state}...], downlink}, in order. */
  get states() {
    return this.reportsOfShown.states;
  }

  get reportsOfShown() {
    return this.reports.get(this.selected ?? this.main) ?? noReports();
  }

  hearClock(part, fields, time_s, heard_s) {
    const run_s = fields.utime / 1e6;
    const anotherRun = part.name === "CLOCK" && this.run !== 0 && fields.run !== this.run;
    if (anotherRun || (this.clock?.source === "SIM" && run_s < this.clock.run_s - BACK_S)) this.restart();
    if (this.isGuess) this.forgetPackets();
    this.isGuess = false;
    this.offset_s = time_s - run_s;
    if (part.name === "CLOCK") {
      this.run = fields.run;
      if (fields.rate > 0) this.rate = fields.rate;
    }
    this.tick(run_s, heard_s, "SIM");
  }

  forgetPackets() {
    for (const vehicle of this.vehicles.values()) {
      vehicle.uplink.clear();
      vehicle.downlink.clear();
    }
  }

  tick(run_s, heard_s, source) {
    if (!Number.isFinite(run_s)) return;
    if (this.clock && source === this.clock.source && run_s <= this.clock.run_s) return;
    this.clock = { run_s, heard_s, source };
  }

  hearAbout(about) {
    this.about = about;
    const main = vehicleKey(about.vehicle ?? "");
    if (main !== this.main) {
      // earlier messages belong to a vehicle by the wrong name
      this.main = main;
      this.vehicles.clear();
      this.selected = this.isFleet ? main : null;
    }
    ++this.generation;
  }

  get isFleet() {
    return (this.about?.vehicles?.length ?? 0) > 1;
  }

  /** What the server says of a fleet's vehicle: {name, shape, path, scenario}; undefined of others. */
  aboutVehicle(vehicle) {
    return this.about?.vehicles?.find(({ name }) => name === vehicle?.name);
  }

  /** Of the vehicle that is looked at, "controller.law"; undefined if it is not known. */
  scenarioSetting(name) {
    return valueAt(this.aboutVehicle(this.shown)?.scenario, name) ?? valueAt(this.about?.scenario, name);
  }

  /**
   * "uplink.map.snr50_db" of the vehicle that is looked at: as it is in force now, else as the scenario says.
   * The server tells what the first vehicle's links have; what another has of its own it has until both are set.
   */
  linkSetting(name) {
    const told = this.parameters.get(`network.${name}`);
    const own = this.scenarioSetting(`channel.${name}`);
    if (told === undefined || !this.isFleet) return told ?? own;
    const [{ scenario: ofFirst }] = this.about.vehicles;
    const begun = valueAt(ofFirst, `channel.${name}`) ?? valueAt(this.about.scenario, `channel.${name}`);
    return told === begun ? own : told;
  }

  /** Changes when the radio map does. */
  radioSettings() {
    if (this.linkSetting("uplink.model") !== "map" && this.linkSetting("downlink.model") !== "map") return "";
    return [...this.parameters].filter(([name]) => /\.(map\.|model)/.test(name)).join();
  }

  /** Channels such as SIM/TRUTH name no vehicle: they are of the run's own. */
  vehicle(named) {
    const key = named || this.main;
    let vehicle = this.vehicles.get(key);
    if (!vehicle) {
      vehicle = new Vehicle(key, this.vehicles.size < 12 ? 3000 : 40, this.vehicles.size < 12 ? 0.05 : 0.25);
      this.vehicles.set(key, vehicle);
      if (this.selected === null) this.selected = key;
    }
    return vehicle;
  }

  /** The vehicle that is looked at; null before there is one. */
  get shown() {
    return this.vehicles.get(this.selected) ?? null;
  }

  /**
   * The run's time; between messages it runs on a little, unless a log stands still. Where a live network
   * falls silent it goes on: what is known grows older.
   */
  now_s(heard_s) {
    if (!this.clock) return 0;
    if (this.parameters.get(PLAYBACK.playing) === false) return this.clock.run_s;
    const since_s = Math.max(0, heard_s - this.clock.heard_s);
    if (this.isLive && since_s > this.patience_s && !this.hasEnded) return this.clock.run_s + since_s * this.rate;
    const speed = Number(this.parameters.get(PLAYBACK.speed) ?? 1) || 1;
    return this.clock.run_s + Math.min(AHEAD_S, since_s) * speed;
  }

  get isLive() {
    return this.about?.kind === "live";
  }

  /** Longer in slow motion, where messages are rare. */
  get patience_s() {
    return Math.max(SILENT_S, 0.1 / this.rate);
  }

  /** A run that has been shown up to its end, as far as that is known. */
  get hasEnded() {
    if (!this.clock || this.about?.kind === "log") return false;
    const end_s = this.parameters.get(PLAYBACK.end) ?? this.about?.scenario?.run?.duration_s;
    const speed = Number(this.parameters.get(PLAYBACK.speed) ?? 1) || 1;
    return this.clock.run_s >= end_s - END_S * Math.max(1, speed, this.rate);
  }

  /**
   * For how long nothing has been heard of the vehicle that is looked at (without truth: of anything);
   * 0 as long as that is nothing unusual, and in a log, which may have gaps.
   */
  silence_s(heard_s) {
    if (!this.shown || (!this.isLive && !this.isCut)) return 0;
    const since_s = heard_s - (this.shown?.truthHeard_s ?? this.heard_s);
    return since_s > this.patience_s ? since_s : 0;
  }

  /** Whether there is anything that the network's settings are of. */
  get hasRelay() {
    return !this.isLive || this.reports.size > 0;
  }

  /** Once per picture: decides on packets, and adds what is plotted. */
  sample(now_s, silence_s = 0) {
    const vehicle = this.shown;
    if (!vehicle || silence_s > 0 || now_s <= this.series.last_s + SAMPLE_S) return;
    const { links } = this;
    vehicle.uplink.settle(now_s, links.uplink !== null);
    vehicle.downlink.settle(now_s, links.downlink !== null);
    const { truth, report, command } = vehicle;
    this.series.add(now_s, {
      error_m: truth?.error_m,
      epsilon_m: truth?.epsilon_m,
      age_s: vehicle.age_s(now_s),
      v_mps: truth?.v_mps,
      omega_radps: truth?.omega_radps,
      v_sent_mps: report?.v_mps ?? command?.v_mps,
      omega_sent_radps: report?.omega_radps ?? command?.omega_radps,
      uplink_per_s: this.arrivals_per_s(vehicle.uplink, now_s),
      downlink_per_s: this.arrivals_per_s(vehicle.downlink, now_s),
      uplink_prr: vehicle.uplink.received(now_s, RATE_WINDOW_S),
      downlink_prr: vehicle.downlink.received(now_s, RATE_WINDOW_S),
    });
  }

  /** Over the last seconds, or over those since the first packet; NaN in the first second. */
  arrivals_per_s(lane, now_s) {
    const from_s = Math.max(now_s - RATE_WINDOW_S, lane.packets[0]?.sent_s ?? now_s);
    if (now_s - from_s < 1) return NaN;
    let count = 0;
    for (let i = lane.packets.length - 1; i >= 0; --i) {
      const packet = lane.packets[i];
      if (packet.sent_s < from_s - lane.longest_s) break;
      if (packet.arrived_s > from_s) ++count;
    }
    return count / (now_s - from_s);
  }

  /** How the run stands, in a word for those in the last row; `level`: good, warn, bad. */
  verdict(lostBeyond_m = 5, silence_s = 0) {
    if (silence_s > 0 && this.hasEnded) return { level: "none", text: "RUN ENDED" };
    if (silence_s > 0) {
      const seconds = silence_s.toFixed(silence_s < 100 ? 1 : 0);
      return { level: "warn", text: `NO NEWS for ${seconds} s` };
    }
    const truth = this.shown?.truth;
    if (!truth) return { level: "none", text: this.vehicles.size ? "NO TRUTH" : "WAITING" };
    if (truth.lost && truth.error_m > lostBeyond_m) return { level: "bad", text: "LOST" };
    if (truth.wall_contact) return { level: "bad", text: "AT THE WALL" };
    if (truth.error_m > lostBeyond_m) return { level: "bad", text: "OFF THE PATH" };
    if (truth.error_m > 1) return { level: "warn", text: "NEAR THE PATH" };
    if (truth.lost) return { level: "warn", text: "WAS LOST" };
    return { level: "good", text: "ON THE PATH" };
  }
}
