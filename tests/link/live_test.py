#!/usr/bin/env -S python3 -B
"""Two tether-link processes between two LCM networks, by two paths that can be pulled.
Usage: live_test.py BIN_DIR"""

import pathlib
import random
import re
import signal
import socket
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "live"))

from live_support import (  # noqa: E402
    GROUP,
    PORT,
    TWIST,
    TYPES,
    LcmType,
    Network,
    check,
    main,
    wait_until,
)

FAR_PORT = 7668
TYPES["LINK/REPORT"] = LcmType("peer_report")


class Path:
    """Network between the hosts on one path: a forwarder with an address of its own on each side. It
    records, and can be pulled."""

    def __init__(self, near, far):
        self.pulled = False
        self.recorded = []  # (datagram, towards)
        self._ends = {side: ("127.0.0.1", port) for side, port in (("near", near), ("far", far))}
        self._sockets = {side: self._open() for side in self._ends}
        for side in self._ends:
            threading.Thread(target=self._forward, args=(side,), daemon=True).start()

    @staticmethod
    def _open():
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind(("127.0.0.1", 0))
        return made

    def address(self, side):
        """Where that side sends to, and hears from."""
        return "%s:%d" % self._sockets[side].getsockname()

    def send(self, datagram, towards):
        self._sockets[towards].sendto(datagram, self._ends[towards])

    def _forward(self, side):
        other = "far" if side == "near" else "near"
        while True:
            datagram = self._sockets[side].recv(65536)
            self.recorded.append((datagram, other))
            if not self.pulled:
                self.send(datagram, other)


class Link:
    """The near host sends CTRL/CMD_VEL, which is AGV/CMD_VEL on the far one, and hears POSE."""

    def __init__(self, test, options=""):
        self.test = test
        self.near, self.far = test.network, Network(FAR_PORT)
        self.paths = [Path(7700, 7710), Path(7701, 7711)]
        self.keys = {
            side: test.run("tether-link", "keygen", test.work / f"{side}.key").out().strip()
            for side in ("near", "far")
        }
        self.near_program = self.start("near", PORT, 7700, options)
        self.far_program = self.start("far", FAR_PORT, 7710, options)
        wait_until(10, lambda: self.report(self.near) and self.report(self.near).up, "near is up")
        wait_until(10, lambda: self.report(self.far) and self.report(self.far).up, "far is up")

    def start(self, side, lcm_port, udp_port, options):
        other = "far" if side == "near" else "near"
        rules = {
            "near": 'send = ["CTRL/(CMD_VEL) -> AGV/$1"]\nreceive = ["CTRL/POSE"]',
            "far": 'send = [".*"]\nreceive = ["AGV/CMD_VEL"]',
        }[side]
        addresses = ", ".join(f'"{path.address(side)}"' for path in self.paths)
        file = self.test.work / f"{side}.toml"
        file.write_text(f"""
            key = "{side}.key"
            lcm_url = "udpm://{GROUP}:{lcm_port}?ttl=0"
            report_period_s = 0.2
            {options}
            [[path]]
            name = "wifi"
            bind = "127.0.0.1:{udp_port}"
            [[path]]
            name = "5g"
            bind = "127.0.0.1:{udp_port + 1}"
            [[peer]]
            name = "{other}"
            public_key = "{self.keys[other]}"
            addresses = [{addresses}]
            {rules}
            """)
        file.chmod(0o644)
        return self.test.start("tether-link", "run", file)

    @staticmethod
    def report(network, since=0.0):
        return network.last("LINK/REPORT", since)

    def command(self, number):
        self.near.send("CTRL/CMD_VEL", TWIST.encode(seq=number))

    def numbers(self):
        return [m.seq for m in self.far.messages("AGV/CMD_VEL")]

    def fresh_report(self, network):
        now = time.time()
        return wait_until(5, lambda: self.report(network, now), "a report")

    def refused(self, network):
        report = self.fresh_report(network)
        return dict(zip(report.refused, report.refused_count))

    def end(self):
        for program in (self.near_program, self.far_program):
            program.kill(signal.SIGINT)
            check(program.wait(5) == 0, program.err())
        self.far.close()


def no_message_is_missed_when_either_path_is_pulled(test, options=""):
    link = Link(test, options)
    count = 600
    for number in range(count):
        link.paths[0].pulled = 150 <= number < 350
        link.paths[1].pulled = 400 <= number < 550
        link.command(number)
        time.sleep(0.005)
    time.sleep(0.5)
    check(sorted(link.numbers()) == list(range(count)), "each once, and none is missed")
    echoes = len(link.near.messages("CTRL/CMD_VEL")) - count
    check(echoes == 0 and "AGV/CMD_VEL" not in link.near.channels(), f"{echoes} came back")
    report = link.fresh_report(link.far)
    check(report.path == ["wifi", "5g"] and all(report.path_alive), vars(report))
    check(all(lost > 0 for lost in report.path_lost), f"lost: {report.path_lost}")
    # One host has one clock.
    check(report.offset_min_ms <= 0 <= report.offset_max_ms, vars(report))
    check(report.offset_max_ms - report.offset_min_ms < 20, vars(report))
    refused = dict(zip(report.refused, report.refused_count))
    # When both call at once, an answer may come for the call that was given up.
    check(refused.pop("no_session") <= 8 and not any(refused.values()), refused)
    link.end()
    test.say(f"offset {report.offset_min_ms:.3f} to {report.offset_max_ms:.3f} ms")
    return report


