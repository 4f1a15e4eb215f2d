// State of one vehicle, from the messages about it: the truth, what its controller believes,
// and the packets between them. Times are seconds of the run.

import { SentCommands, followPlan, predictByPlans } from "./belief.js";
import { Fixes, PoseHistory, endOfScan_s, pointsOfScan } from "./onboard.js";
import { Lane } from "./packets.js";
import { Trail } from "./series.js";

const PLANS_KEPT = 600;
const GAP_US = 2_000_000;

export class Vehicle {
  constructor(key, trailPoints, apart_m) {
    this.key = key;
    this.name = key ? `AGV${key}` : "AGV";
    this.trail = new Trail(trailPoints, apart_m);
    this.reference = new Trail(2000, 0.1);
    this.truths = new PoseHistory();
    this.fixes = new Fixes();
    this.uplink = new Lane();
    this.downlink = new Lane();
    this.clear();
  }

  clear() {
    this.pose = null; // as its sensor measured it
    this.truth = null;
    this.truthHeard_s = null; // when it came here
    this.believed = null; // the newest pose that the controller has
    this.report = null;
    this.command = null; // the newest that arrived at the vehicle
    this.sent = new SentCommands();
    this.plans = new Map();
    this.newestPlan = null;
    this.drivetrain = null;
    this.odometry = null;
    this.scan = null; // waits for where the vehicle was when it was measured
    this.points = []; // where the beams of the last one ended
    this.autonomy = null;
    for (const kept of [this.trail, this.reference, this.truths, this.fixes, this.uplink, this.downlink]) kept.clear();
  }

  /** Where it is, as well as we know. */
  get place() {
    return this.truth ?? this.pose;
  }

  hearTruth(truth, heard_s) {
    if (this.truth && truth.utime - this.truth.utime > GAP_US) {
      // a jump in a log: the path in between was not observed
      this.trail.clear();
      this.reference.clear();
      this.truths.clear();
      this.fixes.clear();
    }
    this.truth = truth;
    this.truthHeard_s = heard_s;
    this.trail.add(truth.x_m, truth.y_m);
    this.reference.add(truth.x_ref_m, truth.y_ref_m);
    this.truths.add(truth.utime / 1e6, truth);
    this.fixes.settle(this.truths);
    this.placeScan();
  }

  hearScan(scan) {
    this.scan = scan;
    this.placeScan();
  }

  /** From where it really was at each beam, once that is known; without truth, from its reported pose. */
  placeScan() {
    if (!this.scan || (this.truth && this.truths.newest_s < endOfScan_s(this.scan) - 1e-3)) return;
    const said = this.fixes.newest ?? this.pose;
    const poseAt = this.truth ? (t_s) => this.truths.at(t_s) : () => said;
    this.points = pointsOfScan(this.scan, poseAt);
    this.scan = null;
  }

  hearVehicleSide(name, fields, at_s) {
    if (name === "POSE") {
      this.pose = fields;
      if (!this.truth) this.trail.add(fields.x_m, fields.y_m);
      this.uplink.sent(fields.seq, at_s);
    } else if (name === "SCAN") {
      this.hearScan(fields);
    } else if (name === "LOCALISATION") {
      this.fixes.hear(fields, this.truths);
    } else if (name === "AUTONOMY") {
      this.hearAutonomy(fields);
    } else if (name === "CMD_VEL" || name === "PLAN") {
      this.downlink.arrived(fields.seq, at_s);
      if (!this.command || fields.seq > this.command.seq) this.command = fields;
    }
  }

  hearControlSide(name, fields, at_s) {
    if (name === "POSE") {
      this.uplink.arrived(fields.seq, at_s);
      if (!this.believed || fields.utime >= this.believed.utime) this.believed = fields;
    } else if (name === "CMD_VEL") {
      this.downlink.sent(fields.seq, at_s);
      this.sent.add(at_s, fields.v_mps, fields.omega_radps);
    } else if (name === "PLAN") {
      this.downlink.sent(fields.seq, at_s);
      this.hearPlan(fields);
    } else if (name === "REPORT") {
      this.report = fields;
    } else if (name === "LOCALISATION") {
      this.fixes.hear(fields, this.truths); // by a localiser there, or what came of the vehicle's: no newer
    } else if (name === "AUTONOMY") {
      this.hearAutonomy(fields);
    }
  }

  /** On the vehicle's side, or behind the network, where it comes later. */
  hearAutonomy(state) {
    if (!this.autonomy || state.utime >= this.autonomy.utime) this.autonomy = state;
  }

  hearPlan(plan) {
    this.newestPlan = plan;
    this.plans.set(plan.id, plan);
    if (this.plans.size > PLANS_KEPT) this.plans.delete(this.plans.keys().next().value);
  }

  /** Age of what the controller knows; NaN before its first pose. */
  age_s(now_s) {
    return this.believed ? Math.max(0, now_s - this.believed.utime / 1e6) : NaN;
  }

  /** Where the controller's newest pose and what was sent since say that the vehicle is now. */
  predicted(now_s) {
    const pose = this.believed;
    if (!pose) return null;
    if (this.newestPlan) return predictByPlans(pose, this.plans, now_s);
    return this.sent.follow(pose, pose.utime / 1e6, now_s);
  }

  /** The way that the newest plan leads from now on; null without plans. */
  wayAhead(now_s, ahead_s) {
    const pose = this.predicted(now_s);
    if (!pose) return null;
    if (this.newestPlan) {
      const plan = this.plans.get(this.believed.plan_id) ?? this.newestPlan;
      return followPlan(pose, plan, now_s, now_s + ahead_s, 0.2);
    }
    return null;
  }
}
