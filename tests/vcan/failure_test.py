#!/usr/bin/env -S python3 -B
"""Events on the bus and at the wheels when the bridge or a drive fails at 1 m/s, and that
nothing moves again by itself. Prints how long each took.
Usage: failure_test.py BIN_DIR"""

import signal
import time

from can_drivetrain import (
    BRIDGE_BEAT,
    NMT,
    NODES,
    SYNC,
    TWO_NODES,
    Drivetrain,
    Record,
    changed_file,
    controlword,
    drive_state,
    emcy,
    heartbeat,
    moves,
    rim_speeds,
    rpdo1,
    steps,
    target_mps,
    tpdo1,
)
from can_support import integer
from live_support import check, main

SPEED_MPS = 1.0
BRAKING_S = SPEED_MPS / 4.0  # the drives' quick stop
RAMP_S = SPEED_MPS / 3.0  # the bridge's own, without jerk
SLACK_S = 0.1
CONTROL = (*map(rpdo1, NODES), SYNC, BRIDGE_BEAT)
# The bridge's SDO requests, by first bytes: heartbeat consumer.
CONSUMER = bytes.fromhex("23161001FA007F00")
# Reading statusword and speed, writing the controlword, aborting what was not answered.
STOPPING = {bytes.fromhex(x) for x in ("40416000", "406C6000", "40646000", "2B406000", "80406000")}


def measured(test, what, seconds, limit_s):
    test.say(f"measured: {what}: {seconds:.3f} s")
    check(0 < seconds <= limit_s + SLACK_S, f"{what}: {seconds:.3f} s, not {limit_s} s")


def emergency_codes(record, node, since):
    return [integer(f.data, 0, 2, signed=False) for f in record.frames(emcy(node), since=since)]


def no_motion(record, since, until):
    frames = record.frames(*map(rpdo1, NODES), since=since, until=until)
    check(len(frames) > 10, f"only {len(frames)} setpoints were recorded")
    check(not any(map(moves, frames)), "the bridge let the wheels turn")


def drives_stop_by_themselves(record, since, until):
    """The bridge is silent and the drives say why they stop."""
    heard = record.frames(*CONTROL, since=since + 0.005, until=until)
    check(not heard, f"the bridge still sent {len(heard)} frames")
    for node in NODES:
        codes = emergency_codes(record, node, since)
        # Setpoints have a deadline of 100 ms, heartbeats one of 250 ms.
        check(codes[:2] == [0x8250, 0x8130], f"node {node}: EMCY {[hex(c) for c in codes]}")
        last = record.frames(tpdo1(node), BRIDGE_BEAT, until=since)[-1].timestamp
        at = record.frames(emcy(node), since=since)
        lost = next(f.timestamp for f in at if integer(f.data, 0, 2, signed=False) == 0x8130)
        check(0.15 < lost - last < 0.35 + SLACK_S, f"node {node}: 8130 after {lost - last} s")


def drives_again(agv):
    """Only ARM with a zero command leads to driving; when that began."""
    armed = time.time()
    agv.arm()
    agv.drive(SPEED_MPS)
    return armed


def last_of_bridge(record, until):
    return record.frames(*CONTROL, until=until)[-1].timestamp


def commands_stop(test):
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        last = agv.hush()
        stands = agv.wait_standstill(last) - last
        # Stale, one cycle, ramp and its jerk.
        limit = 0.2 + 0.02 + RAMP_S + 0.1
        measured(test, "last valid command -> wheels stand", stands, limit)
        agv.wait_state("disarmed")


def bridge_suspended(test):
    record = Record(test, "bridge_suspended")
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        stopped = time.time()
        agv.bridge.kill(signal.SIGSTOP)
        stands = agv.wait_standstill(stopped)
        measured(test, "SIGSTOP of the bridge -> wheels stand", stands - stopped, 0.1 + BRAKING_S)
        time.sleep(max(0, stopped + 1.2 - time.time()))
        # Commands of 1 m/s go on all the time.
        resumed = time.time()
        agv.bridge.kill(signal.SIGCONT)
        agv.wait_state("fault", since=resumed)
        time.sleep(0.5)
        asked = agv.request("arm")
        agv.wait_state("fault", since=asked, reason="arming refused")
        reset = agv.request("reset")
        agv.wait_state("disarmed", 10, since=reset)
        time.sleep(0.5)
        states = agv.states(resumed)
        check(states[-3:] == ["fault", "starting", "disarmed"], f"{states}")
        check("arming" not in states, f"{states}")
        agv.check_still(stands + 0.1, "after the bridge was resumed")
        armed = drives_again(agv)
        record.stop()
    drives_stop_by_themselves(record, last_of_bridge(record, stopped + 0.05), resumed)
    no_motion(record, resumed, armed)
    # The drives were set up again, because they had lost their master.
    for node in NODES:
        starts = [f for f in record.frames(NMT, since=reset) if bytes(f.data) == bytes([1, node])]
        check(starts, f"node {node} was not started again")


