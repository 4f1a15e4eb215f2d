#!/usr/bin/env -S python3 -B
"""Broken, forged and random frames of other senders to the bridge and the drives.
Usage: bad_input_test.py BIN_DIR"""

import subprocess
import time

from can_drivetrain import SCENARIO, WHEEL_RADIUS_M, Drivetrain, patient_file
from live_support import check, main

SPEED_MPS = 0.5


class Patient(Drivetrain):
    """Programs are started while it drives: nothing is late that soon."""

    settings = ("can.stale_ms=1000", "can.disarm_ms=2000")

    def __init__(self, test):
        super().__init__(test, patient_file(test))


def cansend(*frames):
    """Each as cansend writes it: "201#0F00"."""
    for frame in frames:
        done = subprocess.run(["cansend", "vcan0", frame], capture_output=True, text=True)
        check(done.returncode == 0, f"cansend {frame}: {done.stdout}{done.stderr}")


def reset_and_arm(d):
    """The wheels stand until ARM. An operator asks again when RESET is refused."""
    d.hold(0.0)
    reset = d.request("reset")
    asked = reset
    while True:
        answers = lambda m: m.state_name != "fault" or "reset refused" in m.reason  # noqa: E731
        answer = d.wait_for("CAN/STATE", answers, 5, "an answer to RESET", asked + 0.1)
        if "reset refused" not in answer.reason:
            break
        check(answer.arrival - reset < 8, f"no reset within 8 s: {answer.reason}")
        time.sleep(0.5)
        asked = d.request("reset")
    d.wait_state("disarmed", 15, reset)
    time.sleep(0.3)
    d.check_still(reset, "RESET")
    check("armed" not in d.states(reset), "RESET armed")
    d.arm()


# Nothing of these is a frame of this drivetrain: of other formats, or of other senders.
FOREIGN = {
    "remote frames": ("181#R", "201#R", "000#R", "77F#R", "701#R8"),
    "29-bit frames": ("00000000#0201", "00000201#0F00E8030000", "0000077F#04", "00000701#00", "00000181#0000"),
    "CAN FD frames": ("201##10F00E8030000", "000##10201", "181##10000", "201##1" + "FF" * 64),
    "others' frames": ("203#0F00E8030000", "703#00", "7FF#", "123#DEADBEEF", "083#0075810000000000"),
    # CAN_ERR_PROT and CAN_ERR_BUSERROR, CAN_ERR_ACK; no state of the controller
    "bus errors": ("20000088#0000000000000000", "20000020#0000000000000000"),
}
# Frames of the drives, by identifier, that are invalid by length or content.
GARBLED = {
    "feedback": ("181#", "181#27", "181#2706000000", "281#00", "182#2706", "282#0011223344556677"),
    "heartbeats": ("701#", "701#0505", "702#55"),
    "emergencies": ("081#", "081#3081", "082#30811100000000"),
}


def broken_frames(test):
    """State, speed and setpoints stay what they are; the counters tell."""
    with Patient(test) as d:
        d.bring_up(SPEED_MPS)
        before = d.counters()
        for what, frames in FOREIGN.items():
            since = time.time()
            cansend(*frames)
            time.sleep(0.2)
            d.check_unimpressed(since, SPEED_MPS, what)
        between = d.counters()
        for name in ("drive.rejected_frames", "drive.intruder_frames", "can.malformed"):
            check(between[name] == before[name], f"{name} rose by others' frames")
        count = 0
        for what, frames in GARBLED.items():
            since = time.time()
            cansend(*frames)
            time.sleep(0.2)
            d.check_unimpressed(since, SPEED_MPS, f"garbled {what}")
            count += len(frames)
        rejected = d.counters()["drive.rejected_frames"] - between["drive.rejected_frames"]
        check(rejected == count, f"{rejected} of {count} garbled frames were counted")
        d.check_runs()


def error_frames(test):
    """Error-passive is shown, bus-off believed: a virtual bus has no controller to ask."""
    with Patient(test) as d:
        d.bring_up(SPEED_MPS)
        before = d.counters()["can.error_frames"]
        since = time.time()
        cansend("20000004#0000000000000000")
        cansend("20000004#0030000000000000")
        d.wait_for("CAN/STATE", lambda m: m.bus == "error-passive", 5, "error-passive", since)
        cansend("20000004#0040000000000000")
        d.wait_for("CAN/STATE", lambda m: m.bus == "up", 5, "up", time.time())
        d.check_unimpressed(since, SPEED_MPS, "error-passive")
        off = time.time()
        cansend("20000040#0000000000000000")
        d.wait_state("fault", 5, off, "CAN bus-off")
        d.wait_standstill(off)
        risen = d.counters()["can.error_frames"] - before
        check(risen == 4, f"{risen} of 4 error frames were counted")
        reset_and_arm(d)


def random_frames(test):
    """Nothing crashes, nothing moves by itself, and in the end it can be armed again."""
    with Patient(test) as d:
        d.bring_up()
        # 29-bit: all the same to an armed vehicle.
        d.drive(SPEED_MPS)
        since = time.time()
        cangen = ("/usr/bin/cangen", "vcan0", "-g", "1", "-I", "r", "-L", "r", "-D", "r")
        test.run(*cangen, "-n", "500", "-e", seconds=30)
        d.check_unimpressed(since, SPEED_MPS, "random 29-bit frames")
        # 11-bit ones: among them commands to the drives. Then of all formats, then remote frames.
        d.hold(0.0)
        d.wait_standstill(time.time())
        d.request("disarm")
        d.wait_state("disarmed")
        before = d.counters()
        since = time.time()
        test.run(*cangen, "-n", "3000", seconds=60)
        test.run(*cangen, "-n", "500", "-m", seconds=60)
        test.run(*cangen, "-n", "300", "-R", seconds=60)
        d.check_still(since, "random frames")
        check("armed" not in d.states(since), f"random frames: {d.states(since)}")
        after = d.counters()
        risen = {name: after[name] - before[name] for name in ("drive.rejected_frames", "drive.intruder_frames")}
        test.say(f"3800 random frames: {risen}, then {d.now()}")
        check(all(risen.values()), f"not all counted: {risen}")
        d.check_runs()
        reset_and_arm(d)
        d.drive(SPEED_MPS)


