#!/usr/bin/env -S python3 -B
"""Hostile and broken traffic on the LCM port during a live run, of a sender that says on RUN/PRESENCE
that it is the node whose channel it uses, because nodes refuse others: no node dies, the vehicle's
state stays finite, what was wrong is counted by name, and the loop goes on.

Two fragments whose offset overflows end any program that receives by LCM's library, and no node.
Usage: hostile_test.py BIN_DIR"""

import json
import math
import random
import shutil
import signal
import struct
import time

from live_support import (
    COUNTERS,
    FRAGMENT_MAGIC,
    PAPER,
    POSE,
    PRESENCE,
    SHORT_MAGIC,
    TWIST,
    TYPES,
    check,
    main,
    wait_for_loop,
    wait_until,
)

NOT_FINITE = (math.nan, math.inf, -math.inf)
HUGE = (1e300, -1e300, 1.7976931348623157e308, 5e-324)
AHEAD_US = 200_000  # newer than any real message, and still believed
INT64_MIN, INT64_MAX = -(1 << 63), (1 << 63) - 1


class Attack:
    def __init__(self, network, seed):
        self.network = network
        self.random = random.Random(seed)
        self.sent = {}
        self._newest_us = 0
        self._claimed = None

    def count(self, what, number=1):
        self.sent[what] = self.sent.get(what, 0) + number

    def raw(self, what, datagram):
        self.network.send_raw(datagram)
        self.count(what)
        time.sleep(0.002)  # a flood would be lost in buffers: the controller's holds one pose

    def claim(self, channel):
        """The place of the node that owns this channel."""
        netem = channel.startswith("NET/") or channel in ("CTRL/POSE", "AGV/CMD_VEL", "AGV/PLAN", "AGV/PRELOAD")
        owner = "netem" if netem else "controller" if channel.startswith("CTRL/") else "sim"
        if owner == self._claimed:
            return
        self._claimed = owner
        presence = PRESENCE.encode(run=self.run(), program=f"tether-{owner}", vehicle="AGV", host="elsewhere", pid=1)
        self.network.send("RUN/PRESENCE", presence)

    def message(self, what, channel, payload):
        self.claim(channel)
        header = struct.pack(">II", SHORT_MAGIC, self.random.getrandbits(32))
        self.raw(what, header + channel.encode() + b"\0" + payload)

    def now_us(self):
        """The run's time, newer at each call."""
        self._newest_us = max(self._newest_us + 1, self.network.last("SIM/TRUTH").utime)
        return self._newest_us

    def run(self):
        """Which one this is: what follows must look like its own."""
        return self.network.last("AGV/POSE").run

    def garbage(self):
        for _ in range(200):
            self.raw("garbage", self.random.randbytes(self.random.randrange(1400)))
        for _ in range(200):
            magic = struct.pack(">I", SHORT_MAGIC)
            self.raw("magic+random", magic + self.random.randbytes(self.random.randrange(1400)))
        # The first of three fragments of messages that never become whole.
        for i in range(100):
            header = struct.pack(">IIIIHH", FRAGMENT_MAGIC, 10**6 + i, 3000, 0, 0, 3)
            self.raw("lone fragment", header + b"CTRL/POSE\0" + bytes(1000))

    def truncated(self):
        header = struct.pack(">II", SHORT_MAGIC, 7)
        self.claim("CTRL/POSE")
        for channel, lcm_type in (("CTRL/POSE", POSE), ("AGV/CMD_VEL", TWIST)):
            whole = header + channel.encode() + b"\0" + lcm_type.encode(utime=self.now_us())
            for length in range(len(whole)):
                self.raw("truncated", whole[:length])
            self.raw("too long", whole + b"\0")
        for channel in TYPES:
            self.raw("no end of channel", header + channel.encode())
            self.raw("no payload", header + channel.encode() + b"\0")

    def wrong_types(self):
        simple = [t for t in set(TYPES.values()) if all(k != "string" for _, k, _ in t.fields)]
        counters = COUNTERS.fingerprint + struct.pack(">qqi", 0, 0, 4) + b"net\0"
        for channel, right in TYPES.items():
            for lcm_type in simple:
                if lcm_type is not right:
                    self.message("wrong type", channel, lcm_type.encode())
            for count in (-1, 1 << 30, INT64_MAX >> 32):
                sizes = struct.pack(">i", count)
                self.message("wrong length", channel, right.fingerprint + bytes(16) + sizes)
                self.message("wrong length", channel, counters + sizes)
            self.message("random payload", channel, self.random.randbytes(300))
            self.message("random payload", channel, right.fingerprint + self.random.randbytes(300))

    def texts(self):
        """Well-formed counters of an invented node with a name that is no UTF-8."""
        name = b"\xff\xfe\x1b[2J"
        payload = COUNTERS.fingerprint + struct.pack(">qqi", self.now_us(), 10**6, 4) + b"net\0"
        payload += struct.pack(">i", 1) + struct.pack(">i", len(name) + 1) + name + b"\0"
        self.message("invented counters", "NET/COUNTERS", payload + struct.pack(">q", 7))

    def numbers(self):
        """Well-formed messages, newer than the real ones, of values that are not numbers or that overflow
        in the arithmetic behind."""
        for bad in NOT_FINITE:
            for field in ("x_m", "y_m", "yaw_rad"):
                pose = POSE.encode(run=self.run(), utime=self.now_us(), seq=10**3, **{field: bad})
                self.message("non-finite pose", "CTRL/POSE", pose)
            for field in ("v_mps", "omega_radps"):
                command = TWIST.encode(run=self.run(), utime=self.now_us(), seq=10**3, **{field: bad})
                self.message("non-finite command", "AGV/CMD_VEL", command)
        for huge in HUGE:
            for other in HUGE:
                stamp = self.now_us() + AHEAD_US
                command = TWIST.encode(run=self.run(), utime=stamp, seq=10**3, v_mps=huge, omega_radps=other)
                self.message("huge command", "AGV/CMD_VEL", command)
                pose = POSE.encode(run=self.run(), utime=stamp, seq=10**3, x_m=huge, y_m=other, yaw_rad=huge)
                self.message("huge pose", "CTRL/POSE", pose)
                time.sleep(0.005)

    def stamps(self):
        for utime in (self.now_us() + 60_000_000, INT64_MAX, self.now_us() * 1000):
            self.message("from the future", "CTRL/POSE", POSE.encode(run=self.run(), utime=utime, seq=10**6))
            self.message("from the future", "AGV/CMD_VEL", TWIST.encode(run=self.run(), utime=utime, seq=10**6))
        for utime in (0, 1, 2, -1, INT64_MIN):
            for seq in (0, 10**6, INT64_MAX):
                self.message("from the past", "CTRL/POSE", POSE.encode(run=self.run(), utime=utime, seq=seq))
                self.message("from the past", "AGV/CMD_VEL", TWIST.encode(run=self.run(), utime=utime, seq=seq))
        for seq in (-1, INT64_MIN):
            stamp = self.now_us() + AHEAD_US
            self.message("negative seq", "CTRL/POSE", POSE.encode(run=self.run(), utime=stamp, seq=seq))
            self.message("negative seq", "AGV/CMD_VEL", TWIST.encode(run=self.run(), utime=stamp, seq=seq))
        # A jump to the largest number, at a time that counts; the real publisher goes on below it.
        stamp = self.now_us() + AHEAD_US
        self.message("largest seq", "CTRL/POSE", POSE.encode(run=self.run(), utime=stamp, seq=INT64_MAX))
        self.message("largest seq", "AGV/CMD_VEL", TWIST.encode(run=self.run(), utime=stamp, seq=INT64_MAX))

    def echoes(self, seconds):
        """Each real message again at once, and the first one again (reordered)."""
        seen = {"CTRL/POSE": [], "AGV/CMD_VEL": []}

        def echo(channel):
            def react(payload):
                if payload in seen[channel]:
                    return  # this program's own
                seen[channel].append(payload)
                self.network.send(channel, payload)
                self.network.send(channel, seen[channel][0])
                self.count("duplicated and reordered", 2)

            return react

        self.claim("CTRL/POSE")
        for channel in ("CTRL/POSE", "AGV/CMD_VEL"):
            self.network.on_message(channel, echo(channel))
        time.sleep(seconds)
        for channel in ("CTRL/POSE", "AGV/CMD_VEL"):
            self.network.on_message(channel, None)