def bridge_killed(test):
    record = Record(test, "bridge_killed")
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        killed = time.time()
        agv.bridge.kill()
        stands = agv.wait_standstill(killed)
        measured(test, "SIGKILL of the bridge -> wheels stand", stands - killed, 0.1 + BRAKING_S)
        time.sleep(max(0, killed + 0.5 - time.time()))
        restarted = time.time()
        agv.start_bridge()
        agv.wait_state("disarmed", 10, since=restarted)
        time.sleep(0.5)
        check(agv.states(restarted) == ["starting", "disarmed"], f"{agv.states(restarted)}")
        agv.check_still(stands + 0.1, "after the bridge was started again")
        armed = drives_again(agv)
        record.stop()
    drives_stop_by_themselves(record, last_of_bridge(record, killed + 0.05), restarted)
    no_motion(record, restarted, armed)


def bridge_ended(test):
    """SIGTERM while it drives: it stops the drives, switches them off, then falls silent."""
    record = Record(test, "bridge_ended")
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        asked = time.time()
        agv.bridge.kill(signal.SIGTERM)
        code = agv.bridge.wait(5)
        ended = time.time()
        stands = agv.wait_standstill(asked)
        measured(test, "SIGTERM of the bridge -> wheels stand", stands - asked, 0.04 + BRAKING_S)
        check(code == 0, f"exit code {code}")
        time.sleep(1.0)
        record.stop()
    for node in NODES:
        check(not record.frames(emcy(node), since=asked, until=ended), f"node {node}: EMCY")
        words = steps(controlword(f) for f in record.frames(rpdo1(node), since=asked))
        check([w for w in words if w != 0x0F] == [0x02, 0x00], f"node {node}: controlwords {words}")
        states = steps(map(drive_state, record.frames(tpdo1(node), since=asked)))
        want = ["operation enabled", "quick stop active", "switch on disabled"]
        check(states[: len(want)] == want, f"node {node}: {states}")
    check(stands < last_of_bridge(record, ended + 1), "it fell silent before the wheels stood")


def a_new_bridge_first_stops_what_moves(test):
    """With drives whose watchdog takes a second, so that they still run when the next one comes."""
    slow = (
        ("consumer\"\ntimeout_ms = 250", "consumer\"\ntimeout_ms = 1000"),
        ("\nevent_timer_ms = 100 ", "\n#"),
        ("\nevent_timer_required = false", "\n#"),
    )
    drivetrain = changed_file(test, "slow_watchdog.toml", TWO_NODES, *slow)
    record = Record(test, "bridge_restarted")
    with Drivetrain(test, drivetrain) as agv:
        agv.bring_up(SPEED_MPS)
        killed = time.time()
        agv.bridge.kill()
        agv.start_bridge()
        agv.wait_state("disarmed", 15, since=killed)
        stands = agv.wait_standstill(killed)
        time.sleep(0.5)
        check(agv.states(killed + 0.1) == ["starting", "disarmed"], f"{agv.states(killed + 0.1)}")
        agv.check_still(stands + 0.1, "after the bridge was started again")
        wheels = test.network.messages("SIM/WHEELS", killed)
        record.stop()
    new = record.frames(*map(rpdo1, NODES), since=last_of_bridge(record, killed + 0.05))[0]
    speeds = rim_speeds([m for m in wheels if m.arrival < new.timestamp][-1])
    seconds = new.timestamp - killed
    test.say(f"the new bridge commands after {seconds:.2f} s, wheels at {min(speeds):.3f} m/s")
    check(min(speeds) > 0.99, f"the wheels did not run any more: {speeds}")
    resets = [f.timestamp for f in record.frames(NMT, since=killed) if f.data[0] == 0x81]
    for node in NODES:
        frames = record.frames(rpdo1(node), since=new.timestamp - 0.001)
        check(controlword(frames[0]) == 0x02, f"node {node}: first {controlword(frames[0]):04X}")
        check(not any(target_mps(f) for f in frames), f"node {node}: a setpoint")
        check(not emergency_codes(record, node, killed), f"node {node} stopped by itself")
        feedback = record.frames(tpdo1(node), since=killed, until=resets[0])
        states = steps(map(drive_state, feedback))
        check(states[:2] == ["operation enabled", "quick stop active"], f"node {node}: {states}")
    check(stands < resets[0], "the drives were reset before the wheels stood")


