// What is known of one vehicle, from the messages about it: the truth, what its controller believes,
// and the packets between them. Times are seconds of the run.

import { SentCommands, followPlan, predictByPlans } from "./belief.js";
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
    for (const kept of [this.trail, this.reference, this.uplink, this.downlink]) kept.clear();
  }

  /** Where it is, as well as we know. */
  get place() {
    return this.truth ?? this.pose;
  }

  hearTruth(truth, heard_s) {
    if (this.truth && truth.utime - this.truth.utime > GAP_US) {
      // a log was wound on: nobody saw the way
      this.trail.clear();
      this.reference.clear();
    }
    this.truth = truth;
    this.truthHeard_s = heard_s;
    this.trail.add(truth.x_m, truth.y_m);
    this.reference.add(truth.x_ref_m, truth.y_ref_m);
  }

  hearVehicleSide(name, fields, at_s) {
    if (name === "POSE") {
      this.pose = fields;
      if (!this.truth) this.trail.add(fields.x_m, fields.y_m);
      this.uplink.sent(fields.seq, at_s);
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
    }
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
