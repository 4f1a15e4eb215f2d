#!/usr/bin/env -S python3 -B
"""`tether live` ends cleanly, for every way to end it, and says how the run is going while it lasts.
Usage: end_test.py BIN_DIR"""

import fcntl
import json
import os
import pty
import re
import select
import signal
import struct
import termios
import threading
import time

from live_support import NODES, PAPER, alive, check, main, wait_for_loop, wait_until

FAST = ("--set", "sensor.rate_hz=20")


def started(test, *options, **streams):
    live = test.start("tether", "live", PAPER, *FAST, *options, **streams)
    wait_for_loop(test.network)
    nodes = live.children()
    check(set(nodes) == set(NODES), f"runs {sorted(nodes)}")
    return live, nodes


def check_gone(nodes, seconds, how):
    before = time.monotonic()
    wait_until(seconds, lambda: not any(map(alive, nodes.values())), f"{how}: nodes are gone")
    return time.monotonic() - before


def ends_on_signal(test):
    for number in (signal.SIGINT, signal.SIGTERM):
        live, nodes = started(test)
        live.kill(number)
        before = time.monotonic()
        code = live.wait(3)
        took = time.monotonic() - before
        check(code == 0, f"{number.name}: exit code {code}")
        check(not any(map(alive, nodes.values())), f"{number.name}: nodes are left")
        pattern = r"valid     one run on this network, one of each node, all alive\nε = \d+\.\d+ m "
        check(re.match(pattern, live.out()), f"no summary: {live.out()}")
        check(re.search(r"^uplink +\d+ sent, \d+ delivered", live.out(), re.MULTILINE), "no uplink")
        check("settled" not in live.out(), f"10 s were not driven: {live.out()}")
        test.say(f"{number.name}: ended after {took:.2f} s with {live.out().splitlines()[1]}")


def has_no_result_before_the_start(test):
    live = test.start("tether", "live", PAPER)
    wait_until(5, lambda: live.err().count(": running, t = -") == 3, "the nodes wait for t = 0")
    nodes = live.children()
    live.kill(signal.SIGINT)
    check(live.wait(3) == 1, "exit code")
    check("no result: ended before t = 0" in live.err(), live.err())
    check(live.out() == "", f"a summary of nothing: {live.out()}")
    check(not any(map(alive, nodes.values())), "nodes are left")


def is_not_valid_when_its_controller_never_commands(test):
    command = "sleep 60; : {url}"
    live = test.start("tether", "live", PAPER, *FAST, "--duration", "2", "--set", f'controller.command="{command}"')
    check(live.wait(15) == 1, f"exit code: {live.err()}")
    told = r"INVALID .*\n +the controller of AGV never sent a command, and \d+ poses reached it\n"
    check(re.match(told, live.out()), f"a run without control is valid: {live.out()}")


def leaves_nothing_behind_when_killed(test):
    live, nodes = started(test)
    live.kill(signal.SIGKILL)
    live.wait(3)
    took = check_gone(nodes, 2, "SIGKILL")
    test.say(f"SIGKILL: the three nodes were gone after {took:.2f} s")


def lasts_as_long_as_told(test):
    live = test.start("tether", "live", PAPER, *FAST, "--duration", "3", "--json")
    wait_until(5, lambda: len(live.children()) == 3, "nodes")
    nodes = live.children()
    check(live.wait(10) == 0, "exit code")
    check(not any(map(alive, nodes.values())), "nodes are left")
    summary = json.loads(live.out())
    check(summary["sim_time_s"] == 3.0, f"simulated {summary['sim_time_s']} s")
    poses = summary["uplink"]["sent"]
    check(60 <= poses <= 61, f"{poses} poses at 20 Hz in 3 s")
    for link, counter in (("uplink", "controller.pose"), ("downlink", "sim.command")):
        accepted = summary["counters"][counter + ".accepted"]
        delivered = summary[link]["delivered"]
        # The last one may be on its way when the nodes get SIGTERM.
        check(0 <= delivered - accepted <= 1, f"{link}: {delivered} delivered, {accepted} accepted")
    test.say(f"--duration 3: {summary['sim_time_s']} s simulated, {poses} poses")


class Terminal:
    """A terminal that keeps what is written to it."""

    def __init__(self, columns=0, rows=0):
        self.reader, self.writer = pty.openpty()
        fcntl.ioctl(self.writer, termios.TIOCSWINSZ, struct.pack("4H", rows, columns, 0, 0))
        self.text = b""
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        while select.select([self.reader], [], []):
            try:
                self.text += os.read(self.reader, 4096)
            except OSError:
                return


def shows_one_status_line(test):
    terminal = Terminal()
    live, _ = started(test, "--set=channel.prr=0.8", stderr=terminal.writer)
    os.close(terminal.writer)
    line = re.compile(
        r"\r +\d+ s left +-?\d+\.\d, +-?\d+\.\d m  error +\d+\.\d\d m"
        r"  up +(-|[01]\.\d\d) +(-|\d+ ms)  down +(-|[01]\.\d\d) +(-|\d+ ms)\x1b\[J"
    )

    def busy():
        found = list(line.finditer(terminal.text.decode()))
        return found if len(found) >= 4 and found[-1].group(1) != "-" else None

    found = wait_until(10, busy, "four status lines")
    live.kill(signal.SIGINT)
    check(live.wait(3) == 0, "exit code")
    time.sleep(0.1)
    text = terminal.text.decode()
    check(text.endswith("\r\x1b[K"), f"the status line stays: {text[-200:]!r}")
    longest = max(len(m.group()) for m in found) - len("\r\x1b[J")
    check(longest < 80, f"the status line has {longest} columns")
    test.say(f"on a terminal: {found[-1].group()[1:-3]}")
    test.say("before it:     " + text[: found[0].start()].replace("\x1b[J", "").strip())


def shows_a_map_where_there_is_room(test):
    terminal = Terminal(columns=79, rows=18)
    live, _ = started(test, stderr=terminal.writer)
    os.close(terminal.writer)

    def frames():
        found = re.split(r"\r\x1b\[\d+A", terminal.text.decode())
        return found if len(found) >= 6 else None

    frame = wait_until(10, frames, "six frames")[-2]
    lines = re.sub(r"\x1b\[\d*[mKJ]", "", frame).split("\r\n")
    live.kill(signal.SIGINT)
    check(live.wait(3) == 0, "exit code")
    check(len(lines) == 17, f"{len(lines)} lines: {frame!r}")
    check(max(map(len, lines)) <= 79, f"too wide: {lines}")
    map_of_it = "".join(line[:32] for line in lines)
    check(re.search("[\u2801-\u28ff]", map_of_it), f"no path: {lines}")
    check(re.search("[→↗↑↖←↙↓↘]", map_of_it), f"no vehicle: {lines}")
    for fact in (r"t \d+\.\d of 62 s", r"uplink +PRR 1.00.*run 1.00", r"valid so far"):
        check(any(re.search(fact, line) for line in lines), f"no {fact}: {lines}")
    time.sleep(0.1)
    check(terminal.text.decode().endswith("\x1b[J"), "the dashboard stays")
    test.say("on a large terminal:")
    for line in lines:
        test.say(line)


main(
    ends_on_signal,
    has_no_result_before_the_start,
    is_not_valid_when_its_controller_never_commands,
    leaves_nothing_behind_when_killed,
    lasts_as_long_as_told,
    shows_one_status_line,
    shows_a_map_where_there_is_room,
)
