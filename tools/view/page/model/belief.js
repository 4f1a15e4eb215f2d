// Where the vehicle will be if it does what was sent: constant twists, one after the other, exactly
// integrated (arcs of circles).

export function arc(pose, v_mps, omega_radps, dt_s) {
  const turn = omega_radps * dt_s;
  const yaw = pose.yaw_rad + turn;
  if (Math.abs(turn) < 1e-9) {
    return {
      x_m: pose.x_m + v_mps * dt_s * Math.cos(pose.yaw_rad),
      y_m: pose.y_m + v_mps * dt_s * Math.sin(pose.yaw_rad),
      yaw_rad: yaw,
    };
  }
  const radius = v_mps / omega_radps;
  return {
    x_m: pose.x_m + radius * (Math.sin(yaw) - Math.sin(pose.yaw_rad)),
    y_m: pose.y_m - radius * (Math.cos(yaw) - Math.cos(pose.yaw_rad)),
    yaw_rad: yaw,
  };
}

/** Poses along a plan from `from_s` to `to_s`, one per `every_s`; the first is `pose`, at from_s. */
export function followPlan(pose, plan, from_s, to_s, every_s = 0.1) {
  const step_s = plan.step_us / 1e6;
  const start_s = plan.start_utime / 1e6;
  const way = [pose];
  let at = pose;
  let t = from_s;
  let next = from_s + every_s;
  const count = Math.min(plan.v_mps.length, plan.omega_radps.length);
  while (t < to_s - 1e-9) {
    const i = Math.floor((t - start_s) / step_s + 1e-6);
    if (i >= count) break;
    const end = i < 0 ? start_s : start_s + (i + 1) * step_s;
    const until = Math.min(end, to_s, next);
    if (i >= 0) at = arc(at, plan.v_mps[i], plan.omega_radps[i], until - t);
    t = until;
    if (t >= next - 1e-9) {
      way.push(at);
      next += every_s;
    }
  }
  if (way[way.length - 1] !== at) way.push(at);
  return way;
}

/** Commands that were sent, the latest ones; each holds until the next. */
export class SentCommands {
  constructor() {
    this.list = [];
  }

  add(time_s, v_mps, omega_radps) {
    this.list.push({ time_s, v_mps, omega_radps });
    if (this.list.length > 2000) this.list.splice(0, 1000);
  }

  /** From `pose` at from_s to to_s by the commands in between. */
  follow(pose, from_s, to_s) {
    let at = pose;
    let t = from_s;
    let twist = { v_mps: 0, omega_radps: 0 };
    let i = this.list.length;
    while (i > 0 && this.list[i - 1].time_s > from_s) --i;
    if (i > 0) twist = this.list[i - 1];
    for (; i < this.list.length && this.list[i].time_s < to_s; ++i) {
      at = arc(at, twist.v_mps, twist.omega_radps, this.list[i].time_s - t);
      t = this.list[i].time_s;
      twist = this.list[i];
    }
    return arc(at, twist.v_mps, twist.omega_radps, Math.max(0, to_s - t));
  }
}

/**
 * Where the vehicle is at `now_s` by a pose and the plans that were made: it follows the plan that the
 * pose names until the next one that is based on it starts. `plans` by id.
 */
export function predictByPlans(pose, plans, now_s) {
  const from_s = pose.utime / 1e6;
  const plan = plans.get(pose.plan_id);
  if (!plan || plan.session !== pose.plan_session) return pose;
  const way = followPlan(pose, plan, from_s, now_s, Infinity);
  return way[way.length - 1];
}
