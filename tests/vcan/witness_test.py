#!/usr/bin/env -S python3 -B
"""Witnesses that deviate while the vehicle drives, brakes that do not act, and standstill of which
it cannot be sure, with drives that coast without power and with drives that hold their wheels
(independent_drive). What is measured is how the wheels truly turn.
Usage: witness_test.py BIN_DIR"""

import signal
import subprocess
import time

from can_drivetrain import NMT, STANDING_MPS
from can_support import CanBus
from independent_drivetrain import RIM_PER_REVOLUTION_M, Independent
from live_support import check, main

SPEED_MPS = 1.0
HOLDS = {"coasts": (), "holds": ("--holding-brake",)}
FREEZES_AFTER_M = 1.0

# Name: switches of the right drive, what the reason says, most way until then (m); from the beginning
# of motion, or from where the encoder freezes.
WHILE_DRIVING = {
    "speed stays at zero": (("--velocity", "zero"), "its reported speed (0x606C) stays at zero", 0.35),
    "speed reversed": (("--velocity-scale", "-1"), "the sign of its reported speed is reversed", 0.3),
    "speed x 1.3": (("--velocity-scale", "1.3"), "actual_velocity_per_rps is wrong", 2.0),
    "position reversed": (("--position-scale", "-1"), "the sign of its position is reversed", 0.3),
    "encoder freezes": (
        ("--freeze-after-turns", str(FREEZES_AFTER_M / RIM_PER_REVOLUTION_M)),
        "its position (0x6064) stands still while its speed is as told: encoder frozen",
        0.4,
    ),
}
# Name: drives, switches, longest until the reason says it, longest until the wheels stand (s); from
# the e-stop. A load that pushes forward takes a wheel with it that nothing holds.
WHILE_BRAKING = {
    "quick stop does not brake": (HOLDS, ("--no-braking",), 0.4, 1.5),
    "a load pushes at 1 m/s²": (("holds",), ("--push-mps2", "-1.0", "--torque-mps2", "1.2"), 0.4, 3.0),
}


class Agv(Independent):
    def __init__(self, test, hold, *right, both=()):
        both = (*HOLDS[hold], *both)
        super().__init__(test, *both, "--right", *both, *right)

    def way_m(self, since, until):
        """True travel of the right wheel, m."""
        turns = [line["turns"][1] for line in self.reports("turns", since) if line["t"] <= until]
        return abs(turns[-1] - turns[0]) * RIM_PER_REVOLUTION_M if turns else 0.0

    def way_at(self, when):
        return self.way_m(0.0, when)

    def stand(self, since, seconds=5):
        """When both wheels stood after `since`, truly."""

        def last():
            samples = self.rims_mps(since)
            moving = [t for t, *both in samples if max(map(abs, both)) > STANDING_MPS]
            at = moving[-1] if moving else since
            return at if samples and samples[-1][0] - at > 0.2 else None

        return self._wait(seconds, last, "wheels stand")

    def drive_off(self):
        """Starts up, arms and drives; returns the time of the setpoint."""
        self.start_up()
        self.arm()
        self.hold(SPEED_MPS)
        return time.time()

    def at_speed(self, mps=SPEED_MPS):
        self._wait(8, lambda: min(map(abs, self.rims_mps()[-1][1:])) > 0.95 * mps, f"{mps} m/s")

    def check_disarmed_only_at_rest(self, since):
        for m in self.network.messages("CAN/STATE", since):
            if m.state_name == "disarmed":
                near = [s for s in self.rims_mps(since) if abs(s[0] - m.arrival) < 0.06]
                moving = [s for s in near if max(map(abs, s[1:])) > 0.05]
                check(not moving, f"disarmed, and the wheels turn: {moving[:1]}")


def each_deviation_is_named_while_driving(test):
    for what, (switches, reason, most_m) in WHILE_DRIVING.items():
        for hold in HOLDS:
            with Agv(test, hold, *switches) as agv:
                began = agv.drive_off()
                fault = agv.wait_for("CAN/STATE", lambda m: reason in m.reason, 10, reason, began)
                stood = agv.stand(fault.arrival)
                way = agv.way_at(fault.arrival) - (FREEZES_AFTER_M if "freezes" in what else 0.0)
                stop_m = agv.way_m(fault.arrival, stood)
                test.say(
                    f"measured: {what}, {hold}: FAULT after {way:.2f} m; stands {stood - fault.arrival:.2f} s "
                    f"and {stop_m:.2f} m later"
                )
                check(fault.reason.startswith("the right wheel: "), fault.reason)
                check(way < most_m, f"{what}: named after {way:.2f} m")
                check(stood - fault.arrival < 1.0, f"{what}: stood after {stood - fault.arrival:.2f} s")
                agv.check_disarmed_only_at_rest(began)
                agv.end()


def what_does_not_brake_is_named_and_stopped(test):
    for what, (holds, switches, named_s, stands_s) in WHILE_BRAKING.items():
        for hold in holds:
            with Agv(test, hold, *switches) as agv:
                agv.drive_off()
                agv.at_speed()
                asked = agv.request("estop")
                named = agv.wait_for("CAN/STATE", lambda m: "does not brake" in m.reason, 5, "named", asked)
                stood = agv.stand(asked)
                test.say(
                    f"measured: {what}, {hold}: named after {named.arrival - asked:.2f} s; stands after "
                    f"{stood - asked:.2f} s and {agv.way_m(asked, stood):.2f} m: {named.reason}"
                )
                check("right drive (node 2): does not brake: from " in named.reason, named.reason)
                check(named.arrival - asked < named_s, f"{what}: named after {named.arrival - asked:.2f} s")
                check(stood - asked < stands_s, f"{what}: stood after {stood - asked:.2f} s")
                agv.end()


