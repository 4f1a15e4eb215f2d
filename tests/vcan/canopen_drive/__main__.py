"""Two CiA 402 drives, nodes 1 and 2, whose CANopen is npm's `canopen` (drive.mjs): another author and
another language than the bridge's and independent_drive's. This puts their frames on a CAN interface
and reports on stdout what independent_drive reports.

Usage: python3 canopen_drive INTERFACE NPM_DIR, where its packages and drive.mjs are"""

import json
import os
import select
import socket
import struct
import subprocess
import sys

FRAME = struct.Struct("=IB3x8s")  # linux/can.h


def main():
    interface, npm = sys.argv[1:]
    bus = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    bus.bind((interface,))
    drives = [
        subprocess.Popen(["node", "drive.mjs", str(node)], cwd=npm, stdin=subprocess.PIPE,
                         stdout=subprocess.PIPE)
        for node in (1, 2)
    ]
    begun = {drive.stdout.fileno(): b"" for drive in drives}
    wheels = {}
    while True:
        for ready in select.select([bus, *begun], [], [])[0]:
            if ready is bus:
                identifier, size, data = FRAME.unpack(bus.recv(FRAME.size))
                if identifier >> 29 == 0:
                    give(drives, identifier, data[:size])
                continue
            chunk = os.read(ready, 1 << 16)
            if not chunk:
                sys.exit("a drive ended")
            *lines, begun[ready] = (begun[ready] + chunk).split(b"\n")
            for line in lines:
                say(line, wheels) if line[:1] == b"{" else put(bus, line)


def give(drives, identifier, data):
    for drive in drives:
        drive.stdin.write(b"%x %s\n" % (identifier, data.hex().encode()))
        drive.stdin.flush()


def put(bus, line):
    """A frame of one drive. The other one need not hear it."""
    identifier, _, data = line.decode().partition(" ")
    data = bytes.fromhex(data)
    bus.send(FRAME.pack(int(identifier, 16), len(data), data.ljust(8, b"\0")))


def say(line, wheels):
    facts = json.loads(line)
    if "rps" not in facts:
        print(json.dumps(facts), flush=True)
        return
    wheels[facts["node"]] = facts
    if len(wheels) == 2:
        both = [wheels.pop(node) for node in (1, 2)]
        print(json.dumps({"t": facts["t"], **{k: [w[k] for w in both] for k in ("rps", "turns")}}),
              flush=True)


main()
