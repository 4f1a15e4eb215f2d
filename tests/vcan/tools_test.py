#!/usr/bin/env -S python3 -B
"""An operator's and a technician's commands, `tether can …`, on a running drivetrain: what they do,
say and return. Usage: tools_test.py BIN_DIR"""

import math
import re
import signal
import time

from can_drivetrain import (
    NODES,
    SCENARIO,
    TWO_NODES,
    WHEEL_RADIUS_M,
    Drivetrain,
    Record,
    changed_file,
    patient_file,
)
from live_support import check, main, wait_until

SPEED_MPS = 0.5


class Operator(Drivetrain):
    """Programs are started while it drives: nothing is late that soon."""

    settings = ("can.stale_ms=1000", "can.disarm_ms=2000")

    def __init__(self, test):
        super().__init__(test, patient_file(test))

    def tether(self, *arguments, code=0, out=(), err=()):
        """Runs `tether can …`; the exit code and texts in its output are as said."""
        begin = time.time()
        program = self.test.run("tether", "can", *arguments, seconds=30)
        said = f"tether can {' '.join(map(str, arguments))}"
        whole = f"{said}: exit code {program.process.returncode}\n{program.out()}{program.err()}"
        check(program.process.returncode == code, whole)
        for text in out:
            check(text in program.out(), f"no {text!r}: {whole}")
        for text in err:
            check(text in program.err(), f"no {text!r}: {whole}")
        self.test.say(f"{said} ({time.time() - begin:.1f} s): {program.out().splitlines()[:1]}")
        return program.out()


def requests(test):
    with Operator(test) as d:
        d.start_drives()
        d.start_bridge()
        d.wait_state("disarmed", 20)
        # No command yet, then one that is not zero: refused, and why.
        d.tether("arm", code=1, out=["disarmed: arming refused: there is no command yet"])
        d.hold(SPEED_MPS)
        d.tether("arm", code=1, out=["disarmed: arming refused: the newest command is not zero (0.500 m/s"])
        d.hold(0.0)
        time.sleep(0.1)
        d.tether("arm", out=["armed"])
        check(d.state().state_name == "armed", "not armed")
        d.tether("arm")

        d.drive(SPEED_MPS)
        since = time.time()
        d.tether("disarm", out=["disarmed: disarmed by request"])
        check(d.states(since) == ["armed", "stopping", "disarmed"], f"disarm: {d.states(since)}")
        d.wait_standstill(since)
        d.hold(0.0)
        time.sleep(0.1)

        d.tether("arm", out=["armed"])
        d.drive(SPEED_MPS)
        since = time.time()
        d.tether("estop", out=["estop: e-stop pressed: release it, then reset"])
        d.wait_standstill(since)
        since = time.time()
        d.tether("reset", code=1, out=["reset refused: the e-stop is pressed: release it first"])
        d.tether("arm", code=1, out=["estop: "])
        d.tether("release", out=["estop: e-stop released: reset to go on"])
        d.tether("reset", out=["disarmed: ready to be armed"])
        d.check_still(since, "estop, release, reset")
        check(set(d.states(since)) <= {"estop", "starting", "disarmed"}, f"{d.states(since)}")


def stop_before_a_bridge_is_heard(test):
    """A stop is not asked whether it may: it is on its way before anything was heard."""
    with Operator(test) as d:
        estop = test.start("tether", "can", "estop")
        time.sleep(0.5)
        d.start_drives()
        d.start_bridge()
        code = estop.wait(15)
        said = f"{estop.out()}{estop.err()}"
        check(code == 0 and "estop: e-stop pressed" in estop.out(), f"{code}: {said}")
        d.wait_state("estop", 5)
        d.bridge.kill(signal.SIGKILL)
        d.tether("estop", code=1, err=["no CAN/STATE yet: repeating the request", "no CAN/STATE on udpm://"])


def status(test):
    with Operator(test) as d:
        d.bring_up(SPEED_MPS)
        text = d.tether("status")
        lines = {line.split()[0]: line for line in text.splitlines()}
        keys = ["state", "bus", "setpoint", "disarms", "left", "right", "odometry"]
        check(list(lines) == keys, f"status:\n{text}")
        check(re.fullmatch(r"state +armed", lines["state"]), text)
        check(re.fullmatch(r"bus +up", lines["bus"]), text)
        check("+0.500 m/s, +0.000 rad/s; newest command" in lines["setpoint"], text)
        for side in ("left", "right"):
            speed = float(re.search(r"([+-][\d.]+) m/s", lines[side])[1])
            check(abs(speed - SPEED_MPS) < 0.03, text)
            check("OperationEnabled (0x" in lines[side] and " ms ago" in lines[side], text)
            turns = float(re.search(r"([\d.]+) turns", lines[side])[1])
            counts = int(re.search(r"(\d+) counts", lines[side])[1])
            check(abs(turns - counts / 81920) < 0.01 and turns > 0.01, text)
        driven = float(re.search(r"([\d.]+) m driven", lines["odometry"])[1])
        check(abs(driven - turns * 2 * math.pi * 0.4) < 0.05, text)