def reset_drives(agv):
    """Another's NMT reset at speed: both drives boot without power."""
    subprocess.run(["cansend", "vcan0", "000#8100"], check=True)
    return time.time()


def a_speed_that_is_valid_only_while_enabled_is_no_standstill(test):
    with Agv(test, "coasts", "--velocity", "enabled") as agv:
        agv.drive_off()
        agv.at_speed()
        lost = reset_drives(agv)
        agv.hold(0.0)
        agv.wait_state("fault", 5, lost)
        while agv.network.last("CAN/STATE").state_name != "disarmed":
            check(time.time() - lost < 20, agv.now())
            agv.request("reset")
            time.sleep(0.3)
        stood = agv.stand(lost)
        ready = agv.network.last("CAN/STATE").arrival
        test.say(f"measured: speed valid only while enabled, coasts: stands {stood - lost:.2f} s and "
                 f"{agv.way_m(lost, stood):.2f} m after power was lost; disarmed after {ready - lost:.2f} s")
        check(stood - lost > 2.0, "it did not coast")
        agv.check_disarmed_only_at_rest(lost)
        agv.arm()
        agv.end()


def a_standstill_that_is_not_confirmed_is_a_state_of_its_own(test):
    """2 m/s take 6.7 s to roll out at 0.3 m/s²; a stop has 5 s."""
    with Agv(test, "coasts") as agv:
        agv.drive_off()
        agv.hold(2.0)
        agv.at_speed(2.0)
        lost = reset_drives(agv)
        agv.hold(0.0)
        agv.wait_state("fault", 5, lost)
        state = agv.wait_state("unconfirmed", 8, lost)
        speed = max(map(abs, agv.rims_mps()[-1][1:]))
        test.say(f"measured: unconfirmed {state.arrival - lost:.2f} s after power was lost, at {speed:.2f} m/s")
        check(speed > 0.2, f"{speed} m/s")
        asked = agv.request("arm")
        agv.wait_for("CAN/STATE", lambda m: "arming refused" in m.reason, 5, "ARM is refused", asked)
        agv.wait_for("CAN/STATE", lambda m: "say now that it stands" in m.reason, 8, "confirmed at last", asked)
        check(max(map(abs, agv.rims_mps()[-1][1:])) < 0.05, "said to stand while it turns")
        check(agv.state().state_name == "unconfirmed", "it is not latched")
        agv.request("reset")
        agv.arm()
        agv.end()


def resets_bring_no_heartbeat_to_drives_that_refuse_their_stop(test):
    """Another sender takes them out of operational, and they refuse SDO while they turn: what stops
    them is their master's heartbeat that stays away, however often an operator resets."""
    for hold in HOLDS:
        with Agv(test, hold, both=["--sdo-only-at-rest"]) as agv, CanBus() as bus:
            agv.drive_off()
            agv.at_speed()
            asked = time.time()
            bus.send(NMT, b"\x80\x00")
            agv.wait_state("fault", since=asked, reason="heartbeat and setpoints are withheld")
            for _ in range(20):
                agv.request("reset")
                time.sleep(0.02)
            stood = agv.stand(asked)
            test.say(f"measured: refuses its stop, {hold}: stands after {stood - asked:.2f} s")
            # Noticed, not confirmed, the drive's watchdog, its quick stop; and 0.3 s.
            limit_s = 0.02 + 0.2 + 0.25 + SPEED_MPS / 4.0 + 0.3
            check(stood - asked < limit_s, f"stood after {stood - asked:.2f} s, not {limit_s:.2f} s")
            agv.wait_state("disarmed", 15, since=stood)
            agv.check_disarmed_only_at_rest(asked)
            agv.end()


def a_bridge_that_ends_unconfirmed_exits_with_1(test):
    """Both drives fall silent for good at speed."""
    with Agv(test, "coasts") as agv:
        agv.drive_off()
        agv.at_speed()
        agv._program.kill(signal.SIGKILL)
        lost = time.time()
        state = agv.wait_state("unconfirmed", 8, lost)
        check("no two witnesses of each wheel say that it stands" in state.reason, state.reason)
        agv.request("arm")
        agv.bridge.kill(signal.SIGTERM)
        agv.bridge.wait(20)
        code = agv.bridge.process.returncode
        check(code == 1, f"exit code {code}: {agv.bridge.err()}")
        check("standstill and power off are not confirmed" in agv.bridge.err(), agv.bridge.err())
        check("armed" not in agv.states(lost)[1:], f"{agv.states(lost)}")
        test.say(f"measured: unconfirmed {state.arrival - lost:.2f} s after both drives fell silent")


main(
    each_deviation_is_named_while_driving,
    what_does_not_brake_is_named_and_stopped,
    a_speed_that_is_valid_only_while_enabled_is_no_standstill,
    a_standstill_that_is_not_confirmed_is_a_state_of_its_own,
    resets_bring_no_heartbeat_to_drives_that_refuse_their_stop,
    a_bridge_that_ends_unconfirmed_exits_with_1,
)
