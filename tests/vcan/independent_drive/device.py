"""A CANopen device: NMT states, boot-up, heartbeats of its own and of its master, SDO, PDOs and
emergency messages (CiA 301). What it is a device for comes from its application (drive.py)."""

import collections

from objects import INVALID_VALUE, Abort, Dictionary, SdoServer
from pdos import Pdo

BOOTING, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
HEARTBEAT_LOST, PDO_LENGTH, RPDO_DEADLINE = 0x8130, 0x8210, 0x8250


def error_register(code):
    """0x1001: generic, and the kind of error by the code's first digit."""
    kinds = {2: 0x02, 3: 0x04, 4: 0x08, 8: 0x10, 0xF: 0x80}
    return 0x01 | kinds.get(code >> 12, 0) if code else 0


class Device:
    """`send(identifier, data)` puts a frame on the bus, `tell(**facts)` reports to the test.
    `options` are the command line's."""

    def __init__(self, node, options, send, tell, now):
        self.node = node
        self.objects = Dictionary(options.ignore)
        self.nmt = BOOTING
        self.tell = tell
        self._options = options
        self._send = send
        self._sdo = SdoServer(self.objects)
        self._requests = collections.deque()  # SDO: when each may be answered, and what it was
        self._add_objects()
        self._pdos = []
        self._boot(now, whole=True)

    # --- what the application may say

    def use(self, application):
        self.application = application
        application.add_objects(self.objects)
        bit_30 = self._options.no_rtr
        for number, objects in ((1, [0x60400010]), (2, [0x60400010, 0x60600008]), (3, []), (4, [])):
            self._pdos.append(Pdo(self.objects, self.node, number, False, objects, False))
        for number, objects in ((1, [0x60410010]), (2, [0x60410010, 0x60610008]), (3, []), (4, [])):
            self._pdos.append(Pdo(self.objects, self.node, number, True, objects, bit_30))
        for index, sub in self._options.without:
            self.objects.remove(index, sub)

    def emergency(self, code):
        self.objects.set(0x1001, 0, error_register(code))
        if self.nmt in (OPERATIONAL, PRE_OPERATIONAL):
            data = code.to_bytes(2, "little") + bytes([error_register(code)]) + bytes(5)
            self._send(0x080 + self.node, data)

    # --- objects

    def _add_objects(self):
        add, node = self.objects.add, self.node
        add(0x1000, 0, "u32", 0x00020192, "ro")
        add(0x1001, 0, "u8", 0, "ro", "t")
        add(0x1005, 0, "u32", 0x80, "ro")
        add(0x1008, 0, "text", "A drive written from the standard", "ro")
        add(0x1014, 0, "u32", 0x80 + node, "ro")
        add(0x1016, 0, "u8", 1, "ro")
        add(0x1016, 1, "u32", 0, check=self._check_consumer, written=self._forget_master)
        add(0x1017, 0, "u16", 0, written=lambda _: self._beat_soon())
        add(0x1018, 0, "u8", 4, "ro")
        serial = 1000 + node if self._options.serial is None else self._options.serial
        for sub, value in enumerate((0x0000_0ABC, 0x402, 0x0002_0001, serial), 1):
            add(0x1018, sub, "u32", value, "ro")
        add(0x1029, 0, "u8", 1, "ro")
        add(0x1029, 1, "u8", 0, check=self._check_behaviour)

    def _check_consumer(self, value):
        if value >> 24 or value >> 16 == self.node:
            raise Abort(INVALID_VALUE)

    def _check_behaviour(self, value):
        if value > 2:
            raise Abort(INVALID_VALUE)

    def _forget_master(self, _=None):
        self._master_heard = None  # it is watched from its first heartbeat on (CiA 301, 7.5.2.19)

    def _beat_soon(self):
        self._next_beat = 0.0

    # --- NMT

    def _boot(self, now, whole):
        self.nmt = BOOTING
        self._whole = whole
        self._boot_until = now + self._options.boot_s if whole else now
        self._answers_from = self._boot_until + self._options.sdo_after_s
        self._toggle = 0
        self._forget_master()
        self._beat_soon()
        self._requests.clear()
        self._sdo.reset()
        self.tell(node=self.node, event="reset")
        if self._pdos:
            self.objects.reset(*(() if whole else (0x1000, 0x1FFF)))
        if whole and self._pdos:
            self.application.power_on()

    def _finish_boot(self, now):
        self.nmt = PRE_OPERATIONAL
        after = self._options.second_boot_s
        self._second_boot = None if after is None else self._boot_until + after
        self._send(0x700 + self.node, b"\0")
        self.tell(node=self.node, event="boot-up")

    def _on_nmt(self, command, now):
        if command in (0x81, 0x82):
            self.application.connection_ended()
            self._boot(now, whole=command == 0x81)
            return
        states = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}
        if self.nmt == BOOTING or command not in states:
            return
        if states[command] == STOPPED:
            self.application.connection_ended()
        self._enter(states[command], now)

    def _enter(self, state, now):
        if state == self.nmt:
            return
        self.nmt = state
        self.tell(node=self.node, event="nmt", state=state)
        if state == OPERATIONAL:
            for pdo in self._pdos:
                pdo.start(now)

    # --- frames

    def on_frame(self, identifier, data, now):
        if identifier == 0x000:
            if len(data) == 2 and data[1] in (0, self.node):
                self._on_nmt(data[0], now)
        elif self.nmt in (BOOTING, STOPPED):
            return
        elif identifier == 0x600 + self.node:
            if now >= self._answers_from:
                begin = max([now, *(due for due, _ in self._requests)])
                takes = self._options.sdo_write_s if data[:1] and data[0] >> 5 == 1 else 0.0
                self._requests.append((begin + takes, data))
                self._answer(now)
        elif 0x700 < identifier < 0x780:
            consumer = self.objects.get(0x1016, 1)
            if consumer & 0xFFFF and identifier == 0x700 + (consumer >> 16):
                self._master_heard = now
        elif self.nmt == OPERATIONAL:
            self._on_process_data(identifier, data, now)

    def _on_process_data(self, identifier, data, now):
        if identifier == 0x080:
            for pdo in self._transmit():
                if (sample := pdo.on_sync(now)) is not None:
                    self._send_pdo(pdo, sample)
            for pdo in self._receive():
                if pdo.valid and pdo.synchronous:
                    pdo.act()
            return
        for pdo in self._receive():
            if pdo.valid and pdo.identifier == identifier and not pdo.receive(data, now):
                self.emergency(PDO_LENGTH)

    def _send_pdo(self, pdo, sample):
        self._send(pdo.identifier, sample.ljust(8, b"\0") if self._options.pad else sample)

    def _receive(self):
        return self._pdos[:4]

    def _transmit(self):
        return self._pdos[4:]

    def _answer(self, now):
        """One request after the other, each with its time."""
        while self._requests and self._requests[0][0] <= now:
            request = self._requests.popleft()[1]
            answer = self._sdo.refuse(request) if self._refuses() else self._sdo.answer(request)
            if answer:
                self._send(0x580 + self.node, answer)

    def _refuses(self):
        turns = abs(self.application.wheel_rps) > 0.01
        return self._options.sdo_only_at_rest and self.nmt != OPERATIONAL and turns

    # --- time

    def tick(self, now):
        if self.nmt == BOOTING:
            if now < self._boot_until:
                return
            self._finish_boot(now)
        if self._second_boot is not None and now >= self._second_boot:
            self._second_boot = None
            self._send(0x700 + self.node, b"\0")
        self._answer(now)
        self._watch(now)
        if self.nmt == OPERATIONAL:
            for pdo in self._transmit():
                if (sample := pdo.on_time(now)) is not None:
                    self._send_pdo(pdo, sample)
        period = self.objects.get(0x1017) * 1e-3
        if period and now >= self._next_beat:
            self._next_beat = max(self._next_beat + period, now + period / 2)
            self._send(0x700 + self.node, bytes([self.nmt | self._toggle]))
            self._toggle ^= 0x80 if self._options.toggle else 0

    def _watch(self, now):
        limit = (self.objects.get(0x1016, 1) & 0xFFFF) * 1e-3
        if limit and self._master_heard is not None and now - self._master_heard >= limit:
            self._forget_master()
            self.emergency(HEARTBEAT_LOST)
            self.application.connection_ended()
            behaviour = self.objects.get(0x1029, 1)
            if self.nmt == OPERATIONAL and behaviour != 1:
                self._enter(STOPPED if behaviour == 2 else PRE_OPERATIONAL, now)
        if self.nmt == OPERATIONAL and any(pdo.overdue(now) for pdo in self._receive()):
            self.application.trip(RPDO_DEADLINE)
