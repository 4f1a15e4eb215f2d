#!/usr/bin/env -S python3 -B
"""Frames of the bridge to its drives while they move, decoded by python-can: both wheels' setpoints
for a twist, the rates of all that is sent in turn, and the end of commands.
Usage: motion_test.py BIN_DIR"""

import math
import re
import time

from can_drivetrain import (
    BRIDGE_BEAT,
    MPS_PER_UNIT,
    NODES,
    SYNC,
    Drivetrain,
    Record,
    controlword,
    heartbeat,
    moves,
    rim_speeds,
    rpdo1,
    steps,
    target_mps,
    tpdo1,
)
from can_support import gaps, integer
from live_support import check, main, median

CYCLE_S = 0.02
LIMIT_MPS2 = 3.0  # acceleration and deceleration of the scenario
QUICK_STOP_MPS2 = 4.0  # deceleration of the drives
SLACK_S = 0.1


def a_twist_becomes_two_wheel_speeds(test):
    """0.5 m/s and 0.3 rad/s: 0.5 - 0.3 * 0.6 = 0.32 m/s left, 0.68 m/s right. At a radius of 0.4 m
    and 12000 units a revolution that is 1528 and 3247 units, the right drive mounted mirrored."""
    record = Record(test, "twist")
    with Drivetrain(test) as agv:
        agv.bring_up()
        started = time.time()
        agv.drive(0.5, 0.3)
        settled = time.time() + 0.1
        time.sleep(1.0)
        wheels = test.network.messages("CAN/WHEELS", settled)
        truth = test.network.messages("SIM/WHEELS", settled)
        odometry = test.network.last("CAN/ODOMETRY")
        record.stop()
    for node, mps, units in ((1, 0.32, 1528), (2, 0.68, -3247)):
        check(abs(mps / (2 * math.pi * 0.4) * 12000 - abs(units)) < 0.5, "this test's own figures")
        asked = record.frames(rpdo1(node), since=settled)
        got = record.frames(tpdo1(node), since=settled)
        check(len(asked) > 30 and len(got) > 30, f"node {node}: {len(asked)}, {len(got)} frames")
        found = {integer(f.data, 2, 4) for f in asked}
        check(found == {units}, f"node {node}: setpoints {found}, not {units}")
        check({controlword(f) for f in asked} == {0x0F}, f"node {node} is not enabled")
        speed = median(integer(f.data, 2, 4) for f in got)
        check(abs(speed - units) <= 15, f"node {node}: turns at {speed}, not {units}")  # 3 mm/s
        test.say(f"node {node}: {mps} m/s = {units} units asked, {speed} reported")
    left, right = map(median, zip(*map(rim_speeds, truth)))
    check(abs(left - 0.32) < 0.003 and abs(right - 0.68) < 0.003, f"wheels {left}, {right}")
    left, right = median(m.left_rim_mps for m in wheels), median(m.right_rim_mps for m in wheels)
    check(abs(left - 0.32) < 0.003 and abs(right - 0.68) < 0.003, f"feedback {left}, {right}")
    check(abs(odometry.v_mps - 0.5) < 0.01 and abs(odometry.omega_radps - 0.3) < 0.01, "odometry")
    # On the way there, too, the wheels' speeds have the curve's ratio.
    pairs = zip(record.frames(rpdo1(1), since=started), record.frames(rpdo1(2), since=started))
    ratios = [target_mps(b) / target_mps(a) for a, b in pairs if target_mps(a) > 0.05]
    check(all(abs(r - 0.68 / 0.32) < 0.02 for r in ratios), f"ratios {min(ratios)}, {max(ratios)}")


def bus_load(test, seconds):
    """Frames per second and share of 500 kbit/s that canbusload sees, each the median second."""
    program = test.start("/usr/bin/canbusload", "vcan0@500000")
    time.sleep(seconds)
    program.kill(2)
    program.wait(5)
    found = re.findall(r"vcan0@500000\s+(\d+)\s+(\d+)\s+(\d+)\s+(\d+)%", program.out())
    check(len(found) >= seconds - 3, f"canbusload: {program.out()[-300:]}")
    return median(int(f[0]) for f in found[1:]), median(int(f[3]) for f in found[1:])


