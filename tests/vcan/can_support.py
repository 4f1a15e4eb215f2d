"""For the tests of processes on a real CAN bus, under uml/with_can.sh: on top of live_support.py,
ears and hands on the bus (python-can), records of it (candump) and what an independent decoder
says of them (Wireshark's tshark), network interfaces, and a serial-line CAN adapter.

Nothing here uses the project's own codecs.
"""

import bisect
import errno
import fcntl
import math
import os
import pathlib
import pty
import select
import struct
import subprocess
import sys
import termios
import threading
import time
import tty
import types

import can

sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "live"))
import live_support  # noqa: E402
from live_support import LcmType, check, wait_until  # noqa: E402

DRIVE_FAULT = LcmType("drive_fault")
DRIVE_REQUEST = LcmType("drive_request")
live_support.TYPES |= {
    "CAN/COUNTERS": live_support.COUNTERS,
    "CAN/DRIVE_COUNTERS": live_support.COUNTERS,
    "CAN/INJECT": DRIVE_FAULT,
    "CAN/ODOMETRY": LcmType("odometry"),
    "CAN/REQUEST": DRIVE_REQUEST,
    "CAN/STATE": LcmType("drivetrain_state"),
    "CAN/WHEELS": LcmType("wheel_feedback"),
    "SIM/WHEELS": LcmType("wheel_states"),
    "SIM/WHEEL_TARGETS": LcmType("wheel_targets"),
}

N_SLCAN = 17  # linux/tty.h
SIOCGIFNAME = 0x8910  # linux/sockios.h


def ip(command):
    """ip link {command}; it has to succeed."""
    done = subprocess.run(["ip", "link", *command.split()], capture_output=True, text=True)
    check(done.returncode == 0, f"ip link {command}: {done.stderr}")


def create_vcan(interface):
    ip(f"add dev {interface} type vcan")
    ip(f"set {interface} up")


class CanBus:
    """Hears all that others send on an interface from now on, and sends anything. Frames are python-can's
    Messages: arbitration_id, data, timestamp (wall clock, by the kernel), is_extended_id,
    is_remote_frame, is_error_frame."""

    def __init__(self, interface="vcan0"):
        self._bus = can.Bus(interface, bustype="socketcan", fd=True)
        self._frames = []
        self._on_frame = []
        self._closed = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self):
        while not self._closed:
            try:
                frame = self._bus.recv(0.1)
            except can.CanOperationError as error:
                if error.error_code == errno.ENODEV:
                    return  # the interface was deleted; a new one of its name needs a new CanBus
                continue  # it was taken down, and may come up again
            if frame:
                self._frames.append(frame)
                for react in self._on_frame:
                    react(frame)

    def close(self):
        self._closed = True
        self._thread.join()
        self._bus.shutdown()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def on_frame(self, react):
        """react(frame) is called with every later frame, at once: for a drive written in a test."""
        self._on_frame.append(react)

    def send(self, identifier, data=b"", extended=False, remote=False, error=False, fd=False):
        self._bus.send(
            can.Message(
                arbitration_id=identifier,
                data=None if remote else bytes(data),
                is_extended_id=extended,
                is_remote_frame=remote,
                is_error_frame=error,
                is_fd=fd,
            )
        )

    def frames(self, identifier=None, since=0.0):
        """11-bit data frames after the wall-clock time `since`; of one identifier, or all."""
        frames = list(self._frames)
        return [
            f
            for f in frames[bisect.bisect_right(frames, since, key=lambda f: f.timestamp) :]
            if not (f.is_extended_id or f.is_remote_frame or f.is_error_frame)
            and identifier in (None, f.arbitration_id)
        ]

    def error_frames(self):
        return [f for f in list(self._frames) if f.is_error_frame]

    def last(self, identifier, since=0.0):
        frames = self.frames(identifier, since)
        return frames[-1] if frames else None

    def wait(self, identifier, seconds=5.0, since=None, where=lambda data: True):
        """The first frame after `since` (now) whose data fulfils the condition."""
        since = time.time() if since is None else since

        def found():
            return next((f for f in self.frames(identifier, since) if where(f.data)), None)

        return wait_until(seconds, found, f"frame {identifier:03X}")

    def rate(self, identifier, seconds):
        """Frames per second during the next `seconds`."""
        start = time.time()
        time.sleep(seconds)
        return len(self.frames(identifier, start)) / seconds


def gaps(frames):
    """Seconds between successive frames."""
    return [b.timestamp - a.timestamp for a, b in zip(frames, frames[1:])]


def integer(data, offset=0, size=4, signed=True):
    """CANopen's little-endian integers."""
    return int.from_bytes(bytes(data[offset : offset + size]), "little", signed=signed)


# --- records


