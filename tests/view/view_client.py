"""A client of tether view, written from RFC 6455 and Foxglove's specification, that can also misbehave."""

import base64
import json
import os
import pathlib
import re
import socket
import struct
import sys
import time

sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "live"))
from live_support import check, wait_until

PROTOCOL = "foxglove.websocket.v1"
TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10


def address_of(program):
    """(host, port) that a program with a view has printed."""
    found = wait_until(
        20, lambda: re.search(r"view at http://([\d.]+):(\d+)/", program.err()), "the address of the view"
    )
    return found[1], int(found[2])


def connected(address, buffer_bytes=None):
    raw = socket.socket()
    if buffer_bytes:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer_bytes)
    raw.settimeout(5)
    raw.connect(address)
    return raw


def http(address, target="/", method="GET", body=b"", **headers):
    """Status, header lines and body of the answer; headers with '_' for '-'. 0: it was cut off."""
    headers = {"Host": f"{address[0]}:{address[1]}", "Connection": "close"} | headers
    lines = [f"{name.replace('_', '-')}: {value}" for name, value in headers.items() if value is not None]
    raw = connected(address)
    raw.sendall("\r\n".join([f"{method} {target} HTTP/1.1", *lines, "", ""]).encode() + body)
    answer = b""
    try:
        while part := raw.recv(65536):
            answer += part
    except ConnectionResetError:
        pass
    raw.close()
    head, _, body = answer.partition(b"\r\n\r\n")
    return (int(head.split()[1]) if head else 0), head.decode(errors="replace"), body


def upgrade(raw, address, target="/", **headers):
    """Asks for a WebSocket; returns the answer's head."""
    key = base64.b64encode(os.urandom(16)).decode()
    headers = {
        "Host": f"{address[0]}:{address[1]}",
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Key": key,
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Protocol": PROTOCOL,
    } | {name.replace("_", "-"): value for name, value in headers.items()}
    lines = [f"{name}: {value}" for name, value in headers.items() if value is not None]
    raw.sendall("\r\n".join([f"GET {target} HTTP/1.1", *lines, "", ""]).encode())
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        part = raw.recv(1)
        if not part:
            break
        head += part
    return head.decode(errors="replace")


def frame(opcode, payload, masked=True, final=True):
    size = len(payload)
    head = bytes([opcode | (0x80 if final else 0)])
    mask_bit = 0x80 if masked else 0
    if size < 126:
        head += bytes([mask_bit | size])
    elif size < 1 << 16:
        head += bytes([mask_bit | 126]) + struct.pack(">H", size)
    else:
        head += bytes([mask_bit | 127]) + struct.pack(">Q", size)
    if not masked:
        return head + payload
    mask = os.urandom(4)
    return head + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(payload))


class Client:
    def __init__(self, address, buffer_bytes=None, **headers):
        self.raw = connected(address, buffer_bytes)
        head = upgrade(self.raw, address, **headers)
        check(" 101 " in head, f"no WebSocket: {head}")
        self._received = b""
        self.channels = {}  # by topic: id
        self.topics = {}  # by id, which subscriptions have, too
        self.parameters = {}
        self.status = []
        self.counts = {}  # messages by topic
        self.last = {}  # by topic
        self.binary_bytes = 0

    def close(self):
        self.raw.close()

    def send(self, **message):
        self.raw.sendall(frame(TEXT, json.dumps(message).encode()))

    def set(self, name, value, request="r"):
        self.send(op="setParameters", id=request, parameters=[{"name": name, "value": value}])

    def subscribe(self, *topics):
        ids = [self.channels[topic] for topic in topics]
        self.send(op="subscribe", subscriptions=[{"id": i, "channelId": i} for i in ids])

    def _frame(self):
        """Opcode and payload of the first whole frame; None if there is none."""
        data = self._received
        if len(data) < 2:
            return None
        size, start = data[1] & 127, 2
        if size == 126:
            size, start = int.from_bytes(data[2:4], "big"), 4
        elif size == 127:
            size, start = int.from_bytes(data[2:10], "big"), 10
        if len(data) < start + size:
            return None
        self._received = data[start + size :]
        return data[0] & 15, data[start : start + size]

    def read(self, seconds=0.0):
        """Takes what has arrived and arrives in that time. False once the server has ended it."""
        end = time.monotonic() + seconds
        while True:
            self.raw.settimeout(max(0.001, end - time.monotonic()))
            try:
                part = self.raw.recv(1 << 16)
            except TimeoutError:
                return True
            except ConnectionResetError:
                return False
            if not part:
                return False
            self._received += part
            while found := self._frame():
                self._take(*found)
            if time.monotonic() > end:
                return True

    def _take(self, opcode, payload):
        if opcode == PING:
            self.raw.sendall(frame(PONG, payload))
        elif opcode == BINARY and payload[0] == 1:
            subscription, _ = struct.unpack_from("<IQ", payload, 1)
            topic = self.topics[subscription]
            self.counts[topic] = self.counts.get(topic, 0) + 1
            self.last[topic] = payload[13:]
            self.binary_bytes += len(payload)
        elif opcode == TEXT:
            message = json.loads(payload)
            if message["op"] == "advertise":
                for channel in message["channels"]:
                    self.channels[channel["topic"]] = channel["id"]
                    self.topics[channel["id"]] = channel["topic"]
            elif message["op"] == "parameterValues":
                self.parameters |= {p["name"]: p.get("value") for p in message["parameters"]}
            elif message["op"] == "status":
                self.status.append(message)

    def wait(self, seconds, condition, what):
        """Reads until condition() holds."""
        def reads_and_looks():
            check(self.read(0.01), f"the server ended the connection: {what}")
            return condition()

        return wait_until(seconds, reads_and_looks, what)