def nodes_live_on(test):
    network = test.network
    live = test.start("tether", "live", PAPER, "--set=sensor.rate_hz=20", "--duration=60", "--json")
    wait_for_loop(network)
    nodes = live.children()
    attack = Attack(network, seed=1)
    for assault in (
        attack.garbage,
        attack.truncated,
        attack.wrong_types,
        attack.texts,
        attack.numbers,
        attack.stamps,
        lambda: attack.echoes(2.0),
    ):
        assault()
        time.sleep(0.2)
        check(live.running(), f"tether live ended after {attack.sent}")
        check(live.children() == nodes, f"a node died after {attack.sent}: {live.err()}")
    test.say("sent: " + ", ".join(f"{n} {what}" for what, n in attack.sent.items()))

    since = time.time()
    rate = network.rate("AGV/CMD_VEL", 2.0)
    check(17 <= rate <= 23, f"{rate} commands/s afterwards")
    for m in network.messages("CTRL/CMD_VEL", since=since):
        check(math.isfinite(m.v_mps) and math.isfinite(m.omega_radps), f"command afterwards: {m}")
    wait_until(5, lambda: network.last("CTRL/COUNTERS", since=since + 1), "counters")
    truths = network.messages("SIM/TRUTH")
    for m in truths:
        numbers = [v for v in vars(m).values() if isinstance(v, float)]
        check(all(map(math.isfinite, numbers)), f"SIM/TRUTH at {m.utime}: {m}")
        check(abs(m.x_m) < 23 and abs(m.y_m) < 23, f"through the wall at {m.utime}: {m}")
    fastest = max(abs(m.v_mps) for m in truths)
    test.say(
        f"afterwards {rate:.1f} commands/s; truth finite in {len(truths)} messages, "
        f"fastest {fastest:.1f} m/s, epsilon {truths[-1].epsilon_m:.2f} m"
    )
    live.kill(signal.SIGINT)
    check(live.wait(3) == 1, "exit code")
    summary = json.loads(live.out())
    check(summary["valid"] is False, "the run is valid")
    check(math.isfinite(summary["epsilon_m"]), "epsilon")
    check(live.err().count("starting it again") == 0, live.err())

    counters = summary["counters"]
    # At least these, for some messages meet the guard after others that make them something else.
    for stream in ("controller.pose", "sim.command"):
        least = {
            "undecodable": 40,
            "non_finite": 6,
            "from_future": 3,
            "reordered": 5,
            "time_backwards": 2,
            "before_start": 3,
            "duplicated": 5,
            "invalid_seq": 2,
            "jumped": 1,
            "restarts": 1,
        }
        said = {name: counters[f"{stream}.{name}"] for name in least}
        test.say(f"{stream}: " + ", ".join(f"{name} {n}" for name, n in said.items()))
        for name, number in least.items():
            check(said[name] >= number, f"{stream}.{name} is {said[name]}, below {number}")


