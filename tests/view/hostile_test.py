#!/usr/bin/env -S python3 -B
"""Hostile, broken and slow clients of tether view: the run goes on and is what it says, the server lives
and serves others, and keeps to its memory. Usage: hostile_test.py BIN_DIR"""

import itertools
import json
import pathlib
import random
import signal
import socket
import struct
import threading
import time

from view_client import BINARY, PING, TEXT, Client, address_of, connected, frame, http, upgrade
from live_support import PAPER, POSE, check, main, wait_for_loop, wait_until

VEHICLES, RATE_HZ, CLIENTS = 100, 50, 20
HOSTILE = 1000  # sockets
PRESSED_S = 0.1  # from a press to its effect, and from connecting to being in
MOST_MB = 120  # memory limit of the server, with a client that reads nothing
SANITIZERS_ARE_LARGER = 10  # and slower: AddressSanitizer keeps what is freed


def status(address):
    return json.loads(http(address, "/api/status.json")[2])


def garbage(address, rng):
    for _ in range(50):
        raw = connected(address)
        raw.sendall(rng.randbytes(rng.randrange(1, 3000)))
        raw.close()
    for head in (b"GET / HTTP/1.1\r\n" + b"X: " + b"a" * 100_000, b"\0" * 9000, b"GET /" + b"a" * 20_000 + b" HTTP/1.1\r\n\r\n"):
        raw = connected(address)
        raw.sendall(head)
        check(raw.recv(10_000)[:20] in (b"", b"HTTP/1.1 400 Bad Req"), "an answer to garbage")
        raw.close()


def other_requests(address):
    for target in ("/../../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/..%2f..%2fetc/passwd",
                   "/index.html/../../x", "/.git/config", "http://evil.example/", "*", "/index.html%00.js"):
        found, _, body = http(address, target)
        check(found in (400, 404) and b"root:" not in body, f"{target}: {found} {body[:50]}")
    check(http(address, "/", "POST", b"x" * 10, Content_Length=10)[0] in (0, 400, 405, 413), "POST")
    check(http(address, "/", "DELETE")[0] == 405, "DELETE")
    check(http(address, "/", "HEAD")[0] == 200, "HEAD")
    check(http(address, "/", Host="evil.example")[0] == 403, "DNS rebinding")
    check(http(address, "/", Origin="http://evil.example")[0] == 403, "another site's page")
    for headers, code in (
        ({"Origin": "http://evil.example"}, 403), ({"Host": "evil.example"}, 403), ({"Origin": "null"}, 403),
        ({"Sec_WebSocket_Protocol": "chat"}, 400), ({"Sec_WebSocket_Protocol": None}, 400),
    ):
        raw = connected(address)
        head = upgrade(raw, address, **headers)
        check(f" {code} " in head, f"{headers}: {head}")
        raw.close()


def bad_frames(address, rng):
    """Each ends its own connection."""
    huge = bytes([0x82, 0xFF]) + struct.pack(">Q", 1 << 62) + bytes(4)
    for what, data in (
        ("huge", huge), ("longest", bytes([0x82, 0xFF]) + b"\xff" * 8 + bytes(4)),
        ("not masked", frame(TEXT, b"{}", masked=False)), ("no UTF-8", frame(TEXT, b"\xff\xfe")),
        ("over 64 KiB", frame(BINARY, bytes(70_000))), ("reserved", frame(5, b"x")),
        ("long ping", frame(PING, bytes(200))), ("ping in parts", frame(PING, b"x", final=False)),
        ("continuation of nothing", frame(0, b"x")), ("random", rng.randbytes(5000)),
    ):
        client = Client(address)
        client.raw.sendall(data)
        wait_until(5, lambda: not client.read(0.05), f"the end of a connection that sent: {what}")


def nonsense(address, rng):
    """Each is answered by a status, and the connection goes on."""
    client = Client(address)
    texts = ["{", "[" * 60_000, json.dumps({"op": "dance"}), json.dumps({"op": "subscribe", "subscriptions": [{"id": -1}]}),
             json.dumps({"op": "subscribe", "subscriptions": [{"id": i, "channelId": 10**6 + i} for i in range(500)]}),
             json.dumps({"op": "setParameters", "parameters": [{"name": "network.uplink.prr", "value": "x' \n y"}]}),
             json.dumps({"op": "setParameters", "parameters": [{"name": "network.uplink.trace.file", "value": "/etc/passwd"}]}),
             json.dumps({"op": "setParameters", "parameters": [{"name": "nothing", "value": 1}]}),
             json.dumps({"op": "advertise", "channels": [{"id": 1, "topic": "CTRL/CMD_VEL", "encoding": "json"}]})]
    for text in texts:
        client.raw.sendall(frame(TEXT, text.encode()))
    for _ in range(50):
        client.raw.sendall(frame(BINARY, rng.randbytes(rng.randrange(200))))
    client.wait(5, lambda: len(client.status) >= len(texts) + 50, "answers to all nonsense")
    client.close()