def a_new_bridge_resets_nothing_that_rolls(test):
    """It comes when the drives have lost their master and brake by themselves, pre-operational and
    so without feedback; a reset would switch their power stages off."""
    fast_mps = 3.0
    record = Record(test, "bridge_restarted_fast")
    with Drivetrain(test) as agv:
        agv.bring_up(fast_mps)
        killed = time.time()
        agv.bridge.kill()
        time.sleep(0.3)
        agv.start_bridge()
        agv.wait_state("disarmed", 15, since=killed)
        stands = agv.wait_standstill(killed)
        measured(test, f"SIGKILL of the bridge at {fast_mps} m/s, a new one after 0.3 s -> wheels stand", stands - killed, 0.1 + fast_mps / 4.0)
        check(agv.states(killed + 0.1) == ["starting", "disarmed"], f"{agv.states(killed + 0.1)}")
        agv.check_still(stands + 0.1, "after the bridge was started again")
        record.stop()
    resets = [f.timestamp for f in record.frames(NMT, since=killed) if f.data[0] in (0x81, 0x82)]
    check(resets, "the drives were not reset")
    test.say(f"first NMT reset {resets[0] - stands:.3f} s after the standstill")
    check(stands < resets[0], f"the drives were reset {stands - resets[0]:.3f} s before the wheels stood")


def drives_killed(test):
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        killed = time.time()
        agv.drives.kill()
        stopping = agv.wait_state("stopping", 2, since=killed)
        fault = agv.wait_state("fault", since=killed)
        measured(test, "SIGKILL of the drives -> bridge stops", stopping.arrival - killed, 0.12)
        measured(test, "SIGKILL of the drives -> bridge in FAULT", fault.arrival - killed, 0.35)
        test.say(fault.reason)
        check("node 1" in fault.reason or "node 2" in fault.reason, fault.reason)
        # Drives that come back change nothing.
        agv.start_drives()
        time.sleep(1.0)
        check(set(agv.states(fault.arrival)) == {"fault"}, f"{agv.states(fault.arrival)}")
        agv.check_still(fault.arrival + 0.1, "after the drives came back")
        asked = agv.request("arm")
        agv.wait_state("fault", since=asked, reason="arming refused")
        agv.hold(0.0)
        agv.request("reset")
        agv.arm()
        agv.drive(SPEED_MPS)


def a_drive_reboots(test):
    record = Record(test, "drive_reboots")
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        injected = agv.inject("reboot", node=1)
        fault = agv.wait_state("fault", since=injected)
        stands = agv.wait_standstill(injected)
        measured(test, "reboot of a drive -> wheels stand", stands - injected, 0.25 + BRAKING_S)
        test.say(fault.reason)
        time.sleep(0.5)
        reset = agv.request("reset")
        agv.wait_state("disarmed", 10, since=reset)
        agv.check_still(stands + 0.1, "after a drive rebooted")
        states = agv.states(fault.arrival - 0.001)
        check(states == ["fault", "starting", "disarmed"], f"{states}")
        armed = drives_again(agv)
        record.stop()
    beats = record.frames(heartbeat(1), since=injected)
    check(any(f.data == b"\0" for f in beats), "no boot-up message")
    check(not [f for f in record.frames(NMT, since=injected, until=reset)], "NMT before the reset")
    no_motion(record, fault.arrival, armed)
    for node in NODES:
        orders = [f.data[0] for f in record.frames(NMT, since=reset) if f.data[1] == node]
        check(orders == [0x81, 0x01], f"node {node}: NMT {orders}")
        requests = [bytes(f.data) for f in record.frames(0x600 + node, since=reset)]
        check(CONSUMER in requests and len(requests) > 50, f"node {node}: not configured again")
        # Statusword, speed, position and quick stop until it says that it is off, and stands.
        asked = {bytes(f.data[:4]) for f in record.frames(0x600 + node, since=injected, until=reset)}
        check(asked <= STOPPING, f"node {node}: SDO before the reset: {asked}")


