#!/usr/bin/env -S python3 -B
"""The drivetrain's way from power-on to "armed", as other tools on the CAN bus see it: the order of
a cold start, both kinds of quick stop that drives may have, and drives that cannot be used.
Usage: startup_test.py BIN_DIR"""

import time

from can_drivetrain import (
    BRIDGE_BEAT,
    NMT,
    NODES,
    TWO_NODES,
    Drivetrain,
    Record,
    changed_file,
    controlword,
    drive_state,
    heartbeat,
    rpdo1,
    steps,
    tpdo1,
)
from can_support import CanBus, integer, tshark
from live_support import check, main

# Configuration of a drive: (object, value) is written, object alone is read.
SETUP = """
    1000:0
    1016:1=7F00FA 1016:1
    1017:0=64 1017:0
    6007:0=3 6007:0  1029:1=0 1029:1  605A:0=2 605A:0  605E:0=2 605E:0
    6083:0=3840 6083:0  6084:0=4B00 6084:0  6085:0=4B00 6085:0
    1400:1 1400:1=80000{RPDO1} 1600:0=0 1600:1=60400010 1600:2=60FF0020 1600:0=2
    1400:2=1 1400:5=64 1400:5 1400:1={RPDO1}
    1400:1 1600:0 1600:1 1600:2 1400:2
    1800:1 1800:1=80000{TPDO1} 1A00:0=0 1A00:1=60410010 1A00:2=606C0020 1A00:0=2
    1800:2=1 1800:1={TPDO1}
    1800:1 1A00:0 1A00:1 1A00:2 1800:2
    1801:1 1801:1=80000{TPDO2} 1A01:0=0 1A01:1=60640020 1A01:2=603F0010 1A01:3=60610008 1A01:0=3
    1801:2=1 1801:1={TPDO2}
    1801:1 1A01:0 1A01:1 1A01:2 1A01:3 1801:2
    6060:0=3 6061:0
"""


def setup_of(node):
    names = {"RPDO1": 0x200 + node, "TPDO1": 0x180 + node, "TPDO2": 0x280 + node}
    return SETUP.format(**{name: f"{value:X}" for name, value in names.items()}).split()


def verification_of(node):
    """Objects that are read again before arming: all but device type, mode, and identifiers as they were
    before they were written."""
    setup = setup_of(node)
    return [
        s
        for s, then in zip(setup, setup[1:] + [""])
        if "=" not in s and s not in ("1000:0", "6061:0") and not then.startswith(s + "=")
    ]


class Dissected:
    """One frame as Wireshark reads it."""

    FIELDS = ["frame.time_epoch", "can.id", "_ws.malformed"] + [
        f"canopen.{f}"
        for f in ("nmt_ctrl.cd", "nmt_ctrl.node_id", "nmt_guard.state", "sdo.ccs", "sdo.main_idx")
        + ("sdo.sub_idx", "sdo.data.bytes", "sdo.abort_code")
    ]

    def __init__(self, row):
        self.time, self.id, self.malformed, *canopen = row
        self.time, self.id = float(self.time), int(self.id, 0)
        command, node, state, self.specifier, index, sub, data, self.abort = canopen
        self.nmt = (int(command, 0), int(node, 0)) if command else None
        self.state = int(state, 0) if state else None
        self.object = f"{int(index, 0):04X}:{int(sub, 0):X}" if index else None
        value = int.from_bytes(bytes.fromhex(data), "little")
        self.step = self.object and self.object + (f"={value:X}" if self.writes else "")

    @property
    def writes(self):
        return self.specifier and int(self.specifier, 0) == 1


def check_configuration(frames, node):
    """From its reset to its start; returns the times of both."""
    resets = [f for f in frames if f.nmt == (0x81, node)]
    starts = [f for f in frames if f.nmt == (0x01, node)]
    counts = len(resets), len(starts)
    check(counts == (1, 1), f"node {node}: {counts} NMT resets and starts")
    reset, start = resets[0].time, starts[0].time
    boots = [f.time for f in frames if f.id == heartbeat(node) and f.state == 0 and f.time > reset]
    questions = [f for f in frames if f.id == 0x600 + node]
    early = {f.step for f in questions if f.time < reset}
    # Whether it stands, where, and who watches it; nothing is written.
    check(early <= {"6041:0", "606C:0", "1016:1", "6064:0"}, f"node {node}: {early} before its reset")
    verified = steps(f.step for f in questions if f.time > start)
    check(verified == verification_of(node), f"node {node} was verified by {verified}")
    asked = [f for f in questions if reset < f.time < start]
    answers = [f for f in frames if f.id == 0x580 + node and reset < f.time < start]
    check(len(boots) == 1 and boots[0] < asked[0].time, f"node {node}: reset, boot-up, SDO")
    found, wanted = steps(f.step for f in asked), setup_of(node)
    check(found == wanted, f"node {node} was configured by\n{found}\nnot by\n{wanted}")
    # Each question waits for the answer to the one before.
    talk = sorted(asked + answers, key=lambda f: f.time)
    check(
        [f.id for f in talk] == [0x600 + node, 0x580 + node] * len(asked)
        and all(a.object == q.object for q, a in zip(talk[::2], talk[1::2])),
        f"node {node}: questions without their answers",
    )
    beats = [f for f in frames if f.id == BRIDGE_BEAT and talk[-1].time < f.time < start]
    check(len(beats) >= 2, f"node {node} was started after {len(beats)} heartbeats of the bridge")
    check(all(f.state == 5 for f in beats), "the bridge's heartbeat does not say operational")
    return start