def faults(test):
    with Operator(test) as d:
        d.bring_up(SPEED_MPS)
        since = time.time()
        d.tether("inject", "fault", "--node", 2, "--value", 0x2310, out=["injected"])
        d.wait_state("fault", 5, since, "right drive (node 2)")
        d.wait_state("fault", 5, since, "0x2310 (continuous over-current: wheel blocked, or load too heavy)")
        d.wait_standstill(since)
        d.tether("status", out=["state     fault: right drive (node 2)", "error 0x2310"])
        d.tether("arm", code=1, out=["arming refused: a fault is latched: mend it, then reset"])
        d.tether("reset", out=["disarmed: ready to be armed"])
        d.tether("inject", "fault", "--node", 5, code=1,
                 out=["refused: the emulated drives have no such node; allowed: 0 (all), 1, 2"])
        d.tether("inject", "wheel_slip", "--node", 1, code=2, err=["wheel_slip needs --value", "above 0, up to 1"])
        d.tether("inject", "wheel_slip", "--value", 1.5, code=2, err=["above 0, up to 1"])
        d.tether("inject", "sleep", code=2, err=["kind", "sleep", "silence"])
        # A RESET that cannot succeed.
        d.tether("inject", "silence", "--node", 1, out=["injected"])
        d.wait_state("fault", 5, since, "left drive (node 1): no heartbeat for")
        d.tether("reset", code=1, out=["refused: left drive (node 1): no boot-up message within"])
        d.tether("inject", "none", out=["injected"])
        d.tether("reset", out=["disarmed: ready to be armed"])


def drive(test):
    """One twist for a time, by this command alone; zero before ARM and after all that happens."""
    with Operator(test) as d:
        d.settings += ("can.max_speed_mps=0.5",)

        def begin(*arguments):
            """Until it drives."""
            program = test.start("tether", "can", "drive", *map(str, arguments))
            if d.state().state_name != "armed":
                wait_until(5, lambda: "waiting for: tether can arm" in program.out(), "that it waits")
                d.wait_for("CAN/STATE", lambda m: 0 <= m.command_age_s < 0.1, 5, "zero commands")
                d.tether("arm", out=["armed"])
            wait_until(5, lambda: "armed: " in program.out(), "that it drives")
            return program

        def ended(program, code, text, since):
            got = program.wait(15)
            said = program.out() + program.err()
            test.say(f"drive: {(program.out().splitlines() or [''])[-2:]}, exit code {got}")
            check(got == code and text in said, f"exit code {got}, no {text!r}:\n{said}")
            zeros = [m for m in test.network.messages("AGV/CMD_VEL", since)][-8:]
            check(all(m.v_mps == 0 and m.omega_radps == 0 for m in zeros), f"{text}: last commands")
            return said

        def turned(since):
            """Both wheels' way, by the wheels themselves."""
            wheels = test.network.messages("SIM/WHEELS", since)
            ways = ((w[-1] - w[0]) * WHEEL_RADIUS_M for w in zip(*((m.left_angle_rad, m.right_angle_rad) for m in wheels)))
            return tuple(ways)

        d.start_drives()
        d.start_bridge()
        d.wait_state("disarmed", 20)
        d.tether("drive", code=2, err=["nothing to drive: give --v-mps or --omega-radps"])
        since = time.time()
        said = ended(begin("--v-mps", 0.2, "--for-s", 3), 0, "by CAN/ODOMETRY", since)
        driven, yaw = map(float, re.search(r"driven ([\d.]+) m, turned ([+-][\d.]+) rad", said).groups())
        left, right = turned(since)
        check(abs(left - driven) < 0.005 and abs(right - driven) < 0.005, f"{said}: wheels {left}, {right} m")
        check(abs(driven - 0.6) < 0.05 and abs(yaw) < 0.005, said)
        stamps = [m.utime for m in test.network.messages("AGV/CMD_VEL", since)]
        check(stamps == sorted(set(stamps)) and len(stamps) > 60, f"{len(stamps)} commands")
        since = time.time()
        said = ended(begin("--omega-radps", 0.4, "--for-s", 2), 0, "by CAN/ODOMETRY", since)
        left, right = turned(since)
        yaw = float(re.search(r"turned ([+-][\d.]+) rad", said)[1])
        check(abs(yaw - 0.8) < 0.08 and left < -0.4 < 0.4 < right, f"{said}: wheels {left}, {right} m")

        program = begin("--v-mps", 0.3, "--for-s", 60)
        d.wait_for("CAN/STATE", lambda m: m.v_mps > 0.29, 5, "0.3 m/s")
        since = time.time()
        program.kill(signal.SIGINT)
        ended(program, 1, "interrupted", since + 0.05)
        d.wait_standstill(since)
        check(time.time() - since > 0.5, "no zero commands after Ctrl-C")
        program = begin("--v-mps", 1.0)
        ended(program, 1, "the bridge makes 0.500 m/s, 0.000 rad/s of it: the twist is beyond can.max_speed", since)
        program = begin("--v-mps", 0.3)
        since = time.time()
        d.inject("fault", node=2, value=0x2310)
        ended(program, 1, "the drivetrain has stopped; it is", since + 0.3)
        d.wait_standstill(since)
        d.request("reset")
        d.wait_state("disarmed", 10)
        program = begin("--v-mps", 0.3)
        since = time.time()
        d.bridge.kill(signal.SIGSTOP)
        ended(program, 1, "CAN/STATE is silent", since + 0.7)
        d.bridge.kill(signal.SIGCONT)
        d.hold(0.0)
        time.sleep(0.2)
        d.tether("drive", "--v-mps", 0.1, code=1, err=["another program sends AGV/CMD_VEL: end it first"])