class Candump:
    """Records an interface to a file in candump's log format, error frames too."""

    def __init__(self, test, name, interface="vcan0"):
        folder = pathlib.Path(os.environ.get("TETHER_CAN_RESULTS", test.work))
        self.path = folder / f"{name}.log"
        self._file = open(self.path, "wb")
        everything = f"{interface},0:0,#FFFFFFFF"
        self._program = test.start(
            "/usr/bin/candump", "-L", "-r", str(1 << 20), everything, stdout=self._file
        )
        # Until it listens: frames that have no meaning to others.
        with CanBus(interface) as bus:

            def listening():
                bus.send(0x1FFFFFFF, extended=True)
                return self.path.stat().st_size > 0

            wait_until(5, listening, "candump records")

    def stop(self):
        """Ends the record; its file."""
        time.sleep(0.1)
        self._program.kill(15)
        self._program.wait(5)
        self._file.close()
        return self.path


def tshark(log, *fields, where="frame"):
    """The fields of each frame of a candump log that fulfils the display filter, as text; "" where
    a frame has no such field. Takes seconds: ask once for all that a test wants to know. The field
    "_ws.malformed" is not empty where Wireshark could not decode a frame."""
    command = ["tshark", "-d", "can.subdissector,canopen", "-r", log, "-Y", where]
    command += ["-T", "fields", "-E", "separator=/t"]
    for field in fields:
        command += ["-e", field]
    done = subprocess.run(command, capture_output=True, text=True)
    check(done.returncode == 0, f"tshark: {done.stderr}")
    return [tuple(line.split("\t")) for line in done.stdout.splitlines()]


# --- a CAN controller


class SerialAdapter:
    """A serial-line CAN adapter: the kernel's slcan driver at one end of a pseudo terminal, this
    class at the other. The kernel treats it as a CAN controller with error states and a queue, 500
    kbit/s."""

    def __init__(self, name="can0"):
        self.name = name
        self.frames = []  # frames that reached the bus: (wall-clock time, "t2012AABB")
        self.on_frame = lambda text: None
        self._stalled = False
        self._closed = False
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        fcntl.ioctl(self._slave, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        request = fcntl.ioctl(self._slave, SIOCGIFNAME, bytes(40))
        made = request.split(b"\0")[0].decode()
        if not pathlib.Path("/sys/class/net", made).exists():
            # The driver makes it in the machine's first network: fetch it from there.
            move = ["nsenter", "--net=/proc/1/ns/net", "ip", "link", "set", made]
            subprocess.run([*move, "netns", str(os.getpid())], check=True)
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()
        if made != name:
            ip(f"set {made} name {name}")
        ip(f"set {name} type can bitrate 500000")
        ip(f"set {name} up")

    def _read(self):
        text = b""
        while not self._closed:
            if self._stalled or not select.select([self._master], [], [], 0.01)[0]:
                time.sleep(0.005 if self._stalled else 0)
                continue
            *lines, text = (text + os.read(self._master, 4096)).split(b"\r")
            for line in lines:
                if line[:1] in (b"t", b"T", b"r", b"R"):
                    self.frames.append((time.time(), line.decode()))
                    self.on_frame(line.decode())

    def close(self):
        """Unplugs it."""
        self._closed = True
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)

    def report(self, state, errors):
        """Reports the state of the controller: "a"ctive, error-"p"assive or "b"us-off."""
        self._say(f"s{state}{errors:03}{errors:03}")

    def bus_off(self):
        self.report("b", 256)

    def error_passive(self):
        self.report("p", 128)

    def error_active(self):
        self.report("a", 0)

    def receive(self, identifier, data):
        """A frame from the bus."""
        self._say(f"t{identifier:03X}{len(data)}{bytes(data).hex().upper()}")

    def stall(self, stalled=True):
        """From now on it takes nothing any more, or takes everything again."""
        self._stalled = stalled

    def setpoints(self, identifiers, since, until=math.inf):
        """Frames with these identifiers that reached the bus, as CanBus would have them."""
        for arrival, text in list(self.frames):
            if since < arrival < until and text[0] == "t" and int(text[1:4], 16) in identifiers:
                data = bytes.fromhex(text[5:])
                yield types.SimpleNamespace(arbitration_id=int(text[1:4], 16), data=data, timestamp=arrival)

    def _say(self, text):
        os.write(self._master, text.encode() + b"\r")


def bridged(adapter, bus):
    """Makes a serial adapter's bus and a virtual one (a CanBus) one bus, for drives on the latter.
    Frames that the adapter holds back while it stalls do not arrive."""

    def to_adapter(f):
        if not (f.is_extended_id or f.is_remote_frame or f.is_error_frame):
            adapter.receive(f.arbitration_id, f.data)

    def to_bus(text):
        if text[0] == "t":
            bus.send(int(text[1:4], 16), bytes.fromhex(text[5:]))

    bus.on_frame(to_adapter)
    adapter.on_frame = to_bus