def fragment(number, offset, payload):
    """One of two of a message of 100 kB on channel X."""
    header = struct.pack(">IIIIHH", FRAGMENT_MAGIC, 77, 100_000, offset, number, 2)
    return header + (b"X\0" if number == 0 else b"") + payload


def fragments_that_end_lcms_receivers_end_no_node(test):
    logger = shutil.which("lcm-logger")
    check(logger, "no lcm-logger: install liblcm-bin")
    live = test.start("tether", "live", PAPER, "--set=sensor.rate_hz=20", "--duration=60")
    wait_for_loop(test.network)
    victim = test.start(logger, "--quiet", f"--lcm-url={test.network.url}", test.work / "x.lcmlog")
    time.sleep(0.5)
    check(victim.running(), "lcm-logger runs")
    nodes = live.children()
    test.network.send_raw(fragment(0, 0, bytes(1000)))
    test.network.send_raw(fragment(1, 0xFFFFFFF0, bytes(1000)))
    check(victim.wait(5) == -signal.SIGSEGV, f"lcm-logger: {victim.process.returncode}")
    wait_for_loop(test.network, since=time.time())
    check(live.children() == nodes, f"a node died: {live.err()}")
    live.kill(signal.SIGINT)
    check(live.wait(3) == 0, f"exit code: {live.err()}")
    test.say("two fragments ended lcm-logger by SIGSEGV, and no node")


main(nodes_live_on, fragments_that_end_lcms_receivers_end_no_node)
