#!/usr/bin/env python3
"""A foreign controller for Tether, in Python's standard library alone: a proportional law that
follows scenarios/paper.toml's figure eight.

In real time:      tether live scenarios/paper.toml --set controller.external=true
                   examples/controller.py
In simulated time: tether run scenarios/paper.toml --set controller.external=true --processes \\
                       --lcm-url 'udpm://239.255.76.67:7668?ttl=0'
                   examples/controller.py --lockstep --lcm-url 'udpm://239.255.76.67:7668?ttl=0'

In simulated time the vehicle waits for the controller, however slow it is (--think), and the run is
the same each time. docs/time.md describes the messages on TIME/...
"""

import argparse
import collections
import math
import re
import socket
import struct
import sys
import time
import types
import zlib

# --- the law


def law(pose):
    """Forward speed and yaw rate towards where the path is in two seconds."""
    angle = 0.1 * (1e-6 * pose.utime + 2.0)
    u = 20.0 * math.sin(angle)
    w = u * math.cos(angle)
    dx = (u + w) * math.sqrt(0.5) - pose.x_m
    dy = (w - u) * math.sqrt(0.5) - pose.y_m
    heading_error = math.remainder(math.atan2(dy, dx) - pose.yaw_rad, 2 * math.pi)
    return 0.495 * math.sqrt(dx * dx + dy * dy), 0.6 * heading_error


# --- LCM: its types and its datagrams


class LcmType:
    """An LCM struct, from its fields as they stand in lcmtypes/."""

    FORMATS = {"int32_t": ">i", "int64_t": ">q", "double": ">d"}

    def __init__(self, text):
        self.fields = re.findall(r"(\w+) (\w+)(?:\[(\w+)\])?;", text)
        value = 0x12345678
        for kind, name, size in self.fields:
            numbers = [len(name), *name.encode(), len(kind), *kind.encode(), len(size and "1")]
            numbers += [1, len(size), *size.encode()] if size else []
            for number in numbers:
                signed = value - (1 << 64) if value >> 63 else value
                value = ((value << 8) ^ (signed >> 55)) + number & (1 << 64) - 1
        self.fingerprint = struct.pack(">Q", (value << 1 | value >> 63) & (1 << 64) - 1)

    def encode(self, **values):
        data = self.fingerprint
        for kind, name, size in self.fields:
            for value in values[name] if size else [values[name]]:
                if kind == "string":
                    text = value.encode() + b"\0"
                    data += struct.pack(">i", len(text)) + text
                else:
                    data += struct.pack(self.FORMATS[kind], value)
        return data

    def decode(self, data):
        """None for another type."""
        if data[:8] != self.fingerprint:
            return None
        at = 8

        def one(kind):
            nonlocal at
            size = struct.calcsize(self.FORMATS.get(kind, ">i"))
            (value,) = struct.unpack_from(self.FORMATS.get(kind, ">i"), data, at)
            at += size
            if kind != "string":
                return value
            at += value
            return data[at - value : at - 1].decode()

        message = types.SimpleNamespace()
        for kind, name, size in self.fields:
            value = [one(kind) for _ in range(getattr(message, size))] if size else one(kind)
            setattr(message, name, value)
        return message


POSE = LcmType(
    "int64_t utime; int64_t seq; int64_t run; double x_m; double y_m; double yaw_rad; int64_t plan_session;"
    "int64_t plan_id;"
)
TWIST = LcmType(
    "int64_t utime; int64_t seq; int64_t run; int64_t pose_utime; double v_mps; double omega_radps;"
)
JOIN = LcmType(
    "int64_t utime; int64_t seq; int64_t session; int64_t instance; string node; int64_t next_ns;"
    "int64_t next_order; int32_t count; string subscription[count];"
)
GRANT = LcmType(
    "int64_t utime; int64_t seq; int64_t session; int64_t id; string node; int32_t kind;"
    "int64_t until_ns; int64_t until_order; int32_t until_rank; int32_t count;"
    "string publisher[count]; string channel[count]; int64_t number[count]; int64_t time_ns[count];"
    "int64_t order[count]; int64_t size[count]; int64_t crc32[count];"
)
REQUEST = LcmType(
    "int64_t utime; int64_t seq; int64_t session; int64_t instance; int64_t grant; string node;"
    "int64_t next_ns; int64_t next_order; string error; int32_t count; string channel[count];"
    "int64_t number[count]; int64_t time_ns[count]; int64_t index[count]; int64_t size[count];"
    "int64_t crc32[count];"
)
RESEND = LcmType(
    "int64_t utime; int64_t seq; int64_t session; string publisher; string channel; int64_t number;"
)


class Lcm:
    """Sends and receives LCM messages of up to 64 KiB on udpm://GROUP:PORT?ttl=N."""

    MAGIC = 0x4C433032

    def __init__(self, url):
        group, port, ttl = re.fullmatch(r"udpm://([\d.]+):(\d+)(?:\?ttl=(\d+))?.*", url).groups()
        self.address = (group, int(port))
        self.sent = 0
        self.out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(ttl or 0))
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)
        member = socket.inet_aton(group) + socket.inet_aton("0.0.0.0")
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        self.socket.bind(("", int(port)))

    def publish(self, channel, data):
        header = struct.pack(">II", self.MAGIC, self.sent & 0xFFFFFFFF)
        self.sent += 1
        self.out.sendto(header + channel.encode() + b"\0" + data, self.address)

    def receive(self, seconds):
        """The next message as (channel, bytes); None if none comes in this time."""
        self.socket.settimeout(seconds)
        try:
            datagram = self.socket.recv(1 << 16)
        except TimeoutError:
            return None
        magic = struct.pack(">I", self.MAGIC)
        channel, zero, data = datagram[8:].partition(b"\0")
        return (channel.decode(errors="replace"), data) if datagram[:4] == magic and zero else None