def random_frames_while_armed(test):
    """At most a twitch before FAULT; then the wheels stand, and the bridge says what they do."""
    with Patient(test) as d:
        d.bring_up()
        before = d.counters()["drive.intruder_frames"]
        first = d.network.last("SIM/WHEELS")
        since = time.time()
        test.run("/usr/bin/cangen", "vcan0", "-g", "1", "-I", "r", "-L", "r", "-D", "r", "-n", "3000", seconds=60)
        time.sleep(1.2)
        d.check_runs()
        risen = d.counters()["drive.intruder_frames"] - before
        check(risen > 0, "no intruder was counted")
        states = d.network.messages("CAN/STATE", since)
        stopped = next((m.arrival for m in states if m.state_name != "armed"), time.time())
        wheels = d.network.messages("SIM/WHEELS", since)
        moved = {0: 0.0, 1: 0.0}
        for m in wheels:
            ways = (m.left_angle_rad - first.left_angle_rad, m.right_angle_rad - first.right_angle_rad)
            for when in (0, 1) if m.arrival <= stopped else (1,):
                moved[when] = max(moved[when], *(abs(w) * WHEEL_RADIUS_M for w in ways))
        test.say(f"3000 random frames while armed: {moved[0] * 1e3:.1f} mm before, {moved[1] * 1e3:.1f} mm in all; {risen} intruders; {d.now()}")
        check(moved[0] <= 0.005, f"moved {moved[0]} m without FAULT")
        state = d.state()
        check(time.time() - state.arrival < 0.5, "CAN/STATE is silent")
        check(state.state_name == "fault" and "another sender commands these drives" in state.reason, d.now())
        d.check_still(time.time() - 0.5, "after the random frames")
        # A report of the largest speed must not keep RESET refused for longer than a possible one.
        cansend("181#0002FFFFFF7F", "182#0002FFFFFF7F")
        reset_and_arm(d)
        d.drive(SPEED_MPS)


def intruders(test):
    """Frames that only one master may send: detected, named, and the vehicle stops."""
    cases = {
        "a setpoint": ("201#0F00E8030000", "0x201"),
        "a short setpoint": ("202#0F00", "0x202"),
        "an NMT stop": ("000#0200", "0x000"),
        "a second heartbeat of the master": ("77F#05", "0x77F"),
        "a second SYNC": ("080#", "0x080"),
    }
    with Patient(test) as d:
        d.bring_up()
        short = d.counters("CAN/DRIVE_COUNTERS")["node2.rpdo_too_short"]
        for what, (frame, identifier) in cases.items():
            d.drive(SPEED_MPS)
            before = d.counters()["drive.intruder_frames"]
            begin = time.time()
            cansend(frame)
            fault = d.wait_state("fault", 5, begin, f"another sender uses {identifier}: only one master may command")
            check("another sender commands these drives: " in fault.reason, fault.reason)
            stopping = d.wait_for("CAN/STATE", lambda m: m.state_name != "armed", 5, what, begin)
            stand = d.wait_standstill(begin)
            test.say(
                f"measured: {what} of an intruder at {SPEED_MPS} m/s: disarmed after "
                f"{(stopping.arrival - begin) * 1e3:.0f} ms (with cansend's start), wheels stand after "
                f"{(stand - begin) * 1e3:.0f} ms"
            )
            check(stand - begin < 1.5, f"{what}: wheels stood after {stand - begin:.3f} s")
            time.sleep(0.3)
            d.check_still(stand, what)
            risen = d.counters()["drive.intruder_frames"] - before
            check(risen == 1, f"{what}: counted {risen} times")
            reset_and_arm(d)
        short = d.counters("CAN/DRIVE_COUNTERS")["node2.rpdo_too_short"] - short
        check(short == 1, f"the drive counted {short} short setpoints")


def refused(test, code, texts, *command):
    """The command ends at once with `code` and a message on stderr that contains all `texts`."""
    program = test.run(*command, seconds=15)
    said = " ".join(str(part) for part in command)
    check(program.process.returncode == code, f"{said}: exit code {program.process.returncode}")
    for text in texts:
        check(text in program.err(), f"{said}: no {text!r} in:\n{program.err()}")
    return program.err().strip().splitlines()[-1]


def missing_interface(test):
    """Exit code 1, with the command that mends it."""
    for program in ("tether-can-bridge", "tether-can-drive"):
        for interface, fix in {
            "vcan9": "ip link add dev vcan9 type vcan && ip link set vcan9 up",
            "can9": "ip link set can9 up type can bitrate 500000",
        }.items():
            setting = ("--set", f"can.interface={interface}", "--start-utime", "1")
            message = refused(test, 1, [f"no CAN interface {interface}", fix], program, SCENARIO, *setting)
    test.say(f"no interface: {message}")
    refused(test, 1, ["lo", "cannot be used for CAN"], program, SCENARIO, "--set", "can.interface=lo", "--start-utime", "1")


main(missing_interface, broken_frames, error_frames, random_frames, random_frames_while_armed, intruders)
