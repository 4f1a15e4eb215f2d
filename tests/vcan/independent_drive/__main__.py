"""Two CiA 402 drives on one CAN interface, nodes 1 and 2, written from the standards alone: no code
of the project and none of its files, so that a misreading of the standard that bridge and emulator
share does not stay unseen. Switches give them habits that real drives have.

Usage: python3 independent_drive INTERFACE [--switches] [--right --switches]
The switches after --right are node 2's, instead of those before it.

On stdout, a JSON object a line: what a node does ("event"), and every 50 ms how both wheels
turn, in the drives' own positive direction: revolutions/s ("rps") and revolutions ("turns")."""

import argparse
import json
import pathlib
import select
import socket
import struct
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from device import Device  # noqa: E402
from drive import Drive  # noqa: E402

FRAME = struct.Struct("=IB3x8s")  # linux/can.h
TICK_S = 0.005
REPORT_S = 0.05


def number(text):
    return int(text, 0)


def place(text):
    """0x6085, or 0x1400:5"""
    index, _, sub = text.partition(":")
    return int(index, 0), int(sub, 0) if sub else None


def read_options(arguments):
    """Options of one node."""
    p = argparse.ArgumentParser()
    p.add_argument("--boot-s", type=float, default=0.2, help="from reset to the boot-up message")
    p.add_argument("--sdo-after-s", type=float, default=0.0, help="no SDO answer before, from then")
    p.add_argument("--sdo-write-s", type=float, default=0.0, help="to each answer to a write")
    p.add_argument("--boot-fault", type=number, default=0, help="trips with this code after boot")
    p.add_argument("--status-bits", type=number, default=0, help="always set in the statusword")
    p.add_argument("--toggle", action="store_true", help="bit 7 of the heartbeat toggles")
    p.add_argument("--without", type=place, nargs="*", default=[], help="objects that are missing")
    p.add_argument("--reaction", type=int, default=3, help="to a lost master, without a 0x6007")
    p.add_argument("--no-rtr", action="store_true", help="bit 30 of TPDO identifiers stays set")
    p.add_argument("--late-mode", action="store_true", help="0x6061 is 0 unless enabled")
    p.add_argument("--enabled-mode", type=int, help="0x6061 while enabled")
    p.add_argument("--warnings", type=number, nargs="*", default=[], help="EMCY codes, in turn")
    p.add_argument("--warn-every-s", type=float, default=0.3, help="… while enabled")
    p.add_argument("--serial", type=number, help="0x1018:4 [1000 + node]")
    p.add_argument("--first-count", type=number, default=0x7FFFF000, help="of the encoders")
    add_mechanics(p)
    add_deviations(p)
    return p.parse_args(arguments)


def add_mechanics(p):
    """See wheel.py; m/s² at the rim."""
    p.add_argument("--coast-mps2", type=float, default=0.3, help="deceleration without power")
    p.add_argument("--push-mps2", type=float, default=0.0, help="of a slope or a load, positive: on")
    p.add_argument("--torque-mps2", type=float, default=6.0, help="what the motor can do")
    p.add_argument("--holding-brake", action="store_true", help="closes without power")


def add_deviations(p):
    """Options for a faulty, miswired or wrongly described drive. It is no fault to the drive itself."""
    p.add_argument("--velocity", choices=("true", "zero", "enabled"), default="true",
                   help="0x606C: as it is, always 0, 0 unless enabled")
    p.add_argument("--velocity-scale", type=float, default=1.0, help="of 0x606C; negative: reversed")
    p.add_argument("--position-scale", type=float, default=1.0, help="of 0x6064; negative: reversed")
    p.add_argument("--freeze-after-turns", type=float, help="from then on 0x6064 stays as it is")
    p.add_argument("--wheel-gain", type=float, default=1.0, help="the wheel turns as told times this")
    p.add_argument("--no-braking", action="store_true", help="a quick stop is acknowledged only")
    p.add_argument("--ignore", type=place, nargs="*", default=[], help="objects that act as if 0")
    p.add_argument("--sdo-only-at-rest", action="store_true",
                   help="outside operational: each SDO request is aborted while the wheel turns")
    p.add_argument("--pad", action="store_true", help="each TPDO has 8 bytes")
    p.add_argument("--blink-mode-s", type=float, help="so often 0x6061 is 0 for 30 ms")
    p.add_argument("--second-boot-s", type=float, help="after the first boot-up message, without reset")


def tell(**facts):
    print(json.dumps({"t": time.time(), **facts}), flush=True)


def main():
    interface, *switches = sys.argv[1:]
    at = switches.index("--right") if "--right" in switches else len(switches)
    left, right = switches[:at], switches[at + 1 :]
    bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    bus.bind((interface,))

    def send(identifier, data):
        bus.send(FRAME.pack(identifier, len(data), bytes(data).ljust(8, b"\0")))

    now = time.monotonic()
    devices, drives = [], []
    for node, own in ((1, left), (2, right if at < len(switches) else left)):
        options = read_options(own)
        devices.append(Device(node, options, send, tell, now))
        drives.append(Drive(devices[-1], options))
        devices[-1].use(drives[-1])
    moved = due = report = now
    while True:
        ready = select.select([bus], [], [], max(0.0, due - time.monotonic()))[0]
        now = time.monotonic()
        if ready:
            identifier, size, data = FRAME.unpack(bus.recv(FRAME.size))
            if identifier >> 29 == 0:
                for device in devices:
                    device.on_frame(identifier & 0x7FF, data[:size], now)
        if now < due:
            continue
        due = max(due + TICK_S, now)
        for device, drive in zip(devices, drives):
            drive.run(now - moved)
            device.tick(now)
        moved = now
        if now >= report:
            report = now + REPORT_S
            tell(
                rps=[drive.wheel_rps for drive in drives],
                turns=[drive.wheel_turns for drive in drives],
            )


main()