def check_way_up(record, node, started):
    """Controlwords follow only on the statusword before, with target zero."""
    frames = record.frames(rpdo1(node), tpdo1(node))
    check(frames[0].timestamp > started, f"node {node}: process data before NMT start")
    words, state = [], None
    for f in frames:
        if f.arbitration_id == tpdo1(node):
            state = drive_state(f)
            continue
        check(integer(f.data, 2, 4) == 0, f"node {node}: a target before it is armed")
        words.append((controlword(f), state))
    ways = steps(word for word, _ in words if word not in (0x0000, 0x0002))
    check(ways == [0x06, 0x07, 0x0F], f"node {node}: controlwords {ways}")
    before = {0x06: "switch on disabled", 0x07: "ready to switch on", 0x0F: "switched on"}
    for word, needed in before.items():
        at = next(state for w, state in words if w == word)
        check(at == needed, f"node {node}: controlword {word:04X} in {at}")


def cold_start_goes_step_by_step(test):
    record = Record(test, "cold_start")
    with Drivetrain(test) as agv:
        agv.start_drives()
        began = time.time()
        agv.start_bridge()
        agv.arm()
        test.say(f"from the bridge's start to armed: {time.time() - began:.1f} s")
        check(agv.states(began) == ["starting", "disarmed", "arming", "armed"], agv.states(began))
        log = record.stop()
    end_all(test)
    frames = [Dissected(row) for row in tshark(log, *Dissected.FIELDS, where="can.flags.xtd == 0")]
    check(len(frames) == len(record.frames()), "Wireshark and python-can differ in the frames")
    check(not any(f.malformed for f in frames), "malformed frames")
    check(not any(f.abort for f in frames), "SDO aborts")
    for node in NODES:
        check_way_up(record, node, check_configuration(frames, node))


def end_all(test):
    for program in test.programs:
        program.kill()
        program.wait(5)


def quick_stop(test, option):
    """The drives end their quick stop with power off (605A = 2) or wait for that command (6)."""
    change = ('value = 2\nmeaning = "quick stop:', f'value = {option}\nmeaning = "quick stop:')
    drivetrain = changed_file(test, f"quick_stop_{option}.toml", TWO_NODES, change)
    record = Record(test, f"quick_stop_{option}")
    with Drivetrain(test, drivetrain) as agv:
        agv.bring_up(0.5)
        pressed = agv.request("estop")
        agv.wait_state("estop")
        agv.wait_standstill(pressed)
        record.stop()
        agv.request("estop_release")
        agv.wait_state("estop", reason="released")
        agv.request("reset")
        agv.arm()
        agv.drive(0.5)
    end_all(test)
    for node in NODES:
        write = bytes([0x2B, 0x5A, 0x60, 0x00, option, 0, 0, 0])
        check(write in [bytes(f.data) for f in record.frames(0x600 + node)], "605A is not written")
        words = record.frames(rpdo1(node), since=pressed)
        states = record.frames(tpdo1(node), since=pressed)
        sequence = [w for w in steps(controlword(f) for f in words) if w != 0x0F]
        check(sequence == [0x02, 0x00], f"605A = {option}, node {node}: controlwords {sequence}")
        off = next(f.timestamp for f in words if controlword(f) == 0)
        before = steps(drive_state(f) for f in states if f.timestamp < off)
        after = drive_state(states[-1])
        test.say(f"605A = {option}, node {node}: {', '.join(before)}; power off: {after}")
        check("quick stop active" in before, "no quick stop")
        check(("switch on disabled" in before) == (option == 2), "how the drive ended its stop")
        check(after == "switch on disabled", "power stage on after the stop")


def both_kinds_of_quick_stop_end_powered_off(test):
    quick_stop(test, 2)
    quick_stop(test, 6)


def check_not_armed(agv):
    """ARM in vain."""
    asked = agv.request("arm")
    agv.wait_state("refused", since=asked, reason="arming refused")
    time.sleep(0.3)
    check(agv.states(asked) == ["refused"], f"after ARM: {agv.states(asked)}")


