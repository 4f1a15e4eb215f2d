#!/usr/bin/env -S python3 -B
"""`tether can commission` with drives that were written from the standard alone: it finds out by
driving what reading cannot tell, and the bridge arms only what was commissioned, as it was.
Usage: commission_test.py BIN_DIR"""

import signal
import time

from can_drivetrain import SCENARIO, TWO_NODES, changed_file
from independent_drivetrain import Independent
from live_support import check, main

IGNORES = ("--ignore", "0x1016", "0x6007", "0x1400:5")


class Commissioned(Independent):
    """Drives, their record, and a bridge that requires it."""

    def __init__(self, test, *switches, drivetrain=TWO_NODES):
        super().__init__(test, *switches, drivetrain=drivetrain)
        self.record = test.work / "record.toml"
        self.settings += (f"can.commission_record={self.record}",)

    def begin_commission(self, *options):
        return self.test.start("tether", "can", "commission", SCENARIO, "--set",
                               f"can.drivetrain={self.drivetrain}", "--operator", "A. Tester",
                               "--record", self.record, *(options or ["--wheels-free"]))

    def commission(self, *options, code=0):
        begun = time.time()
        program = self.begin_commission(*options)
        ended = program.wait(120)
        said = program.out() + program.err()
        check(ended == code, f"exit code {ended}: {said}")
        self.test.say(f"commission took {time.time() - begun:.1f} s")
        for line in said.splitlines():
            if "drive (node" in line and "not commissioned" not in line:
                self.test.say(f"measured: {line.strip()}")
        self.wait_for_standstill()
        return said

    def check_not_armed(self, why):
        self.start_bridge()
        self.hold(0.0)
        self.wait_state("disarmed", 20, reason=why)
        time.sleep(0.3)
        self.request("arm")
        self.wait_state("disarmed", 2, reason=f"arming refused: {why}")

    def drive_again(self, *switches):
        """Other drives in the place of these."""
        self._program.kill()
        self._program.wait(5)
        return Commissioned(self.test, *switches, drivetrain=self.drivetrain)


def drives_that_stop_are_commissioned_and_driven_and_no_others(test):
    with Commissioned(test) as agv:
        said = agv.commission()
        text = agv.record.read_text()
        for fact in ("operator = 'A. Tester'", "0x1018:4 (serial number)", "quick stop", "feedback"):
            check(fact in text, f"no {fact} in {text}")
        check("PROBLEM" not in said, said)
        began = time.time()
        disarmed = agv.start_up()
        ready = agv.wait_state("disarmed", 5, since=began, reason="ready to be armed")
        test.say(f"measured: identities and objects compared in {ready.arrival - disarmed.arrival:.2f} s")
        agv.arm()
        agv.hold(0.3)
        agv._wait(5, lambda: min(agv.rims_mps()[-1][1:]) > 0.29, "it drives")
        agv.request("disarm")
        agv.wait_for_standstill()
        agv.bridge.kill()
        right = agv.drivetrain
        agv.drivetrain = changed_file(test, "gear.toml", TWO_NODES,
                                      ("actual_velocity_per_rps = 12000", "actual_velocity_per_rps = 24000"))
        agv.check_not_armed("commissioned with another drivetrain file: left.actual_velocity_per_rps is "
                            "24000, was 12000")
        agv.bridge.kill()
        agv.drivetrain = right
        with agv.drive_again("--right", "--serial", "4711") as other:
            other.check_not_armed("commissioned with other drives or values: node 2, 0x1018:4 (serial "
                                  "number) is 0x00001267, was 0x000003EA")


def on_the_floor_they_are_commissioned_within_a_third_of_a_metre(test):
    with Commissioned(test) as agv:
        agv.commission("--on-the-floor")
        ways = [abs(t) for line in agv.reports("turns") for t in line["turns"]]
        test.say(f"measured: {max(ways) * 2.513:.2f} m away from where it began")
        check(max(ways) * 2.513 < 0.3, f"{max(ways) * 2.513} m")
        speeds = [abs(s) for _, *both in agv.rims_mps() for s in both]
        check(max(speeds) < 0.07, f"{max(speeds)} m/s")


