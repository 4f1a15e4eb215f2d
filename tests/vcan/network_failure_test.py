#!/usr/bin/env -S python3 -B
"""The shipping controller and relay drive at 1 m/s, and one of them is killed: the vehicle stops, and
does not move again when the program is back. Prints how long it took.
Usage: network_failure_test.py BIN_DIR"""

import threading
import time

from can_drivetrain import Drivetrain, rim_speeds
from live_support import POSE, check, main

SPEED_MPS = 1.0
LEAD_S = 9.0  # all programs start, and the bridge is armed, before the path does
POSE_PERIOD_S = 0.05
# Stale, one cycle, the ramp of 3 m/s² with its jerk; the drives lag.
STOP_LIMIT_S = 0.2 + 0.02 + SPEED_MPS / 3.0 + 0.1
SLACK_S = 0.1


class Loop(Drivetrain):
    """Poses of a vehicle that stays where it is go through the relay to the controller, which
    therefore wants to catch up with its path; what it commands comes back through the relay."""

    settings = (
        f"run.lead_s={LEAD_S}",
        f"can.max_speed_mps={SPEED_MPS}",
        "can.max_yaw_rate_radps=0.05",
    )

    def __init__(self, test):
        super().__init__(test)
        self.start_utime = int((time.time() + LEAD_S) * 1e6)
        self._poses = threading.Thread(target=self._measure, daemon=True)
        self._poses.start()

    def hold(self, v_mps, omega_radps=0.0):
        """Commanding is the controller's business here."""

    def _measure(self):
        due = time.monotonic()
        while not self._closed:
            due = max(due + POSE_PERIOD_S, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            self._send("AGV/POSE", POSE)

    def start_programs(self):
        self.programs = {
            name: self._start(name) for name in ("tether-netem", "tether-controller")
        }
        self.bring_up()
        check(time.time() * 1e6 < self.start_utime, "armed too late: the path has begun")

    def wait_at_speed(self):
        def at_speed(m):
            return min(rim_speeds(m)) > SPEED_MPS - 0.06

        self.wait_for("SIM/WHEELS", at_speed, LEAD_S + 5, "wheels at 1 m/s")


def killed(test, name):
    with Loop(test) as agv:
        agv.start_programs()
        agv.wait_at_speed()
        began = time.time()
        agv.programs[name].kill()
        stands = agv.wait_standstill(began)
        seconds = stands - began
        test.say(f"measured: SIGKILL of {name} -> wheels stand: {seconds:.3f} s")
        check(0.3 < seconds < STOP_LIMIT_S + SLACK_S, f"not within {STOP_LIMIT_S:.2f} s")
        disarmed = agv.wait_state("disarmed", since=began)
        check("the newest command was" in disarmed.reason, disarmed.reason)
        # Back, it wants to drive, and may not.
        agv._start(name)
        agv.wait_for("AGV/CMD_VEL", lambda m: m.v_mps > 1, 10, "commands again")
        time.sleep(0.5)
        check(agv.states(disarmed.arrival) == ["disarmed"], f"{agv.states(disarmed.arrival)}")
        asked = agv.request("arm")
        agv.wait_state("disarmed", since=asked, reason="arming refused: the newest command is not")
        agv.check_still(stands + 0.05, f"after {name} came back")


def the_controller_is_killed(test):
    killed(test, "tether-controller")


def the_relay_is_killed(test):
    killed(test, "tether-netem")


main(the_controller_is_killed, the_relay_is_killed)