def all_is_sent_in_time(test):
    record = Record(test, "soak")
    with Drivetrain(test) as agv:
        agv.bring_up(0.5)
        began = time.time()
        rate, load = bus_load(test, 30)
        ended = time.time()
        check(agv.states(began) == ["armed"], f"{agv.states(began)}, {agv.now()}")
        counters = test.network.counters("CAN/COUNTERS")
        record.stop()
    seconds = ended - began
    test.say(f"canbusload: {rate:.0f} frames/s, {load:.0f} % of 500 kbit/s")
    # 50 SYNC, 100 RPDOs, 200 TPDOs, 16.7 + 20 heartbeats
    check(abs(rate - 387) < 20, f"{rate} frames/s")
    check(6 <= load <= 14, f"bus load {load} %")
    once_a_cycle = {"SYNC": SYNC}
    for node in NODES:
        once_a_cycle |= {f"RPDO1 of {node}": rpdo1(node), f"TPDO1 of {node}": tpdo1(node)}
        once_a_cycle |= {f"TPDO2 of {node}": 0x280 + node}
    for name, identifier in once_a_cycle.items():
        frames = record.frames(identifier, since=began, until=ended)
        check(abs(len(frames) / seconds - 50) < 1.5, f"{name}: {len(frames) / seconds} /s")
        if identifier in (SYNC, rpdo1(1)):
            test.say(f"{name}: {len(frames) / seconds:.1f} /s, gaps to {max(gaps(frames)):.3f} s")
        # Its deadline in the drives is 100 ms.
        check(max(gaps(frames)) < 0.095, f"{name}: {max(gaps(frames)):.3f} s without")
    for identifier, period, limit in (
        (BRIDGE_BEAT, 0.06, 0.25),
        (heartbeat(1), 0.1, 0.3),
        (heartbeat(2), 0.1, 0.3),
    ):
        frames = record.frames(identifier, since=began, until=ended)
        mean = sum(gaps(frames)) / (len(frames) - 1)
        test.say(f"{identifier:03X}: every {mean:.4f} s, gaps to {max(gaps(frames)):.3f} s")
        check(0.95 * period < mean < 1.25 * period, f"{identifier:03X}: every {mean} s")
        check(max(gaps(frames)) < limit - 0.05, f"{identifier:03X}: {max(gaps(frames))} s without")
        check({bytes(f.data) for f in frames} == {b"\x05"}, f"{identifier:03X}: not operational")
    check(counters["can.send_dropped"] == 0, "frames that were not sent")


def without_commands_it_ramps_down_and_disarms(test):
    record = Record(test, "commands_stop")
    with Drivetrain(test) as agv:
        agv.bring_up(1.0)
        last = agv.hush()
        still = agv.wait_standstill(last)
        disarming = agv.wait_state("stopping", since=last)
        disarmed = agv.wait_state("disarmed", since=last)
        check("newest command was" in disarmed.reason, disarmed.reason)
        check(disarmed.disarms == 1, f"{disarmed.disarms} disarms")
        # Commands that come back move nothing.
        resumed = time.time()
        agv.hold(1.0)
        time.sleep(0.8)
        check(agv.states(resumed) == ["disarmed"], f"states {agv.states(resumed)}")
        asked = agv.request("arm")
        agv.wait_state("disarmed", since=asked, reason="arming refused: the newest command is not")
        agv.check_still(still + 0.1, "after the end of commands")
        record.stop()
        check(not any(map(moves, record.frames(*map(rpdo1, NODES), since=still))), "setpoints")
        agv.arm()
        agv.drive(0.5)
    first_slower = []
    for node in NODES:
        frames = record.frames(rpdo1(node), since=last, until=still)
        ramp = [f for f in frames if controlword(f) == 0x0F]
        speeds = [target_mps(f) for f in ramp]
        check(speeds[0] > 0.99, f"node {node}: {speeds[0]} m/s at the last command")
        first_slower.append(next(f.timestamp for f in ramp if target_mps(f) < 0.999))
        check(speeds == sorted(speeds, reverse=True), f"node {node}: not a ramp down: {speeds}")
        largest = max(a - b for a, b in zip(speeds, speeds[1:]))
        test.say(f"node {node}: at most {largest / CYCLE_S:.2f} m/s2 in the ramp")
        check(largest <= LIMIT_MPS2 * CYCLE_S + MPS_PER_UNIT, f"{largest / CYCLE_S} m/s2")
        check(speeds[-1] < 0.5, f"node {node}: still {speeds[-1]} m/s at the end of its ramp")
        words = steps(map(controlword, frames))
        check(words in ([0x0F, 0x02], [0x0F, 0x02, 0x00]), f"node {node}: controlwords {words}")
    begins = max(first_slower) - last
    test.say(f"last command -> ramp: {begins:.3f} s, disarming: {disarming.arrival - last:.3f} s")
    check(0.2 - CYCLE_S <= begins <= 0.25 + SLACK_S, f"the ramp began after {begins} s")
    check(0.5 - CYCLE_S <= disarming.arrival - last <= 0.55 + SLACK_S, "time of disarming")
    wheels = test.network.messages("SIM/WHEELS", last)
    check_deceleration([(m.utime * 1e-6, *rim_speeds(m)) for m in wheels if m.arrival < still])


def check_deceleration(samples):
    """Over a tenth of a second, for the wheels lag behind their setpoints and catch up."""
    for i, (t, *speeds) in enumerate(samples):
        later = next(((u, *s) for u, *s in samples[i:] if u - t >= 0.1), None)
        if later is None:
            return
        for a, b in zip(speeds, later[1:]):
            check((a - b) / (later[0] - t) < QUICK_STOP_MPS2 * 1.1, f"{a} to {b} m/s in 0.1 s")


main(
    a_twist_becomes_two_wheel_speeds,
    all_is_sent_in_time,
    without_commands_it_ramps_down_and_disarms,
)