def cut_off_for_text(address):
    """Asks and asks, and reads no answer."""
    client = Client(address, buffer_bytes=4096)
    ask = frame(TEXT, json.dumps({"op": "getParameters", "parameterNames": []}).encode()) * 200
    client.raw.settimeout(10)
    try:
        for _ in range(1000):
            client.raw.sendall(ask)
    except (ConnectionError, TimeoutError):
        return
    check(False, "200000 unread answers wait for a client")


def too_many(address):
    """Connections that say nothing: as many as there may be, and no more."""
    idle = [connected(address) for _ in range(150)]
    wait_until(5, lambda: any(_ended(raw) for raw in idle), "one too many is turned away")
    for raw in idle:
        raw.close()
    wait_until(5, lambda: http(address)[0] == 200, "the page, when they are gone")


def _ended(raw):
    raw.settimeout(0.001)
    try:
        return raw.recv(1) == b""
    except (TimeoutError, ConnectionResetError):
        return False


def scale(test):
    return SANITIZERS_ARE_LARGER if b"__asan_init" in (test.bin / "tether").read_bytes() else 1


def memory_mb(pid):
    text = pathlib.Path(f"/proc/{pid}/status").read_text()
    return int(text.split("VmHWM:")[1].split()[0]) / 1024


def cpu_s(pid):
    """Processor time of all its threads; by nanoseconds, for ticks would miss who always sleeps at them."""
    tasks = pathlib.Path(f"/proc/{pid}/task").iterdir()
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) * 1e-9


def hostile_clients_harm_neither_the_run_nor_each_other(test):
    live = test.start("tether", "live", PAPER, "--set=sensor.rate_hz=20", "--duration=600", "--view", "--port=0")
    wait_for_loop(test.network)
    address = address_of(live)
    server = live.children()["tether"]
    witness = Client(address)
    witness.wait(5, lambda: "CTRL/POSE" in witness.channels, "channels")
    witness.subscribe("CTRL/POSE")
    rng = random.Random(1)
    garbage(address, rng)
    other_requests(address)
    bad_frames(address, rng)
    nonsense(address, rng)
    cut_off_for_text(address)
    too_many(address)
    witness.counts = {}
    begin = time.monotonic()
    witness.wait(5, lambda: witness.counts.get("CTRL/POSE", 0) >= 20, "a second of poses")
    test.say(f"{status(address)}, at most {memory_mb(server):.0f} MB; a second of poses in {time.monotonic() - begin:.1f} s")
    check(memory_mb(server) < MOST_MB * scale(test), f"the server has {memory_mb(server)} MB")
    live.kill(signal.SIGINT)
    check(live.wait(10) == 0, f"exit code {live.process.returncode}: {live.err()}")


