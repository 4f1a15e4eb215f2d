#!/usr/bin/env -S python3 -B
"""tether-netem --rule between two real LCM networks: any channel, any bytes, both ways.
Usage: relay_test.py BIN_DIR"""

import random
import signal
import socket
import struct
import threading
import time

from live_support import (
    FRAGMENT_MAGIC,
    GROUP,
    LINK_REPORT,
    PORT,
    SHORT_MAGIC,
    TYPES,
    check,
    main,
    wait_until,
)

OTHER_PORT = 7668
OFTEN = "--set=run.report_period_s=0.1"
TYPES["NET/SAT"] = LINK_REPORT


class Raw:
    """Hears and sends any bytes on one LCM port, in fragments too. Deaf to the relay's reports and
    to LCM's own test."""

    FRAGMENT = 65487  # bytes of payload, as LCM has it

    def __init__(self, port):
        self.url = f"udpm://{GROUP}:{port}?ttl=0"
        self.heard = []  # (channel, payload)
        self._address = (GROUP, port)
        self._seq = 0
        self._parts = {}  # (sender, seq) -> [channel, bytes still to come, payload]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2 << 20)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        group = struct.pack("4sL", socket.inet_aton(GROUP), socket.INADDR_ANY)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        self._socket.bind(("", port))
        self._socket.settimeout(0.1)
        self._closed = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def close(self):
        self._closed = True
        self._thread.join()
        self._socket.close()

    def send(self, channel, payload):
        name = channel.encode() + b"\0"
        self._seq += 1
        if len(name) + len(payload) < self.FRAGMENT:
            header = struct.pack(">II", SHORT_MAGIC, self._seq)
            self._socket.sendto(header + name + payload, self._address)
            return
        cuts = [0, *range(self.FRAGMENT - len(name), len(payload), self.FRAGMENT), len(payload)]
        for number, (begin, end) in enumerate(zip(cuts, cuts[1:])):
            head = (FRAGMENT_MAGIC, self._seq, len(payload), begin, number, len(cuts) - 1)
            part = struct.pack(">IIIIHH", *head) + (b"" if number else name) + payload[begin:end]
            self._socket.sendto(part, self._address)

    def _listen(self):
        while not self._closed:
            try:
                data, sender = self._socket.recvfrom(65536)
            except TimeoutError:
                continue
            magic, seq = struct.unpack_from(">II", data)
            if magic == SHORT_MAGIC:
                end = data.index(b"\0", 8)
                self._take(data[8:end], data[end + 1 :])
            else:
                self._take_fragment((sender, seq), data)

    def _take_fragment(self, key, data):
        size, offset, number, _ = struct.unpack_from(">IIHH", data, 8)
        begin = 20
        if number == 0:
            begin = data.index(b"\0", 20) + 1
            self._parts[key] = [data[20 : begin - 1], size, bytearray(size)]
        if key not in self._parts:
            return
        part = self._parts[key]
        part[2][offset : offset + len(data) - begin] = data[begin:]
        part[1] -= len(data) - begin
        if part[1] == 0:
            self._take(part[0], bytes(part[2]))
            del self._parts[key]

    def _take(self, channel, payload):
        if not channel.startswith((b"NET/", b"LCM_SELF_TEST")):
            self.heard.append((channel.decode(), payload))

    def count(self, prefix):
        return sum(channel.startswith(prefix) for channel, _ in self.heard)


class Relay:
    """tether-netem with rules between test.network and another one, and raw ears on both."""

    def __init__(self, test, *rules, options=()):
        self.here = Raw(PORT)
        self.there = Raw(OTHER_PORT)
        self.test = test
        arguments = [f"--rule={rule.format(there=self.there.url)}" for rule in rules]
        self.program = test.start("tether-netem", *arguments, OFTEN, *options)
        wait_until(10, lambda: self.counters(), "the relay's counters")

    def counters(self):
        return self.test.network.counters("NET/COUNTERS")

    def wait_for(self, condition, what, seconds=10):
        wait_until(seconds, lambda: condition(self.counters()), what)
        return self.counters()

    def end(self):
        """Ctrl-C; returns the last counters."""
        self.program.kill(signal.SIGINT)
        code = self.program.wait(5)
        check(code == 0, f"exit code {code}")
        lines = self.program.err().splitlines()
        check(all(line.startswith("tether-netem: ") for line in lines), self.program.err())
        time.sleep(0.2)  # for the last counters to be heard here
        self.here.close()
        self.there.close()
        return self.counters()