def both_paths_down_are_said_within_a_second(test):
    link = Link(test)
    doctor = test.run("tether-vehicle", "doctor", "--link").out()
    check(re.search(r"ok +link +up: far; clocks agree", doctor), doctor)
    wait_until(5, lambda: all("up, by wifi and 5g" in p.err() for p in (link.near_program, link.far_program)), "both up")
    began = time.monotonic()
    for path in link.paths:
        path.pulled = True
    for program, peer in ((link.near_program, "far"), (link.far_program, "near")):
        line = f'peer "{peer}": down: nothing arrives'
        wait_until(2, lambda p=program, line=line: line in p.err(), line)
    took = time.monotonic() - began
    test.say(f"both sides said so after {took:.2f} s")
    check(took < 1.0, f"{took} s")
    time.sleep(0.5)
    doctor = test.run("tether-vehicle", "doctor", "--link").out()
    check(re.search(r"wrong +link +down: far", doctor), doctor)
    for path in link.paths:
        path.pulled = False
    for program in (link.near_program, link.far_program):
        wait_until(5, lambda p=program: p.err().count("up, by wifi and 5g") == 2, "both up again")
    link.end()


def with_deferred_copies_neither(test):
    report = no_message_is_missed_when_either_path_is_pulled(
        test, 'second_path = "deferred"\nsecond_after_ms = 30'
    )
    check(report.duplicates < 600, "most copies were not needed")


def datagrams_of_unknown_senders_are_counted_and_go_nowhere(test):
    link = Link(test)
    for number in range(50):
        link.command(number)
        time.sleep(0.005)
    wait_until(5, lambda: len(link.numbers()) == 50, "50 commands")
    before = link.fresh_report(link.far)
    unknown = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    recorded = list(link.paths[0].recorded)
    for datagram, _ in recorded:  # from another address
        unknown.sendto(datagram, ("127.0.0.1", 7710))
    for datagram, towards in recorded:  # from the true one: replayed, reflected, changed
        link.paths[0].send(datagram, "far")
        # Another counter, which has not been seen.
        link.paths[0].send(datagram[:12] + bytes([datagram[12] ^ 1]) + datagram[13:], towards)
    junk = random.Random(1)
    for _ in range(200):
        link.paths[0].send(junk.randbytes(100), "far")
    refused = wait_until(
        10, lambda: (r := link.refused(link.far))["version"] >= 150 and r, "the junk is counted"
    )
    test.say(f"refused: {refused}")
    check(refused["address"] >= 0.9 * len(recorded) - 10, "those of another address")
    check(refused["replayed"] > 40, "those that came before")
    check(refused["forged"] + refused["no_session"] > 40, "those changed, and the far host's own")
    check(len(link.numbers()) == 50, "nothing of it was delivered")
    after = link.fresh_report(link.far)
    check(after.sessions == before.sessions, "nor makes a session")
    check("\n".join(link.far_program.err().splitlines()).count("\n") < 8, link.far_program.err())
    # Channels that the far host may not send: all of its LCM is offered, one channel is taken.
    link.far.send("CTRL/POSE", b"x" * 20)
    link.far.send("SIM/TRUTH", b"x" * 20)
    wait_until(5, lambda: link.fresh_report(link.near).not_allowed >= 1, "a channel not allowed")
    check(link.fresh_report(link.near).delivered >= 1, "the allowed one")
    unknown.close()
    link.end()


def bad_keys_are_refused_in_one_line(test):
    key = test.work / "own.key"
    test.run("tether-link", "keygen", key)
    key.chmod(0o640)
    config = test.work / "link.toml"
    config.write_text(
        'key = "own.key"\n[[path]]\nname = "p"\nbind = "127.0.0.1:7700"\n'
        f'[[peer]]\nname = "v"\npublic_key = "{"1" * 64}"\n'
    )
    config.chmod(0o644)
    program = test.run("tether-link", "run", config)
    check(program.process.returncode == 2, program.process.returncode)
    check(program.err().count("\n") == 1 and f"chmod 600 {key}" in program.err(), program.err())


main(
    no_message_is_missed_when_either_path_is_pulled,
    both_paths_down_are_said_within_a_second,
    with_deferred_copies_neither,
    datagrams_of_unknown_senders_are_counted_and_go_nowhere,
    bad_keys_are_refused_in_one_line,
)
