#!/usr/bin/env -S python3 -B
"""Drives that deviate from the standard or from their file (independent_drive's switches): each is
driven, or refused with a reason that names what it does. Usage: deviation_test.py BIN_DIR"""

import time

from independent_drivetrain import Independent
from live_support import check, main


def tpdos_padded_to_8_bytes_are_named(test):
    with Independent(test, "--right", "--pad") as agv:
        agv.start_bridge()
        reason = agv.wait_state("refused", 15).reason
        check(reason.startswith("right drive (node 2): its TPDOs do not have the length of the file's "
                                "mapping: 0x182 has 8 bytes instead of 6, 0x282 has 8 bytes instead "
                                "of 7. "), reason)
        check("pads its TPDOs" in reason, reason)


def a_mode_display_that_blinks_is_named(test):
    with Independent(test, "--right", "--blink-mode-s", "1.5") as agv:
        agv.start_bridge()
        reason = agv.wait_state("fault", 15).reason
        check(reason == "right drive (node 2): mode of operation is 0, not 3 (profile velocity): the "
                        "drive shows none. If its mode display blinks, leave mode_display out of the "
                        "TPDOs", reason)


def a_late_second_boot_up_message_is_named_and_stops(test):
    """While it drives; afterwards it can be reset and driven."""
    with Independent(test, "--right", "--second-boot-s", "6") as agv:
        agv.start_up()
        agv.arm()
        agv.hold(0.5)
        reason = agv.wait_state("fault", 10, reason="did not reboot").reason
        check(reason.startswith("right drive (node 2): sent a boot-up message, but is still "
                                "operational, so it did not reboot: "), reason)
        agv.wait_for_standstill()
        agv.hold(0.0)


def a_wheel_at_120_percent_is_a_fault(test):
    with Independent(test, "--right", "--wheel-gain", "1.2") as agv:
        agv.start_up()
        agv.arm()
        began = time.time()
        agv.hold(1.0)
        state = agv.wait_state("fault", 20, reason="does not follow")
        way = sum(0.05 * abs(right) for _, _, right in agv.rims_mps(began))
        test.say(f"measured: a wheel at 120 % of 1 m/s is a fault after {way:.1f} m: {state.reason}")
        check(way < 13, f"noticed after {way:.1f} m")
        agv.wait_for_standstill()


def a_slope_is_driven_and_held(test):
    """0.5 m/s² down the slope, with brakes that close without power."""
    slope = ("--push-mps2", "0.5", "--holding-brake")
    against = ("--push-mps2", "-0.5", "--holding-brake")
    with Independent(test, *slope, "--right", *against) as agv:
        agv.start_up()
        agv.drive_and_stop()


main(
    tpdos_padded_to_8_bytes_are_named,
    a_mode_display_that_blinks_is_named,
    a_late_second_boot_up_message_is_named_and_stops,
    a_wheel_at_120_percent_is_a_fault,
    a_slope_is_driven_and_held,
)
