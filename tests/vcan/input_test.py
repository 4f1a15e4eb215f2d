#!/usr/bin/env -S python3 -B
"""Safety inputs on a CAN interface: what a scanner's frame does to the bus and the wheels at 1 m/s,
and that it takes no LCM. Prints how long each took.
Usage: input_test.py BIN_DIR"""

import time

from can_drivetrain import NODES, TWO_NODES, Drivetrain, Record, controlword, moves, rpdo1
from live_support import check, main

SPEED_MPS = 1.0
BRAKING_S = SPEED_MPS / 4.0  # the drives' quick stop
SLACK_S = 0.1
FIELD = 0x3A0
CLEAR, STOP = b"\x01", b"\x02"
DEMANDS, SILENT = 0, 1
TIMEOUT_S = 0.1


def scanner(test):
    """The two-node drivetrain with a scanner's field on the bus."""
    path = test.work / "scanner.toml"
    path.write_text(
        TWO_NODES.read_text()
        + f"""
[[safety_input]]
name = "field"
function = "protective_stop"
kind = "can"
id = {FIELD}
length = 1
byte = 0
mask = 0x03
clear = 0x01
stop = 0x02
timeout_ms = {TIMEOUT_S * 1000:.0f}
"""
    )
    return path


def measured(test, what, seconds, limit_s):
    test.say(f"measured: {what}: {seconds:.3f} s")
    check(0 < seconds <= limit_s + SLACK_S, f"{what}: {seconds:.3f} s, not {limit_s} s")


def quick_stop(record, since, until):
    frames = record.frames(*map(rpdo1, NODES), since=since, until=until)
    at = next(f.timestamp for f in frames if controlword(f) == 0x02)
    check(not any(moves(f) for f in frames if f.timestamp > at), "setpoints after the stop")
    return at


def a_field_stops_the_vehicle(test):
    record = Record(test, "field")
    with Drivetrain(test, scanner(test)) as agv:
        agv.bring_up(SPEED_MPS)
        entered = agv.inject("safety_input", node=1, value=DEMANDS)
        stands = agv.wait_standstill(entered)
        agv.wait_state("disarmed", since=entered, reason="safety input field demands a stop")
        asked = agv.request("arm")
        agv.wait_state("disarmed", since=asked, reason="arming refused: safety input field demands")
        left = agv.inject("none")
        time.sleep(1.0)  # commands of 1 m/s go on all the time
        check(agv.states(left) == ["disarmed"], f"{agv.states(left)}")
        agv.check_still(stands + 0.1, "after the field")
        check(agv.counters()["input.field.demands"] == 1, f"{agv.counters()}")
        again = time.time()
        agv.arm()
        agv.drive(SPEED_MPS)
        record.stop()
    told = next(f for f in record.frames(FIELD, since=entered) if f.data == STOP).timestamp
    quick = quick_stop(record, told, again)
    measured(test, "frame of the field -> quick stop on the bus", quick - told, 0.02)
    measured(test, "frame of the field -> wheels stand", stands - told, 0.02 + BRAKING_S)


def a_silent_scanner_stops_the_vehicle(test):
    record = Record(test, "silent")
    with Drivetrain(test, scanner(test)) as agv:
        agv.bring_up(SPEED_MPS)
        since = agv.inject("safety_input", node=1, value=SILENT)
        stands = agv.wait_standstill(since)
        agv.wait_state("disarmed", since=since, reason="safety input field: no frame 0x3A0 for 100 ms")
        record.stop()
    last = record.frames(FIELD)[-1].timestamp
    quick = quick_stop(record, last, time.time())
    measured(test, "last frame of the scanner -> quick stop", quick - last, TIMEOUT_S + 0.02)
    measured(test, "last frame of the scanner -> wheels stand", stands - last, TIMEOUT_S + 0.02 + BRAKING_S)


main(a_field_stops_the_vehicle, a_silent_scanner_stops_the_vehicle)
