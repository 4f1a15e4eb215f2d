"""For the tests of real processes on a real LCM network: starts programs and ends them all again,
listens and sends on LCM without LCM, and waits with bounds.

The wire format is written out here a second time, from lcmtypes/*.lcm and LCM's specification, so
that these tests also check that a foreign program can take part.
"""

import bisect
import contextlib
import ctypes
import os
import pathlib
import re
import shutil
import signal
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
import types

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PAPER = SOURCE / "scenarios" / "paper.toml"
GROUP = "239.255.76.67"
PORT = 7667
SHORT_MAGIC = 0x4C433032
FRAGMENT_MAGIC = 0x4C433033
SO_TIMESTAMPNS = 35  # asm-generic/socket.h; not in Python's socket


class Failure(Exception):
    pass


def check(condition, what):
    if not condition:
        raise Failure(what)


def wait_until(seconds, condition, what):
    """Polls until condition() is true and returns what it returned; fails at the deadline."""
    deadline = time.monotonic() + seconds
    while not (result := condition()):
        if time.monotonic() > deadline:
            raise Failure(f"not within {seconds} s: {what}")
        time.sleep(0.02)
    return result


# --- LCM types


class LcmType:
    """One struct of lcmtypes/, fields of primitive types and one-dimensional arrays of them."""

    FORMATS = {"int8_t": "b", "int16_t": "h", "int32_t": "i", "int64_t": "q", "boolean": "b"}
    FORMATS |= {"float": "f", "double": "d"}

    def __init__(self, name):
        text = (SOURCE / "lcmtypes" / f"tether_{name}.lcm").read_text()
        body = text.partition("{")[2]
        fields = re.findall(r"^\s*(\w+)\s+(\w+)(?:\[(\w+)\])?\s*;", body, re.MULTILINE)
        self.name = name
        self.fields = [(field, kind, size) for kind, field, size in fields]
        self.fingerprint = self._fingerprint()

    def _fingerprint(self):
        value = 0x12345678

        def add(number):
            nonlocal value
            signed = value - (1 << 64) if value >> 63 else value
            value = ((((value << 8) ^ (signed >> 55)) + number) & (1 << 64) - 1)

        def add_text(text):
            for number in (len(text), *text.encode()):
                add(number)

        for field, kind, size in self.fields:
            add_text(field)
            add_text(kind)
            add(1 if size else 0)
            if size:
                add(1)  # an array of variable length
                add_text(size)
        return struct.pack(">Q", ((value << 1) | (value >> 63)) & (1 << 64) - 1)

    def encode(self, **values):
        """Missing fields are zero or empty."""
        unknown = values.keys() - {field for field, _, _ in self.fields}
        assert not unknown, unknown

        def one(kind, value):
            if kind == "string":
                text = value.encode() + b"\0"
                return struct.pack(">i", len(text)) + text
            return struct.pack(">" + self.FORMATS[kind], value)

        data = self.fingerprint
        for field, kind, size in self.fields:
            empty = [] if size else "" if kind == "string" else 0
            value = values.get(field, empty)
            data += b"".join(one(kind, item) for item in (value if size else [value]))
        return data

    def decode(self, data):
        """None for anything that is not exactly one message of this type."""
        if data[:8] != self.fingerprint:
            return None
        position = 8

        def one(kind):
            nonlocal position
            if kind == "string":
                (length,) = struct.unpack_from(">i", data, position)
                text = data[position + 4 : position + 4 + length - 1].decode()
                position += 4 + length
                return text
            form = ">" + self.FORMATS[kind]
            (value,) = struct.unpack_from(form, data, position)
            position += struct.calcsize(form)
            return value

        message = types.SimpleNamespace()
        try:
            for field, kind, size in self.fields:
                value = [one(kind) for _ in range(getattr(message, size))] if size else one(kind)
                setattr(message, field, value)
        except (struct.error, UnicodeDecodeError):
            return None
        return message if position == len(data) else None