def a_drive_trips(test):
    record = Record(test, "drive_trips")
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        injected = agv.inject("fault", node=2, value=0x2310)
        fault = agv.wait_state("fault", since=injected, reason="0x2310")
        test.say(fault.reason)
        check("right drive (node 2)" in fault.reason, fault.reason)
        stands = agv.wait_standstill(injected)
        seconds = stands - injected
        measured(test, "fault of one drive -> both wheels stand", seconds, 0.04 + BRAKING_S)
        wheels = agv.wait_for("CAN/WHEELS", lambda m: m.right_error_code == 0x2310, 2, "error code")
        check(wheels.left_error_code == 0, f"left error code {wheels.left_error_code:04X}")
        time.sleep(0.5)
        reset = agv.request("reset")
        agv.wait_state("disarmed", since=reset)
        agv.check_still(stands + 0.1, "after a fault")
        armed = drives_again(agv)
        record.stop()
    codes = emergency_codes(record, 2, injected)
    check(codes == [0x2310, 0], f"EMCY {[hex(c) for c in codes]}")
    check(not emergency_codes(record, 1, injected), "the left drive has a fault, too")
    no_motion(record, fault.arrival, armed)
    left = steps(controlword(f) for f in record.frames(rpdo1(1), since=injected, until=reset))
    check([w for w in left if w != 0x0F] == [0x02, 0x00], f"left drive: controlwords {left}")
    # Bit 7 rises once, after the operator's request, from a word without it.
    words = record.frames(rpdo1(2), since=injected, until=armed)
    early = [f for f in words if f.timestamp < reset and controlword(f) & 0x80]
    check(not early, "the fault was reset unasked")
    right = steps(map(controlword, words))
    check(right.count(0x80) == 1 and right[right.index(0x80) - 1] == 0, f"right drive: {right}")
    states = steps(map(drive_state, record.frames(tpdo1(2), since=injected, until=armed)))
    check("fault" in states and states[-1] == "switch on disabled", f"right drive: {states}")


def the_emergency_stop_latches(test):
    record = Record(test, "estop")
    with Drivetrain(test) as agv:
        agv.bring_up(SPEED_MPS)
        pressed = agv.request("estop")
        stands = agv.wait_standstill(pressed)
        measured(test, "e-stop request -> wheels stand", stands - pressed, 0.04 + BRAKING_S)
        agv.wait_state("estop", since=pressed)
        # Commands of 1 m/s go on all the time.
        asked = agv.request("reset")
        agv.wait_state("estop", since=asked, reason="reset refused")
        released = agv.request("estop_release")
        agv.wait_state("estop", since=released, reason="released")
        asked = agv.request("arm")
        agv.wait_state("estop", since=asked, reason="arming refused")
        time.sleep(0.5)
        check(agv.states(released) == ["estop"], f"{agv.states(released)}")
        reset = agv.request("reset")
        agv.wait_state("disarmed", since=reset)
        asked = agv.request("arm")
        agv.wait_state("disarmed", since=asked, reason="arming refused: the newest command is not")
        time.sleep(0.3)
        agv.check_still(stands + 0.1, "after the emergency stop")
        armed = drives_again(agv)
        record.stop()
    for node in NODES:
        frames = record.frames(rpdo1(node), since=pressed, until=armed)
        quick = next(f.timestamp for f in frames if controlword(f) == 0x02)
        what = f"e-stop request -> quick stop on the bus, node {node}"
        measured(test, what, quick - pressed, 0.04)
        check(not any(moves(f) for f in frames if f.timestamp > quick), "setpoints after the stop")


main(
    commands_stop,
    bridge_suspended,
    bridge_killed,
    bridge_ended,
    a_new_bridge_first_stops_what_moves,
    a_new_bridge_resets_nothing_that_rolls,
    drives_killed,
    a_drive_reboots,
    a_drive_trips,
    the_emergency_stop_latches,
)