# --- the controller


class Controller:
    def __init__(self, think_s):
        self.think_s = think_s
        self.commands = 0
        self.newest = -math.inf  # pose

    def command(self, data):
        """The answer to the bytes of a pose; None for what is no newer pose."""
        pose = POSE.decode(data)
        if pose is None or pose.seq <= self.newest or pose.utime < 0:
            return None
        self.newest = pose.seq
        time.sleep(self.think_s)
        v_mps, omega_radps = law(pose)
        self.commands += 1
        return TWIST.encode(
            utime=pose.utime,
            seq=self.commands - 1,
            run=pose.run,
            pose_utime=pose.utime,
            v_mps=v_mps,
            omega_radps=omega_radps,
        )


def in_real_time(lcm, controller):
    while True:
        channel, data = lcm.receive(None) or ("", b"")
        command = controller.command(data) if channel == "CTRL/POSE" else None
        if command:
            lcm.publish("CTRL/CMD_VEL", command)


class Lockstep:
    """The node "controller" of a run in lockstep: acts when it is granted time, and says what it
    has published. It has no events of its own: poses are all that it waits for."""

    NEVER = (1 << 63) - 1

    def __init__(self, lcm, controller):
        self.lcm = lcm
        self.controller = controller
        self.me = {"session": 0, "node": "controller", "instance": time.time_ns()}
        self.seq = 0
        self.inbox = []  # bytes of poses that no grant has named yet
        self.sent = collections.OrderedDict()  # number -> bytes, to send again
        self.last = (0, b"")  # grant, and its answer
        self.heard = self.joined = 0.0  # when

    def say(self, on, lcm_type, /, **values):
        data = lcm_type.encode(utime=0, seq=self.seq, **values)
        self.seq += 1
        self.lcm.publish(on, data)
        return data

    def join(self):
        self.joined = time.monotonic()
        first = {"next_ns": self.NEVER, "next_order": self.NEVER}
        self.say("TIME/JOIN", JOIN, **self.me, **first, count=1, subscription=["CTRL/POSE"])

    def hear(self, seconds):
        """Waits for a message; returns a grant to this node that is not answered yet, or None."""
        channel, data = self.lcm.receive(seconds) or ("", b"")
        now = time.monotonic()
        if channel in ("TIME/GRANT", "TIME/WELCOME"):
            self.heard = now
        elif self.heard and now - self.heard > 30.0:
            sys.exit("the coordinator has been silent for 30 s")
        if channel == "CTRL/POSE":
            self.inbox = self.inbox[-1000:] + [data]
        elif channel == "TIME/GRANT":
            grant = GRANT.decode(data)
            session = self.me["session"]
            if not grant or grant.node != "controller" or session not in (0, grant.session):
                return None
            if grant.id > self.last[0]:
                return grant
            if grant.id == self.last[0]:  # the answer was lost
                self.lcm.publish("TIME/REQUEST", self.last[1])
        elif channel == "TIME/RESEND":
            again = RESEND.decode(data)
            ours = again and (again.session, again.publisher) == (self.me["session"], "controller")
            if ours and again.channel == "CTRL/CMD_VEL" and again.number in self.sent:
                self.lcm.publish("CTRL/CMD_VEL", self.sent[again.number])
        return None

    def take(self, grant, i):
        """The bytes of the i-th message of a grant, which may have to be asked for again."""
        asked = time.monotonic()
        while True:
            for data in self.inbox:
                if (len(data), zlib.crc32(data)) == (grant.size[i], grant.crc32[i]):
                    self.inbox.remove(data)
                    return data
            self.hear(0.05)
            if time.monotonic() - asked > 0.05:
                asked = time.monotonic()
                what = {"channel": grant.channel[i], "number": grant.number[i]}
                publisher = grant.publisher[i]
                self.say("TIME/RESEND", RESEND, session=grant.session, publisher=publisher, **what)

    def carry_out(self, grant):
        published = []
        for i in range(grant.count):
            command = self.controller.command(self.take(grant, i))
            if command:
                number = self.controller.commands
                self.sent[number] = command
                if len(self.sent) > 1000:
                    self.sent.popitem(last=False)
                self.lcm.publish("CTRL/CMD_VEL", command)
                published.append((number, grant.time_ns[i], i, len(command), zlib.crc32(command)))
        columns = list(zip(*published)) or [()] * 5
        answer = dict(zip(("number", "time_ns", "index", "size", "crc32"), columns))
        answer |= {"channel": ["CTRL/CMD_VEL"] * len(published), "count": len(published)}
        answer |= {"grant": grant.id, "error": ""}
        answer |= {"next_ns": self.NEVER, "next_order": self.NEVER}
        self.last = (grant.id, self.say("TIME/REQUEST", REQUEST, **self.me, **answer))

    def run(self):
        while True:
            if self.last[0] == 0 and time.monotonic() - self.joined > 0.1:
                self.join()
            grant = self.hear(0.1)
            if not grant:
                continue
            if grant.kind == 3:  # LEAVE
                return
            self.me["session"] = grant.session
            self.carry_out(grant)


def main():
    parser = argparse.ArgumentParser(description="A proportional law for scenarios/paper.toml")
    parser.add_argument("--lcm-url", default="udpm://239.255.76.67:7667?ttl=0")
    parser.add_argument("--lockstep", action="store_true", help="in simulated time")
    parser.add_argument("--think", type=float, default=0.0, help="take so long a step, seconds")
    options = parser.parse_args()
    lcm = Lcm(options.lcm_url)
    controller = Controller(options.think)
    if options.lockstep:
        Lockstep(lcm, controller).run()
    else:
        in_real_time(lcm, controller)


if __name__ == "__main__":
    main()
