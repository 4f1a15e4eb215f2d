#!/usr/bin/env -S python3 -B
"""The bridge with drives that were written from the standards alone (independent_drive/): with
ordinary ones, and with each habit that real drives have and the project's own emulated ones have
not. It drives them, or refuses with a reason that a technician can act on.
Usage: independent_test.py BIN_DIR"""

import time

from can_drivetrain import STANDING_MPS, TWO_NODES, changed_file
from independent_drivetrain import Independent
from live_support import check, main


def ordinary_drives(test):
    with Independent(test) as agv:
        agv.start_up()
        agv.drive_and_stop()
        # Missing setpoints are noticed before the missing heartbeat.
        agv.check_stop_without_bridge(["fault reaction active", "fault"])


def the_probe_reads_them(test):
    with Independent(test, "--right", "--without", "0x1008"):
        options = ("--interface", "vcan0", "--drivetrain", TWO_NODES)
        probe = test.run("tether", "can", "probe", *options, seconds=20)
        text = probe.out()
        check(probe.process.returncode == 0, text)
        named = text.count("A drive written from the standard")  # in segments, by 0x1008
        check(named == 1, f"one of them has a name: {text}")


def drives_without_what_the_file_calls_optional(test):
    with Independent(test, "--without", "0x1008", "0x1029", "0x605E", "0x1400:5") as agv:
        agv.start_up()
        agv.drive_and_stop()
        # No drive misses setpoints; the heartbeat's reaction (0x6007 = 3) is a quick stop.
        agv.check_stop_without_bridge(["quick stop active", "switch on disabled"])


def drives_without_required_objects(test):
    why = "aborted: 0x06020000 (no such object): choose the drivetrain file of this drive"
    for index, what in (
        ("0x6085", "0x6085:0 (quick stop deceleration)"),
        ("0x6007", "0x6007:0 (reaction of the watchdog)"),
    ):
        with Independent(test, "--right", "--without", index) as agv:
            agv.start_bridge()
            reason = agv.wait_state("refused", 15).reason
            check(reason == f"right drive (node 2): writing {what} {why}", reason)
            agv.end()


def drives_without_these_and_a_file_that_says_so(test):
    fixed = changed_file(
        test,
        "fixed.toml",
        TWO_NODES,
        ('reaction = "0x6007:00 i16"\nreaction_value = 3', 'reaction = "fixed"'),
        ('object = "0x6085:00 u32"', 'object = "0x6085:00 u32"\nrequired = false'),
    )
    with Independent(test, "--without", "0x6085", "0x6007", drivetrain=fixed) as agv:
        agv.start_up()
        agv.drive_and_stop()


def one_that_boots_slowly_and_one_that_answers_slowly(test):
    """3 s to each boot-up message, 1.8 s more to the first SDO answer; 250 ms to write each object."""
    slow_boot = ("--boot-s", "3", "--sdo-after-s", "1.8")
    with Independent(test, *slow_boot, "--right", "--sdo-write-s", "0.25") as agv:
        since = time.time()
        agv.start_up(20)
        test.say(f"{time.time() - since:.1f} s from the bridge's start to disarmed")
        reasons = {m.reason for m in test.network.messages("CAN/STATE", since)}
        for what in ("waiting for its boot-up message", "waiting for its first SDO answer"):
            check(any(f"left drive (node 1): {what}" in r for r in reasons), f"nothing of {what}")
        check(any("right drive (node 2): step 30 of" in r for r in reasons), "nothing of its steps")
        agv.drive_and_stop()


def drives_that_boot_in_fault(test):
    with Independent(test, "--boot-fault", "0x7305") as agv:
        agv.start_bridge()
        state = agv.wait_state("fault", 15)
        check("left drive (node 1): fault 0x7305" in state.reason, state.reason)
        time.sleep(0.5)  # a reset is refused until both witnesses say that the wheels stand
        check("remove the cause, then reset" in state.reason, state.reason)
        agv.request("reset")
        agv.wait_state("disarmed")
        agv.drive_and_stop()


def bits_of_its_own_in_the_statusword_and_a_heartbeat_that_toggles(test):
    with Independent(test, "--status-bits", "0xC900", "--right", "--toggle") as agv:
        agv.start_up()
        agv.drive_and_stop()
        rejected = agv.counters()["drive.rejected_frames"]
        check(rejected == 0, f"{rejected} rejected frames")


def drives_that_keep_bit_30_of_their_identifiers(test):
    with Independent(test, "--no-rtr") as agv:
        agv.start_up()
        agv.drive_and_stop()


def drives_that_show_their_mode_late(test):
    with Independent(test, "--late-mode") as agv:
        agv.start_up()
        agv.drive_and_stop()


def drives_that_are_enabled_in_another_mode(test):
    with Independent(test, "--late-mode", "--right", "--late-mode", "--enabled-mode", "1") as agv:
        agv.start_up()
        asked = agv.request("arm")
        why = "right drive (node 2): mode of operation is 1, not 3"
        state = agv.wait_state("fault", 5, since=asked, reason=why)
        events = agv.reports("state", asked)
        enabled = [e["t"] for e in events if e["node"] == 2 and e["state"] == "operation enabled"]
        test.say(f"measured: enabled in another mode -> fault: {state.arrival - enabled[0]:.3f} s")
        agv.check_stopped(asked)
        moved = [s for s in agv.rims_mps() if max(map(abs, s[1:])) > STANDING_MPS]
        check(not moved, f"wheels turned: {moved[:1]}")


def drives_that_send_warnings(test):
    switches = ("--warnings", "0x8110", "0x4210", "--warn-every-s", "0.1")
    file = changed_file(
        test, "warn.toml", TWO_NODES, ("[drives]", "[drives]\nemcy_warnings = [0x8110, 0x4210]")
    )
    with Independent(test, *switches, drivetrain=file) as agv:
        agv.start_up()
        agv.drive_and_stop()
        check(agv.counters()["drive.warnings"] >= 4, "warnings are not counted")
        told = agv.state().reason
        check("warned since the last reset: " in told and "0x4210" in told, told)


def drives_whose_warnings_the_file_does_not_know(test):
    with Independent(test, "--warnings", "0x8110", "--warn-every-s", "0.1") as agv:
        agv.start_up()
        agv.request("arm")
        agv.wait_state("fault", 5, reason="emergency 0x8110 (CAN overrun: messages lost)")


main(
    ordinary_drives,
    the_probe_reads_them,
    drives_without_what_the_file_calls_optional,
    drives_without_required_objects,
    drives_without_these_and_a_file_that_says_so,
    one_that_boots_slowly_and_one_that_answers_slowly,
    drives_that_boot_in_fault,
    bits_of_its_own_in_the_statusword_and_a_heartbeat_that_toggles,
    drives_that_keep_bit_30_of_their_identifiers,
    drives_that_show_their_mode_late,
    drives_that_are_enabled_in_another_mode,
    drives_that_send_warnings,
    drives_whose_warnings_the_file_does_not_know,
)