def a_drive_that_ignores_its_watchdogs_is_found_out_and_not_armed(test):
    with Commissioned(test, "--right", *IGNORES) as agv:
        said = agv.commission(code=1)
        for trial in ("nothing sent", "heartbeat withheld"):
            check(f"PROBLEM: {trial}: it drives on" in said, said)
        check("left drive (node 1)       PROBLEM" not in said, said)
        agv.check_not_armed("the commissioning failed: right drive (node 2): nothing sent")


def a_quick_stop_that_does_not_brake_is_found_out(test):
    """In the end the power is cut: the wheel coasts to standstill."""
    with Commissioned(test, "--right", "--no-braking", "--coast-mps2", "0.5") as agv:
        said = agv.commission(code=1)
        check("the quick stop does not stop it: check 0x605A and 0x6085" in said, said)
        check("the wheels turn on: cutting their power" in said, said)
        agv.check_not_armed("the commissioning failed: right drive (node 2): the quick stop does not "
                            "stop it")


def a_wrong_scale_is_named_and_nothing_else_is_tried(test):
    with Commissioned(test, "--right", "--velocity-scale", "1.25") as agv:
        said = agv.commission(code=1)
        check("velocity does not agree with the setpoint (+25 %): check actual_velocity_per_rps" in said,
              said)
        check("not commissioned: the feedback is wrong: nothing else was tried" in said, said)


def a_frozen_encoder_and_a_reversed_one_are_named(test):
    for switches, percent in ((("--freeze-after-turns", "0"), "-100"), (("--position-scale", "-1"), "-200")):
        with Commissioned(test, "--right", *switches) as agv:
            said = agv.commission(code=1)
            check(f"position does not agree with the setpoint ({percent} %)" in said, said)
            agv._program.kill()


def real_drives_without_a_record_are_not_armed(test):
    with Commissioned(test) as agv:
        agv.settings += ("can.emulate_drives=false", "can.arm=never", f"can.estop_file={test.work}/estop")
        agv.start_bridge()
        agv.wait_state("estop", 20)
        agv.request("estop_release")
        agv.request("reset")
        agv.wait_state("disarmed", 20, reason="not commissioned: ")
        agv.hold(0.0)
        time.sleep(0.3)
        agv.request("arm")
        agv.wait_state("disarmed", 2, reason="arming refused: not commissioned: ")


def ctrl_c_stops_the_wheels_first(test):
    with Commissioned(test) as agv:
        program = agv.begin_commission()
        agv._wait(20, lambda: any(abs(left) > 0.4 for _, left, _ in agv.rims_mps()), "it drives")
        program.kill(signal.SIGINT)
        check(program.wait(15) == 1, program.out() + program.err())
        check(max(map(abs, agv.rims_mps()[-1][1:])) < 0.005, "wheels turn at its end")
        check(not agv.record.exists(), "it wrote a record")


def a_bridge_on_the_bus_is_refused(test):
    with Commissioned(test) as agv:
        agv.settings = ()
        agv.start_up()
        said = agv.commission(code=1)
        check("another bridge or master runs on this bus" in said, said)
        check(agv.state().state_name == "disarmed", agv.now())


main(
    drives_that_stop_are_commissioned_and_driven_and_no_others,
    on_the_floor_they_are_commissioned_within_a_third_of_a_metre,
    a_drive_that_ignores_its_watchdogs_is_found_out_and_not_armed,
    a_quick_stop_that_does_not_brake_is_found_out,
    a_wrong_scale_is_named_and_nothing_else_is_tried,
    a_frozen_encoder_and_a_reversed_one_are_named,
    real_drives_without_a_record_are_not_armed,
    ctrl_c_stops_the_wheels_first,
    a_bridge_on_the_bus_is_refused,
)