def no_bridge_is_there(test):
    with Operator(test) as d:
        d.tether("status", code=1, err=["no CAN/STATE on udpm://", "is tether-can-bridge running"])
        d.tether("drive", "--v-mps", 0.1, code=1, err=["no CAN/STATE on udpm://"])
        d.tether("arm", "--vehicle", "AGV7", code=1, err=["no CAN7/STATE", 'vehicle "AGV7"'])
        d.tether("inject", "fault", code=1, err=["no CAN/DRIVE_COUNTERS", "is tether-can-drive running"])
        d.tether("dance", code=2)


# --- hold to run, and an e-stop that outlives the bridge

def hold_to_run(test):
    with Operator(test) as d:
        d.settings += ("can.operator_timeout_ms=500",)
        d.start_drives()
        d.start_bridge()
        d.hold(0.0)
        d.wait_state("disarmed", 20)
        time.sleep(0.1)
        d.tether("arm", code=1, out=["hold-to-run is released (can.operator_timeout_ms = 500): tether can hold"])
        holder = test.start("tether", "can", "hold")
        wait_until(5, lambda: "disarmed" in holder.out(), "tether can hold shows the state")
        d.tether("arm", out=["armed"])
        d.drive(SPEED_MPS)
        since = time.time()
        holder.kill(signal.SIGINT)
        d.wait_state("disarmed", 5, since, "hold-to-run released")
        stands = d.wait_standstill(since) - since
        test.say(f"measured: tether can hold ended -> wheels stand: {stands * 1e3:.0f} ms")
        check(holder.wait(5) == 0, f"tether can hold: {holder.process.returncode}")


def a_latched_estop_outlives_the_bridge(test):
    with Operator(test) as d:
        d.settings += (f"can.estop_file={test.work}/state/estop",)
        d.start_drives()
        d.start_bridge()
        d.wait_state("estop", 20, reason="(from the start: ")
        d.tether("release", out=["estop: e-stop released: reset to go on"])
        d.tether("reset", out=["disarmed: ready to be armed"])
        d.tether("estop", out=["estop: e-stop pressed: release it, then reset"])
        d.bridge.kill()
        since = time.time()
        d.start_bridge()
        d.wait_state("estop", 20, since)
        d.tether("reset", code=1, out=["reset refused: the e-stop is pressed: release it first"])
        d.tether("release", out=["estop: e-stop released: reset to go on"])
        d.tether("reset", out=["disarmed: ready to be armed"])


# --- probe

SDO_UPLOAD, SDO_UPLOAD_SEGMENT, SDO_ABORT = 0x40, (0x60, 0x70), 0x80


def check_only_reads(record, what):
    """By what the drives did not send: expedited or segmented uploads, or their abort."""
    beats = [0x700 + node for node in NODES]
    answers = [0x580 + node for node in NODES]
    asked = [f for f in record.frames() if f.arbitration_id not in (*beats, *answers)]
    check(asked, f"{what}: nothing was asked")
    for f in asked:
        check(0x601 <= f.arbitration_id <= 0x67F and len(f.data) == 8, f"{what} sent {f}")
        check(f.data[0] in (SDO_UPLOAD, *SDO_UPLOAD_SEGMENT, SDO_ABORT), f"{what} sent {f}")
    return asked