def check_drives_not_started(record):
    """No setpoint, and no NMT command but "reset node" and "enter pre-operational"."""
    check(all(f.data[0] in (0x80, 0x81) for f in record.frames(NMT)), "refused drives were started")
    check(not record.frames(*map(rpdo1, NODES)), "setpoints for refused drives")


def a_drive_without_heartbeat_consumer_is_refused(test):
    record = Record(test, "no_watchdog")
    with Drivetrain(test) as agv:
        agv.hold(0.0)
        agv.start_drives()
        agv.inject("sdo_abort", node=2, value=0x1016)
        agv.start_bridge()
        state = agv.wait_state("refused", 15)
        test.say(state.reason)
        for part in ("right drive (node 2)", "0x1016:1", "0x06020000", "no drive-side watchdog"):
            check(part in state.reason, f"the reason does not say {part!r}: {state.reason}")
        check_not_armed(agv)
        record.stop()
        abort = bytes.fromhex("8016100100000206")
        check(abort in [bytes(f.data) for f in record.frames(0x582)], "no abort on the bus")
        check_drives_not_started(record)
        agv.inject("none")
        agv.request("reset")
        agv.arm()


class SdoDrive:
    """A drive's CANopen communication, no more: boot-up, and an SDO server that keeps what is
    written. `trouble(request, answer)` may return another answer, or None."""

    def __init__(self, bus, node):
        self.node = node
        self.trouble = lambda request, answer: answer
        self._bus = bus
        self._objects = {}
        bus.on_frame(self._on_frame)

    def _on_frame(self, frame):
        data = bytes(frame.data)
        if frame.arbitration_id == NMT and data == bytes([0x81, self.node]):
            self._objects = {b"\x00\x10\x00": (0x00020192).to_bytes(4, "little")}
            self._bus.send(heartbeat(self.node), b"\0")
        elif frame.arbitration_id == 0x600 + self.node and (answer := self._answer(data)):
            self._bus.send(0x580 + self.node, answer)

    def _answer(self, request):
        command, name = request[0], request[1:4]
        if command == 0x80:
            return None
        if command >> 5 == 1:  # expedited download
            self._objects[name] = request[4:]
            honest = b"\x60" + name + bytes(4)
        else:
            kept = b"\x60\x60\x00" if name == b"\x61\x60\x00" else name  # 6061 shows 6060
            honest = b"\x43" + name + self._objects.get(kept, bytes(4))
        return self.trouble(request, honest)


CONSUMER = b"\x16\x10\x01"  # 1016:1
# Reaction of the second drive when its heartbeat consumer is written or read -> text of the reason.
TROUBLES = {
    "is silent": (
        lambda answer, reads: None,
        ["no answer", "500 ms", "0x1016:1"],
    ),
    "answers for another object": (
        lambda answer, reads: answer[:1] + b"\x17\x10\x00" + answer[4:],
        ["no answer", "0x1016:1"],
    ),
    "answers with a segmented transfer": (
        lambda answer, reads: b"\x41" + answer[1:4] + b"\x08\0\0\0" if reads else answer,
        ["segmented", "0x1016:1"],
    ),
    "does not keep what is written": (
        lambda answer, reads: answer[:4] + bytes(4) if reads else answer,
        ["no drive-side watchdog", "0x1016:1", "reads 0x0 instead of 0x7F00FA"],
    ),
}


def drives_that_answer_wrongly_are_refused(test):
    record = Record(test, "wrong_answers")
    with CanBus() as bus, Drivetrain(test) as agv:
        agv.hold(0.0)
        drives = {node: SdoDrive(bus, node) for node in NODES}
        for i, (what, (trouble, reason)) in enumerate(TROUBLES.items()):
            drives[2].trouble = lambda request, answer, t=trouble: (
                t(answer, request[0] == 0x40) if request[1:4] == CONSUMER else answer
            )
            since = time.time()
            if i == 0:
                agv.start_bridge()
            else:
                agv.request("reset")
            starting = agv.wait_state("starting", since=since)
            state = agv.wait_state("refused", 15, since=starting.arrival)
            test.say(f"a drive that {what}: {state.reason}")
            for part in ["right drive (node 2)", *reason]:
                check(part in state.reason, f"a drive that {what}: no {part!r} in {state.reason}")
            check_not_armed(agv)
        record.stop()
        check_drives_not_started(record)
        # All that was wrong was that answer.
        drives[2].trouble = lambda request, answer: answer
        mended = agv.request("reset")
        for node in NODES:
            bus.wait(NMT, 10, mended, lambda data, n=node: bytes(data) == bytes([1, n]))


main(
    cold_start_goes_step_by_step,
    both_kinds_of_quick_stop_end_powered_off,
    a_drive_without_heartbeat_consumer_is_refused,
    drives_that_answer_wrongly_are_refused,
)