def hostile_sockets(address, stop, said):
    """Connections from ten addresses that say nothing, half a request or a byte: 500 are held, 500 opened again and
    again."""
    half = b"GET / HTTP/1.1\r\nHost: a\r\nX: "
    sockets = []
    for i in itertools.count():
        if stop.is_set():
            break
        if len(sockets) >= HOSTILE:
            sockets.pop(HOSTILE // 2).close()
        raw = socket.socket()
        raw.settimeout(2)
        try:
            raw.bind((f"127.0.0.{2 + i % 10}", 0))
            raw.connect(address)
            raw.sendall((b"", half, b"G")[i % 3])
        except OSError:
            raw.close()
            continue
        sockets.append(raw)
        said[0] += 1
        if len(sockets) == HOSTILE:
            time.sleep(0.002)
    for raw in sockets:
        raw.close()


def hostile_sockets_keep_no_client_out(test):
    """A client that may pass gets in, and what it presses has its effect, beside 1000 that only connect."""
    live = test.start("tether", "live", PAPER, "--set=sensor.rate_hz=20", "--duration=600", "--view", "--port=0")
    wait_for_loop(test.network)
    address = address_of(live)
    stop, said = threading.Event(), [0]
    attack = threading.Thread(target=hostile_sockets, args=(address, stop, said))
    attack.start()
    try:
        wait_until(30, lambda: said[0] >= HOSTILE, "the hostile sockets")
        comes_in, pressed = [], []
        for attempt in range(20):
            begin = time.monotonic()
            owner = Client(address)
            owner.wait(5, lambda: owner.channels, "channels")
            comes_in.append(time.monotonic() - begin)
            owner.send(op="getParameters", parameterNames=[], id="all")
            owner.wait(2, lambda: "network.uplink.prr" in owner.parameters, "parameters")
            prr = 0.5 + 0.02 * attempt
            asked = time.time()
            owner.set("network.uplink.prr", prr)
            report = wait_until(2, lambda: next((m for m in test.network.messages("NET/UPLINK", since=asked)
                                                 if abs(m.state_prr - prr) < 1e-9), None), "the new setting in force")
            pressed.append(report.arrival - asked)
            owner.close()
        waiting = status(address)["connections.waiting"]
        test.say(f"beside {said[0]} hostile sockets: in after {1e3 * max(comes_in):.0f} ms, in force after "
                 f"{1e3 * max(pressed):.0f} ms at most; {waiting} wait")
        check(max(comes_in) < PRESSED_S * scale(test), f"let in after {comes_in}")
        check(max(pressed) < PRESSED_S * scale(test), f"in force after {pressed}")
        slow = connected(address)
        slow.sendall(b"GET / HTTP/1.1\r\n")
        begin = time.monotonic()
        wait_until(3, lambda: _ended(slow), "slow headers are cut off")
        check(time.monotonic() - begin < 2.0 * scale(test), f"cut off after {time.monotonic() - begin:.1f} s")
    finally:
        stop.set()
        attack.join()
    live.kill(signal.SIGINT)
    check(live.wait(10) == 0, f"exit code {live.process.returncode}: {live.err()}")


def a_fleet(network, stop):
    """VEHICLES' poses at RATE_HZ, spread over the period."""
    due, seq = time.monotonic(), 0
    while not stop.is_set():
        seq += 1
        for part in range(10):
            for vehicle in range(part * VEHICLES // 10, (part + 1) * VEHICLES // 10):
                network.send(f"AGV{vehicle}/POSE", POSE.encode(seq=seq, utime=seq * 20_000, x_m=0.1 * seq, y_m=vehicle))
            due += 1 / RATE_HZ / 10
            time.sleep(max(0.0, due - time.monotonic()))


def cost(pid, seconds, clients):
    """Share of a core, and messages per second that each client hears."""
    for client in clients:
        client.counts = {}
    before, begin = cpu_s(pid), time.monotonic()
    while time.monotonic() - begin < seconds:
        for client in clients:
            client.read(0.001)
        time.sleep(0 if clients else seconds)
    passed = time.monotonic() - begin
    heard = sum(sum(client.counts.values()) for client in clients) / max(1, len(clients))
    return (cpu_s(pid) - before) / passed, heard / passed


def subscribed(address, number, topic_part):
    """Clients that want all channels whose name contains it."""
    clients = [Client(address) for _ in range(number)]
    for client in clients:
        client.wait(10, lambda: sum(t.startswith("AGV") for t in client.channels) == VEHICLES, "all vehicles")
        client.subscribe(*(t for t in client.channels if topic_part in t))
    return clients


def a_fleet_is_seen_by_many_and_a_dead_one_costs_nothing(test):
    view = test.start("tether", "view", "--port=0", "--lcm-url", test.network.url)
    address = address_of(view)
    stop = threading.Event()
    fleet = threading.Thread(target=a_fleet, args=(test.network, stop), daemon=True)
    fleet.start()
    try:
        no_client, _ = cost(view.pid, 3, [])
        dead = Client(address, buffer_bytes=4096)
        dead.wait(10, lambda: sum(t.startswith("AGV") for t in dead.channels) == VEHICLES, "all vehicles")
        dead.subscribe(*(t for t in dead.channels if "/POSE" in t))  # and reads no more
        one, _ = cost(view.pid, 3, subscribed(address, 1, "/POSE"))
        clients = subscribed(address, CLIENTS, "/POSE")
        many, heard = cost(view.pid, 5, clients)
        counters = status(address)
        test.say(
            f"CPU of a core: no client {no_client:.1%}, one {one:.1%}, {CLIENTS} {many:.1%}; each of these hears "
            f"{heard:.0f}/s; {memory_mb(view.pid):.0f} MB; {counters}"
        )
        wait_until(20, lambda: status(address)["messages.dropped_for_slow_clients"] > 0, "drops for the dead one")
        check(memory_mb(view.pid) < MOST_MB * scale(test), f"the server has {memory_mb(view.pid)} MB")
    finally:
        stop.set()
        fleet.join()


main(hostile_clients_harm_neither_the_run_nor_each_other, hostile_sockets_keep_no_client_out, a_fleet_is_seen_by_many_and_a_dead_one_costs_nothing)