def any_type_is_renamed_and_passed_on(test):
    odd = "\\x{{51}}\\C -> {there}:ODD via uplink"  # Q and any byte
    relay = Relay(test, "CAM_(.*) → {there}:FAR/$1 via uplink", odd)
    sent = {
        "CAM_LEFT": random.Random(1).randbytes(100),
        "CAM_": b"",
        "CAM_\t {}%s ä": b"\0" * 1000,
        "CAM_" + "n" * 59: b"the longest name that LCM allows",
        "CAM_BIG": random.Random(2).randbytes(300_000),
    }
    for channel, payload in sent.items():
        relay.here.send(channel, payload)
        relay.here.send("X" + channel[1:], payload)
    wait_until(10, lambda: len(relay.there.heard) >= len(sent), "all messages on the other side")
    relay.here.send("Q1", b"odd")
    wait_until(10, lambda: len(relay.there.heard) > len(sent), "the odd one on the other side")
    expected = [("FAR/" + channel[4:], payload) for channel, payload in sent.items()]
    expected.append(("ODD", b"odd"))
    names = [(channel, len(payload)) for channel, payload in relay.there.heard]
    check(sorted(relay.there.heard) == sorted(expected), f"heard under new names: {names}")
    said = relay.program.err()
    rule = '"CAM_(.*)" on 239.255.76.67:7667 → as "FAR/$1" on 239.255.76.67:7668, via uplink'
    check(f"tether-netem: rule: {rule}\n" in said, said)
    end = relay.end()
    check(end["heard"] == end["uplink.delivered"] == len(expected), end)
    test.say(f"{len(sent)} messages of up to 300 kB are byte-identical: {end}")


def equal_names_are_bridged_both_ways(test):
    relay = Relay(
        test,
        "BEAT|FOO.* -> {there} via uplink",
        "{there}:(BEAT|FOO.*) -> $1 via downlink",
        options=["--set=channel.delay_ms=20", "--set=channel.duplicate.probability=0.5"],
    )
    # The same bytes again and again from both sides, and one fragmented message.
    count = 200
    for _ in range(count):
        relay.here.send("BEAT", b"same")
        relay.there.send("BEAT", b"same")
        time.sleep(0.005)
    relay.here.send("FOO_BIG", b"F" * 300_000)
    time.sleep(0.5)
    end = relay.end()
    uplink, downlink = end["uplink.offered"], end["downlink.offered"]
    test.say(f"{uplink} and {downlink} messages offered: {end}")
    check((uplink, downlink) == (count + 1, count), "some fed back, or some were eaten")
    here, there = len(relay.here.heard), len(relay.there.heard)
    check(here == count + 1 + end["downlink.delivered"], f"{here} heard here: {end}")
    check(there == count + end["uplink.delivered"], f"{there} heard there: {end}")


def a_lossy_link_balances(test):
    relay = Relay(
        test,
        "FOO -> {there}:BAR via sat",
        options=["--set=channel.links.sat.prr=0.7", "--set=channel.links.sat.delay_ms=50"],
    )
    count = 2000
    for i in range(count):
        relay.here.send("FOO", i.to_bytes(4, "big"))
        time.sleep(0.0005)
    relay.wait_for(
        lambda c: c["sat.offered"] == c["sat.lost"] + c["sat.delivered"] and c["heard"] >= count,
        "nothing under way any more",
    )
    end = relay.end()
    report = test.network.last("NET/SAT")
    check(end["heard"] == end["sat.offered"] == report.offered == count, end)
    check(report.delivered == len(relay.there.heard) == end["sat.delivered"], end)
    lost = end["sat.lost"]
    test.say(f"{lost} of {count} lost")
    check(abs(lost - 600) <= 4 * 20.5, "binomial, 4 standard deviations")
    numbers = [int.from_bytes(payload, "big") for _, payload in relay.there.heard]
    check(numbers == sorted(set(numbers)), "out of order, or twice")


def overload_is_counted(test):
    # While the relay stands still, the kernel keeps what its buffer holds and drops the rest.
    relay = Relay(test, "FOO -> {there}:BAR via uplink")
    relay.program.kill(signal.SIGSTOP)
    count = 20_000
    for i in range(count):
        relay.here.send("FOO", b"x" * 100)
    relay.program.kill(signal.SIGCONT)
    dropped = "239.255.76.67:7667.datagrams_dropped"
    relay.wait_for(
        lambda c: c["heard"] + c[dropped] >= count,
        "every message counted",
    )
    end = relay.end()
    test.say(f"of {count} messages, {end['heard']} heard, {end[dropped]} counted as dropped")
    # The relay's own reports are among those dropped.
    check(end["heard"] + end[dropped] <= count + 100, end)
    check(end[dropped] > 1000, "the flood was too small")
    check(end["uplink.delivered"] == end["heard"], end)


def no_name_stops_it(test):
    relay = Relay(test, "(a+)+$ -> {there}:HOSTILE via uplink", "OK -> {there} via uplink")
    relay.here.send("a" * 40 + "!", b"2^40 ways to divide the letters")
    relay.here.send("OK", b"passes")
    wait_until(10, lambda: relay.there.count("OK"), "a message after the hostile one")
    relay.here.send("a" * 40, b"matches")
    wait_until(10, lambda: relay.there.count("HOSTILE"), "the one that the rule is about")
    check(relay.end()["heard"] == 2, "two messages are of the rules")


main(
    any_type_is_renamed_and_passed_on,
    equal_names_are_bridged_both_ways,
    a_lossy_link_balances,
    overload_is_counted,
    no_name_stops_it,
)
