#!/usr/bin/env -S python3 -B
"""Frames of drives, recorded once in a good run and once with a fault, and played back by
canplayer to a fresh bridge when the drives are gone, leads to the same published states and reasons
in the same order. Usage: replay_test.py BIN_DIR

A bridge asks, and expects answers, in its control cycles. So the record is played on the same time
line, but for half a cycle: each answer comes after its question and before the next cycle, though
this machine's timing is not exact.
"""

import os
import time
import types

from can_drivetrain import NODES, Drivetrain, Record, patient_file, steps
from live_support import check, main

CYCLE_S = 0.1
LEAD_S = 14.0  # start-up takes 56 SDO transfers, arming 26, one a cycle
SPEED_MPS = 0.5

# Identifiers that the drives send: emergencies, TPDO1 and 2, SDO answers, heartbeats.
FROM_DRIVES = [base + node for base in (0x080, 0x180, 0x280, 0x580, 0x700) for node in NODES]

FAULT_AT_S = 1.03

# Positions witness standstill over 0.1 s, and come 0.1 s apart: microseconds decide whether two of
# them are enough, or one more is waited for.
EDGE = "waiting until its wheel stands"

# Each at its time in the run.
GOOD = (
    (-5.0, lambda d: d.hold(0.0)),
    (-4.07, lambda d: d.request("arm")),
    (0.0, lambda d: d.hold(SPEED_MPS)),
    (1.5, lambda d: d.hold(0.0)),
    (2.53, lambda d: d.request("disarm")),
    (3.5, lambda d: None),
)
FAULT = (
    *GOOD[:3],
    (FAULT_AT_S, lambda d: d.inject("fault", 2, 0x2310)),  # in the replay, the record has it
    (2.53, lambda d: d.request("reset")),
    (3.5, lambda d: None),
)


class Recorded(Drivetrain):
    settings = (
        f"can.cycle_ms={CYCLE_S * 1e3}",
        "can.stale_ms=1000",
        "can.disarm_ms=2000",
        f"run.lead_s={LEAD_S}",
    )

    def __init__(self, test):
        super().__init__(test, patient_file(test))
        self.drives_start_utime = self.start_utime

    def inject(self, *fault):
        """The drives are in a run of their own: they are on before the bridge's begins."""
        mine = self.start_utime
        self.start_utime = self.drives_start_utime
        super().inject(*fault)
        self.start_utime = mine

    def play(self, script, at_start=lambda: None):
        """The bridge's whole run; what it published."""
        self.start_utime = int((time.time() + LEAD_S + 3.0) * 1e6)  # 3 s for the program to start
        since = time.time()
        self.start_bridge(wait=False)
        at_start()
        for run_time_s, act in script:
            late = time.time() - (self.start_utime / 1e6 + run_time_s)
            check(late < 0, f"{late:.3f} s late at {run_time_s} s")
            time.sleep(-late)
            act(self)
        states = self.network.messages("CAN/STATE", since)
        wheels = self.network.messages("CAN/WHEELS", since)
        counters = self.network.counters("CAN/COUNTERS")
        self.bridge.kill()
        self.bridge.wait(5)
        return types.SimpleNamespace(
            states=steps((m.state_name, m.reason) for m in states if EDGE not in m.reason),
            drives=steps((m.left_state, m.right_state, m.left_error_code, m.right_error_code) for m in wheels),
            counts=(wheels[-1].left_position_counts, wheels[-1].right_position_counts),
            ready_s=next((m.utime / 1e6 for m in states if m.state_name == "disarmed"), None),
            slips=counters.get("cycle.slips"),
        )


def record(test, name, script):
    """Published messages, and the drives' frames as candump's lines with their times in the run."""
    with Recorded(test) as d:
        d.start_drives()
        candump = Record(test, name)
        live = d.play(script)
        path = candump.stop()
        d.drives.kill()
        d.drives.wait(5)
    lines = []
    for line in path.read_text().splitlines():
        stamp, _, frame = line.split()
        run_time_s = float(stamp[1:-1]) - d.start_utime / 1e6
        identifier = frame.split("#")[0]
        if run_time_s > -LEAD_S and len(identifier) == 3 and int(identifier, 16) in FROM_DRIVES:
            lines.append((run_time_s, frame))
    check(len(lines) > 500, f"only {len(lines)} frames of the drives")
    return live, lines


def replay(test, name, script, lines):
    fifo = test.work / f"{name}.fifo"
    os.mkfifo(fifo)
    with Recorded(test) as d:

        def start_player():
            test.start("/usr/bin/canplayer", "-I", fifo)
            # canplayer takes its time from when the first line comes.
            begin = d.start_utime / 1e6 + CYCLE_S / 2
            text = "".join(f"({begin + t:.6f}) vcan0 {frame}\n" for t, frame in lines)
            with open(fifo, "w") as file:
                early = begin + lines[0][0] - time.time()
                check(early > 0, f"the player is {-early:.3f} s late")
                time.sleep(early)
                file.write(text)

        script = [step for step in script if step[0] != FAULT_AT_S]
        return d.play(script, start_player)


def show(test, published):
    test.say(f"  ready at {published.ready_s} s")
    for state, reason in published.states:
        if state != "starting":
            test.say(f"  {state}: {reason}")


def check_same(test, live, played):
    for what in ("states", "drives", "counts"):
        expected, got = getattr(live, what), getattr(played, what)
        if expected == got:
            continue
        i = next((i for i, (a, b) in enumerate(zip(expected, got)) if a != b), min(len(expected), len(got)))
        check(False, f"{what} differ from number {i} on: {expected[i:i + 3]}, replayed {got[i:i + 3]}; ready at {live.ready_s}, {played.ready_s} s, slips {live.slips}, {played.slips}")


def a_good_run(test):
    live, lines = record(test, "replay_good", GOOD)
    show(test, live)
    names = steps(state for state, _ in live.states)
    check(names == ["starting", "disarmed", "arming", "armed", "stopping", "disarmed"], f"{names}")
    check(live.counts[0] > 10000, f"{live.counts}")
    check_same(test, live, replay(test, "good", GOOD, lines))


def a_run_with_a_fault(test):
    live, lines = record(test, "replay_fault", FAULT)
    show(test, live)
    names = steps(state for state, _ in live.states)
    check(names == ["starting", "disarmed", "arming", "armed", "fault", "starting", "disarmed"], f"{names}")
    check(any("0x2310 (continuous over-current" in reason for _, reason in live.states), "no 0x2310")
    check_same(test, live, replay(test, "fault", FAULT, lines))


main(a_good_run, a_run_with_a_fault)