CHANNEL_SETTING = LcmType("channel_setting")
CHANNEL_SETTING_RESULT = LcmType("channel_setting_result")
CLOCK = LcmType("clock")
CONTROLLER_REPORT = LcmType("controller_report")
COUNTERS = LcmType("counters")
GROUND_TRUTH = LcmType("ground_truth")
LINK_REPORT = LcmType("link_report")
PLAN = LcmType("plan")
POSE = LcmType("pose")
PRESENCE = LcmType("presence")
TWIST = LcmType("twist")
TYPES = {
    "AGV/POSE": POSE,
    "CTRL/POSE": POSE,
    "AGV/CMD_VEL": TWIST,
    "CTRL/CMD_VEL": TWIST,
    "AGV/PLAN": PLAN,
    "CTRL/PLAN": PLAN,
    "AGV/PRELOAD": PLAN,
    "CTRL/PRELOAD": PLAN,
    "CTRL/REPORT": CONTROLLER_REPORT,
    "CTRL/COUNTERS": COUNTERS,
    "NET/UPLINK": LINK_REPORT,
    "NET/DOWNLINK": LINK_REPORT,
    "NET/COUNTERS": COUNTERS,
    "NET/SET": CHANNEL_SETTING,
    "NET/SETTINGS": CHANNEL_SETTING_RESULT,
    "SIM/CLOCK": CLOCK,
    "SIM/TRUTH": GROUND_TRUTH,
    "SIM/COUNTERS": COUNTERS,
}


# --- LCM network


class Network:
    """Hears everything on one LCM port of this machine, and sends to it, or to another, from that port."""

    def __init__(self, port=PORT, to=None):
        self.url = f"udpm://{GROUP}:{port}?ttl=0"
        self._address = (GROUP, to or port)
        self._seq = 0
        self._heard = {}  # channel -> list of messages
        self._on_message = {}
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2 << 20)
        # Arrival as the kernel saw it: this process may be late.
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
        group = struct.pack("4sL", socket.inet_aton(GROUP), socket.INADDR_ANY)
        self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        self._socket.bind(("", port))
        self._socket.settimeout(0.1)
        self._closed = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self):
        while not self._closed:
            try:
                data, ancillary, _, _ = self._socket.recvmsg(65536, 64)
            except TimeoutError:
                continue
            seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
            end = data.find(b"\0", 8)
            if len(data) < 9 or struct.unpack_from(">I", data)[0] != SHORT_MAGIC or end < 0:
                continue
            channel = data[8:end].decode(errors="replace")
            message = TYPES[channel].decode(data[end + 1 :]) if channel in TYPES else None
            if message is None:
                continue
            message.arrival = seconds + nanoseconds * 1e-9
            self._heard.setdefault(channel, []).append(message)
            if react := self._on_message.get(channel):
                react(data[end + 1 :])

    def close(self):
        self._closed = True
        self._thread.join()
        self._socket.close()

    def on_message(self, channel, react):
        """react(bytes) is called with every later message of the channel, at once; None ends it."""
        self._on_message[channel] = react

    def forget(self):
        """All that was heard: after a step of the clock that tells when it arrived."""
        self._heard = {}

    def channels(self):
        return set(self._heard)

    def messages(self, channel, since=0.0):
        """All decodable messages that arrived after the wall-clock time `since`."""
        heard = list(self._heard.get(channel, []))
        return heard[bisect.bisect_right(heard, since, key=lambda m: m.arrival) :]

    def last(self, channel, since=0.0):
        messages = self._heard.get(channel, [])
        return messages[-1] if messages and messages[-1].arrival > since else None

    def counters(self, channel):
        m = self.last(channel)
        return dict(zip(m.name, m.value)) if m else {}

    def rate(self, channel, seconds):
        """Messages per second during the next `seconds`."""
        start = time.time()
        time.sleep(seconds)
        return len(self.messages(channel, since=start)) / seconds

    def send_raw(self, datagram):
        self._socket.sendto(datagram, self._address)

    def send(self, channel, payload):
        header = struct.pack(">II", SHORT_MAGIC, self._seq)
        self._seq += 1
        self.send_raw(header + channel.encode() + b"\0" + payload)


# --- processes


_libc = ctypes.CDLL(None)


def _die_with_parent():
    _libc.prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


class Program:
    """A running program; its stdout and stderr go to files."""

    def __init__(self, work, command, **options):
        self.name = pathlib.Path(command[0]).name
        self.command = [str(part) for part in command]
        self._out = tempfile.NamedTemporaryFile(dir=work, delete=False)
        self._err = tempfile.NamedTemporaryFile(dir=work, delete=False)
        options = {"stdout": self._out, "stderr": self._err} | options
        self.process = subprocess.Popen(
            self.command, stdin=subprocess.DEVNULL, preexec_fn=_die_with_parent, **options
        )
        self.pid = self.process.pid

    def out(self):
        return pathlib.Path(self._out.name).read_text()

    def err(self):
        return pathlib.Path(self._err.name).read_text()

    def running(self):
        return self.process.poll() is None

    def kill(self, number=signal.SIGKILL):
        self.process.send_signal(number)

    def wait(self, seconds):
        """The exit code, negative for a signal."""
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            raise Failure(f"{self.name} did not end within {seconds} s") from None

    def children(self):
        """Name -> pid of this process's children."""
        found = {}
        for pid in pathlib.Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text().split():
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                name = pathlib.Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")[0].decode()
                found[pathlib.Path(name).name] = int(pid)
        return found


