#!/usr/bin/env -S python3 -B
"""An unknown sender's frame on the bus while the vehicle drives at 1 m/s: NMT "enter pre-operational",
which makes drives deaf to PDOs, or an SDO write to what the bridge has configured. The vehicle
stops, and the bridge does not end as if it had before it has. Prints how long each took.
Usage: unheard_stop_test.py BIN_DIR"""

import signal
import time

from can_drivetrain import (
    BRIDGE_BEAT,
    NMT,
    NODES,
    SYNC,
    Drivetrain,
    Record,
    moves,
    rpdo1,
)
from can_support import CanBus
from live_support import check, main

SPEED_MPS = 1.0
BRAKING_S = SPEED_MPS / 4.0  # the drives' quick stop
CYCLE_S = 0.02
CONFIRMATION_S = 0.2
CONSUMER_S = 0.25  # the drives' heartbeat consumer
SLACK_S = 0.1
PRE_OPERATIONAL = bytes([0x80, 0])
QUICK_STOP = bytes.fromhex("2B40600002000000")


def measured(test, what, seconds, limit_s):
    test.say(f"measured: {what}: {seconds:.3f} s")
    check(0 < seconds <= limit_s + SLACK_S, f"{what}: {seconds:.3f} s, not {limit_s} s")


def send(bus, identifier, data):
    """When it was sent."""
    now = time.time()
    bus.send(identifier, data)
    return now


def an_nmt_frame_stops_the_vehicle(test):
    record = Record(test, "nmt_pre_operational")
    with Drivetrain(test) as agv, CanBus() as bus:
        agv.bring_up(SPEED_MPS)
        sent = send(bus, NMT, PRE_OPERATIONAL)
        fault = agv.wait_state("fault", since=sent, reason="another sender uses 0x000")
        stands = agv.wait_standstill(sent)
        measured(test, "NMT pre-operational -> wheels stand", stands - sent, CYCLE_S + BRAKING_S)
        counters = agv.counters()
        check(counters["drive.stops_by_sdo"] >= 2, f"{counters}")
        check("drive.heartbeat_withheld" not in counters, f"{counters}")
        agv.bridge.kill(signal.SIGTERM)
        code = agv.bridge.wait(6)
        check(code == 0, f"exit code {code}: {agv.bridge.err()}")
        agv.check_still(stands + 0.1, "after the bridge had ended")
        record.stop()
    for node in NODES:
        writes = [f for f in record.frames(0x600 + node, since=sent) if bytes(f.data) == QUICK_STOP]
        check(writes, f"node {node}: no quick stop by SDO")
        what = f"NMT pre-operational -> quick stop by SDO, node {node}"
        measured(test, what, writes[0].timestamp - sent, CYCLE_S)
    later = record.frames(*map(rpdo1, NODES), since=fault.arrival)
    check(not any(map(moves, later)), "a setpoint after the fault")


def the_bridge_ends_only_once_the_wheels_stand(test):
    with Drivetrain(test) as agv, CanBus() as bus:
        agv.bring_up(SPEED_MPS)
        sent = send(bus, NMT, PRE_OPERATIONAL)
        agv.bridge.kill(signal.SIGTERM)
        code = agv.bridge.wait(6)
        ended = time.time()
        check(code == 0, f"exit code {code}: {agv.bridge.err()}")
        stands = agv.wait_standstill(sent)
        test.say(f"measured: NMT and SIGTERM -> stands {stands - sent:.3f} s, ends {ended - sent:.3f} s")
        check(stands < ended, "it ended before the wheels stood")


def drives_that_take_no_sdo_lose_the_heartbeat_and_stop_by_themselves(test):
    record = Record(test, "heartbeat_withheld")
    with Drivetrain(test) as agv, CanBus() as bus:
        agv.bring_up(SPEED_MPS)
        agv.inject("sdo_abort")
        drives = agv.counters("CAN/DRIVE_COUNTERS")
        check(drives["inject.applied"] == 1, f"{drives}")
        sent = send(bus, NMT, PRE_OPERATIONAL)
        agv.wait_state("fault", since=sent, reason="heartbeat and setpoints are withheld")
        stands = agv.wait_standstill(sent)
        limit_s = CYCLE_S + CONFIRMATION_S + CONSUMER_S + BRAKING_S
        measured(test, "NMT pre-operational, no SDO -> wheels stand", stands - sent, limit_s)
        counters = agv.counters()
        check(counters["drive.heartbeat_withheld"] == 1, f"{counters}")
        agv.bridge.kill(signal.SIGTERM)
        code = agv.bridge.wait(8)
        check(code == 1, f"exit code {code}: it is not known that the drives are off")
        check("not confirmed" in agv.bridge.err(), agv.bridge.err())
        record.stop()
    late = sent + CYCLE_S + CONFIRMATION_S + SLACK_S
    heard = record.frames(*map(rpdo1, NODES), SYNC, BRIDGE_BEAT, since=late)
    check(not heard, f"{len(heard)} frames although they are withheld")


def a_write_to_a_watchdog_is_a_fault(test):
    with Drivetrain(test) as agv, CanBus() as bus:
        agv.bring_up(SPEED_MPS)
        sent = send(bus, 0x601, bytes.fromhex("2316100100000000"))
        agv.wait_state("fault", since=sent, reason="another sender writes 0x1016:1 by SDO")
        stands = agv.wait_standstill(sent)
        measured(test, "SDO write to a watchdog -> wheels stand", stands - sent, CYCLE_S + BRAKING_S)
        check(agv.counters()["drive.intruder_writes"] == 1, f"{agv.counters()}")
        reset = agv.request("reset")
        agv.wait_state("disarmed", 10, since=reset)
        agv.hold(0.0)
        time.sleep(0.2)  # zero commands arrive
        asked = agv.request("arm")
        armed = agv.wait_state("armed", 5, since=asked)
        measured(test, "ARM -> configuration verified, armed", armed.arrival - asked, 0.9)


main(
    an_nmt_frame_stops_the_vehicle,
    the_bridge_ends_only_once_the_wheels_stand,
    drives_that_take_no_sdo_lose_the_heartbeat_and_stop_by_themselves,
    a_write_to_a_watchdog_is_a_fault,
)
