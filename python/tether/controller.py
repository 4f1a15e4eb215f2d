"""A controller around a law: what to send for poses and timers. No network, no clock.

A law is called as law(t, pose, path) and returns (v_mps, omega_radps), a Plan, or None to send
nothing. t is the run's time in seconds; pose has x_m, y_m, yaw_rad and t_s, when it was measured;
path is the scenario's (path.at(t)), or None where no scenario was named.
"""

import inspect

from .decision import Plan, checked
from .messages import message_type

_POSE, _TWIST, _PLAN = (message_type(name) for name in ("pose_t", "twist_t", "plan_t"))


class Controller:
    """One run's. `rate_hz` 0: the law is called for each pose; else so often, with the newest one.
    `check_plans` is called before the first Plan is sent, and raises if the vehicle takes none. What a law
    returns that is neither twist nor Plan nor None is a ValueError that names the law."""

    def __init__(self, law, path=None, vehicle="AGV", rate_hz=0.0, session=1, check_plans=None):
        side = "CTRL" + (vehicle[3:] if vehicle.startswith("AGV") else "-" + vehicle)
        self.pose_channel = side + "/POSE"
        self._command_channel, self._plan_channel = side + "/CMD_VEL", side + "/PLAN"
        self.period_ns = round(1e9 / rate_hz) if rate_hz else 0
        self._law = law() if inspect.isclass(law) else law
        self._name = getattr(law, "__name__", type(law).__name__)
        self._check_plans = check_plans
        self._path = path
        self._session = session
        self._pose = None
        self._sent = 0

    def on_pose(self, t_s, data):
        """Bytes of a pose have come; a list of (channel, bytes) to send. What is no newer pose
        changes nothing."""
        pose = _POSE.decode(data)
        if pose is None or pose.utime < 0:
            return []
        # A vehicle that was started again is another run, and counts from 0.
        if self._pose and pose.run == self._pose.run and pose.seq <= self._pose.seq:
            return []
        pose.t_s = pose.utime / 1e6
        self._pose = pose
        return [] if self.period_ns else self._decide(t_s)

    def on_timer(self, t_s):
        """A tick, every period_ns from t = 0 on. Before the first pose nothing is sent."""
        return self._decide(t_s) if self._pose else []

    def _decide(self, t_s):
        decision = checked(self._law(t_s, self._pose, self._path), self._name)
        if decision is None:
            return []
        if isinstance(decision, Plan) and self._check_plans:
            self._check_plans(self._name)
            self._check_plans = None
        pose = self._pose
        head = {"utime": round(1e6 * t_s), "seq": self._sent, "run": pose.run, "pose_utime": pose.utime}
        self._sent += 1
        if not isinstance(decision, Plan):
            v_mps, omega_radps = decision
            return [(self._command_channel, _TWIST.encode(**head, v_mps=v_mps, omega_radps=omega_radps))]
        start, step = round(1e6 * decision.start_s), round(1e6 * decision.step_s)
        plan = {"start_utime": start, "step_us": step, "count": len(decision.v_mps)}
        plan |= {"settled_utime": start + step * (len(decision.v_mps) + 1)}  # a time that is never reached
        plan |= {"based_on": _PLAN.constants["ANY"], "based_on_last": _PLAN.constants["ANY"]}
        plan |= {"session": self._session, "id": self._sent, "v_mps": decision.v_mps}
        return [(self._plan_channel, _PLAN.encode(**head, **plan, omega_radps=decision.omega_radps))]
