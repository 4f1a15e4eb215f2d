"""The bridge with drives that share nothing with the project (independent_drive/): what they do is
what they say themselves."""

import json
import math
import pathlib
import signal
import sys
import time

from can_drivetrain import (
    NODES,
    SIGNS,
    STANDING_MPS,
    TWO_NODES,
    WHEEL_RADIUS_M,
    Drivetrain,
    wheel_speeds,
)
from live_support import check

HERE = pathlib.Path(__file__).resolve().parent
RIM_PER_REVOLUTION_M = 2 * math.pi * WHEEL_RADIUS_M


class Independent(Drivetrain):
    """The bridge with these drives. How they and their wheels fare is what they say themselves."""

    program = HERE / "independent_drive"

    def __init__(self, test, *switches, drivetrain=TWO_NODES):
        super().__init__(test, drivetrain)
        self._program = test.start(sys.executable, "-BIS", self.program, "vcan0", *switches)

    def end(self):
        for program in (self.bridge, self._program):
            program.kill()
            program.wait(5)

    def reports(self, key, since=0.0):
        """All that was reported since and has this key."""
        complete = self._program.out().rpartition("\n")[0]
        lines = [json.loads(line) for line in complete.splitlines()]
        return [line for line in lines if key in line and line["t"] > since]

    def rims_mps(self, since=0.0):
        """(when, left, right) since, forward positive."""
        scale = [SIGNS[node] * RIM_PER_REVOLUTION_M for node in NODES]
        return [
            (line["t"], *(r * s for r, s in zip(line["rps"], scale)))
            for line in self.reports("rps", since)
        ]

    def drive_states(self, since=0.0):
        """Each node's drive states since."""
        found = {node: [] for node in NODES}
        for line in self.reports("event", since):
            if line["event"] == "state":
                found[line["node"]].append(line["state"])
        return found

    def start_up(self, seconds=15):
        self.start_bridge()
        self.hold(0.0)
        return self.wait_state("disarmed", seconds)

    def drive_and_stop(self, v_mps=0.5, omega_radps=0.2):
        """From disarmed: arms, drives at that speed, disarms; wheels stand, power is off."""
        self.arm()
        self.hold(v_mps, omega_radps)
        wanted = wheel_speeds(v_mps, omega_radps)

        def reached():
            last = self.rims_mps()[-4:]  # the last of many: it is armed
            return all(abs(s - w) < 0.01 for _, *both in last for s, w in zip(both, wanted))

        self._wait(8, reached, f"wheels at {wanted} m/s")
        told = self.network.last("CAN/ODOMETRY")
        check(abs(told.v_mps - v_mps) < 0.02, f"odometry {told.v_mps} m/s")
        check(abs(told.omega_radps - omega_radps) < 0.02, f"odometry {told.omega_radps} rad/s")
        asked = self.request("disarm")
        self.wait_state("disarmed", 5, since=asked)
        self.check_stopped(asked)
        # One encoder has passed the end of its 32 bits on the way.
        turns = self.reports("turns")[-1]["turns"]
        driven = sum(SIGNS[n] * t for n, t in zip(NODES, turns)) / 2 * RIM_PER_REVOLUTION_M
        told = self.network.last("CAN/ODOMETRY").distance_m
        check(abs(told - driven) < 0.01 * driven, f"odometry {told} m of {driven} m")

    def check_stop_without_bridge(self, states):
        """Killed at speed, with these states of both drives after that."""
        self.arm()
        self.hold(0.5)
        self._wait(5, lambda: min(self.rims_mps()[-1][1:]) > 0.49, "it drives")
        killed = time.time()
        self.bridge.kill(signal.SIGKILL)
        self.wait_for_standstill()
        found = self.drive_states(killed)
        check(found == {node: states for node in NODES}, f"without the bridge: {found}")
        last = max(t for t, *both in self.rims_mps(killed) if max(map(abs, both)) > STANDING_MPS)
        self.test.say(f"measured: stands {last - killed:.2f} s after the bridge was killed at 0.5 m/s")

    def wait_for_standstill(self):
        def stand():
            speeds = self.rims_mps(time.time() - 0.2)
            return speeds and all(abs(s) < STANDING_MPS for _, *both in speeds for s in both)

        self._wait(3, stand, "wheels stand")

    def check_stopped(self, since):
        """Within 2 s: the drive's own report of its last state comes after the bridge's."""
        self.wait_for_standstill()

        def power_is_off():
            found = self.drive_states(since).values()
            return all(states[-1:] == ["switch on disabled"] for states in found)

        self._wait(2, power_is_off, "both drives without power")