def alive(pid):
    """Whether a process exists that is not a zombie."""
    try:
        stat = pathlib.Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return stat.rpartition(")")[2].split()[0] != "Z"


class Test:
    """Context of a test: the programs, a folder, one or more networks."""

    def __init__(self, bin_dir, work):
        self.bin = bin_dir
        self.work = work
        self.programs = []
        self.network = Network()

    def start(self, *command, **options):
        """A program of the build by name, or any other by path."""
        program = Program(self.work, [self.bin / command[0], *command[1:]], **options)
        self.programs.append(program)
        return program

    def run(self, *command, seconds=10, **options):
        """Runs a program to its end; its exit code is in .process.returncode."""
        program = self.start(*command, **options)
        program.wait(seconds)
        return program

    def say(self, text):
        print(text, flush=True)


def report_failure(test, error):
    print(f"FAILED: {error}", file=sys.stderr)
    for program in test.programs:
        print(f"--- {' '.join(program.command)}", file=sys.stderr)
        print(f"exit code {program.process.returncode}\n{program.out()[-3000:]}", file=sys.stderr)
        print(program.err()[-3000:], file=sys.stderr)


class Witness:
    """A process that only sleeps and looks at the clock: how long did this machine leave a process
    waiting that was due? Tests on the wall clock mean nothing while it does so for long. A guest's
    clock knows no such pauses (uml/guest_clock.cpp)."""

    PERIOD_S = 0.005
    TOO_LONG_S = 0.04  # the deadlines in these tests have about 50 ms of slack
    CODE = f"""
import time
due = time.monotonic()
while True:
    due += {PERIOD_S}
    time.sleep(max(0, due - time.monotonic()))
    now = time.monotonic()
    if now - due > {TOO_LONG_S}:
        print(now - due, flush=True)
    due = max(due, now - {PERIOD_S})
"""

    def __init__(self, work):
        in_guest = os.environ.get("TETHER_CAN_KERNEL") == "uml"
        self._program = Program(work, ["sleep", "inf"] if in_guest else [sys.executable, "-ISc", self.CODE])

    def longest_pause_s(self):
        """Longest of the pauses that were too long; 0 if there was none."""
        return max(map(float, self._program.out().split()), default=0.0)

    def close(self):
        self._program.kill()
        self._program.process.wait()


TRIES = 3


def passes(body, bin_dir, last):
    """Runs a body with a fresh Test and ends all that it started. False if it failed while the
    machine left processes waiting and this was not the last try; another failure ends this test."""
    started = time.monotonic()
    work = pathlib.Path(tempfile.mkdtemp())
    witness = Witness(work)
    test = Test(bin_dir, work)
    try:
        body(test)
    except BaseException as error:
        for program in test.programs:
            program.process.poll()
        report_failure(test, error)
        pause = witness.longest_pause_s()
        print(f"the machine left a process waiting for {1e3 * pause:.0f} ms", file=sys.stderr)
        if isinstance(error, Exception) and pause > 0.0 and not last:
            return False
        if isinstance(error, Failure):
            sys.exit(1)
        raise
    finally:
        for program in test.programs:
            if program.running():
                program.kill()
                program.process.wait()
        witness.close()
        test.network.close()
        shutil.rmtree(work, ignore_errors=True)
    print(f"passed: {body.__name__} ({time.monotonic() - started:.1f} s)", flush=True)
    return True


def main(*bodies):
    """Runs the bodies one after another. One that fails while the machine stood still is run again."""
    bin_dir = pathlib.Path(sys.argv[1]).resolve()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    for body in bodies:
        for run in range(1, TRIES + 1):
            if passes(body, bin_dir, last=run == TRIES):
                break
            print(f"again: {body.__name__} ({run + 1} of {TRIES})", flush=True)


# --- what several tests ask


NODES = ("tether-sim", "tether-netem", "tether-controller")


def wait_for_loop(network, seconds=10.0, since=None):
    """Until commands reach the vehicle: ten, newer than `since`."""
    since = time.time() if since is None else since
    wait_until(
        seconds,
        lambda: len(network.messages("AGV/CMD_VEL", since=since)) >= 10,
        "ten commands at the vehicle",
    )


def median(values):
    values = list(values)
    check(values, "no values to take the median of")
    return statistics.median(values)