def probe(test):
    with Operator(test) as d:
        record = Record(test, "probe")
        d.start_drives()
        d.tether("probe", "--interface", "vcan0", code=2, err=["whom to probe? Give --node or --drivetrain"])
        text = d.tether("probe", "--interface", "vcan0", "--node", 1, "--node", 2)
        for node in NODES:
            check(f"node {node}: answers" in text, text)
        check("0x1000:00" in text and "0x6041:00" in text and "SwitchOnDisabled" in text, text)
        text = d.tether("probe", "--interface", "vcan0", "--scan", out=["2 of 127 node ids answer"])
        for node in NODES:
            check(f"{node:4}  0x00020192 (CiA 402 drive)" in text, text)
        d.tether("probe", "--interface", "vcan0", "--drivetrain", TWO_NODES,
                 out=['"two CiA 402 drives, profile velocity" fits', "0x60FF:00"])
        wrong = changed_file(test, "wrong.toml", TWO_NODES, ("0x6083:00 u32", "0x6090:00 u32"))
        text = d.tether("probe", "--interface", "vcan0", "--drivetrain", wrong, code=1,
                        out=["does NOT fit: see PROBLEM above"])
        line = next(line for line in text.splitlines() if "0x6090:00" in line)
        check("PROBLEM" in line and "no such object" in line and "the file needs it" in line, line)
        # An absent node, with who is there instead, though these have no heartbeat yet; on an empty bus, too.
        d.tether("probe", "--interface", "vcan0", "--node", 9, code=1,
                 out=["node 9: does not answer (no heartbeat)", "Heard on this bus: nodes 1, 2. Check the node id",
                      "Who is on this bus:", "2 of 127 node ids answer"])
        d.tether("probe", "--interface", "vcan1", "--node", 9, code=1,
                 out=["node 9: does not answer (no heartbeat)", "No node was heard on this bus. Check: supply"])
        record.stop()
        asked = check_only_reads(record, "probe")
        test.say(f"probe: {len(asked)} requests, all SDO uploads")
        d.tether("probe", "--interface", "vcan9", "--node", 1, code=1, err=["no CAN interface vcan9", "ip link add"])
        d.tether("probe", "--interface", "vcan0", "--drivetrain", "nowhere.toml", code=2, err=['"nowhere.toml"'])
        # Requests that the bridge refuses: a ramp that is a typing error, a quick stop that no one configured.
        weak = changed_file(test, "weak.toml", TWO_NODES, ('"0x6085:00 u32"\nvalue = 19200', '"0x6085:00 u32"\nvalue = 192'))
        d.tether("probe", "--interface", "vcan0", "--drivetrain", weak, code=2,
                 err=["the left axis stops with 0.04 m/s2, less than can.max_deceleration_mps2"])
        strong = changed_file(test, "strong.toml", SCENARIO, ("max_deceleration_mps2 = 3.0", "max_deceleration_mps2 = 5.0"))
        d.tether("probe", "--interface", "vcan0", "--scenario", strong, "--drivetrain", TWO_NODES, code=2,
                 err=["the left axis stops with 4.02 m/s2, less than can.max_deceleration_mps2 = 5"])
        d.tether("probe", "--interface", "vcan0", "--scenario", SCENARIO, "--drivetrain", TWO_NODES, out=["fits"])
        none = changed_file(test, "none.toml", TWO_NODES, ('object = "0x605A:00 i16"', 'object = "0x605D:00 i16"'))
        d.tether("probe", "--interface", "vcan0", "--drivetrain", none, code=2,
                 err=["left axis: no [[setup]] sets its quick stop option (0x605A)"])


def probe_of_a_configured_drivetrain(test):
    """Changes nothing: reading is not commanding, and the bridge takes no notice of answers that it
    did not ask for."""
    with Operator(test) as d:
        d.bring_up()
        d.request("disarm")
        d.wait_state("disarmed")
        since = time.time()
        d.tether("probe", "--interface", "vcan0", "--node", 1, out=["node 1: answers, heartbeat: operational"])
        d.tether("probe", "--interface", "vcan0", "--node", 9, code=1,
                 out=["node 9: does not answer", "Heard on this bus: nodes 1, 2, 127"])
        check(set(d.states(since)) == {"disarmed"}, f"probe: {d.states(since)}")
        check("another sender" not in d.state().reason, d.state().reason)


main(
    requests,
    stop_before_a_bridge_is_heard,
    status,
    drive,
    faults,
    hold_to_run,
    a_latched_estop_outlives_the_bridge,
    no_bridge_is_there,
    probe,
    probe_of_a_configured_drivetrain,
)
