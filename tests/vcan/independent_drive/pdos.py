"""The four receive and four transmit PDOs of a CANopen device: communication and mapping parameters
(CiA 301, 7.5.2.35 to 7.5.2.38) and what they make of frames."""

from objects import DEVICE_STATE, INVALID_VALUE, NOT_MAPPABLE, PDO_TOO_LONG, Abort

OFF = 1 << 31
NO_RTR = 1 << 30


class Pdo:
    """`bit_30`: the device answers no remote requests, and insists on saying so."""

    def __init__(self, dictionary, node, number, transmit, mapping, bit_30):
        self._dictionary = dictionary
        self._transmit = transmit
        self._bit_30 = bit_30
        self._parameters = (0x1800 if transmit else 0x1400) + number - 1
        self._mapping = self._parameters + 0x200
        base = (0x180 if transmit else 0x200) + 0x100 * (number - 1) + node
        add = dictionary.add
        cob_id = base | (0 if mapping else OFF) | (NO_RTR if bit_30 else 0)
        add(self._parameters, 0, "u8", 5, "ro")
        add(self._parameters, 1, "u32", cob_id, check=self._check_cob_id)
        add(self._parameters, 2, "u8", 255, check=self._check_type)
        if transmit:
            add(self._parameters, 3, "u16", 0, check=self._check_off)
        add(self._parameters, 5, "u16", 0)
        add(self._mapping, 0, "u8", len(mapping), check=self._check_count)
        for i in range(8):
            default = mapping[i] if i < len(mapping) else 0
            add(self._mapping, i + 1, "u32", default, check=self._check_entry)
        self.start(0.0)

    def start(self, now):
        """The device became operational."""
        self.last = now
        self.watched = False  # whether its deadline runs
        self._pending = None  # received, until the next SYNC
        self._sent = None
        self._syncs = 0

    # --- parameters

    def _parameter(self, sub):
        return self._dictionary.get(self._parameters, sub)

    @property
    def valid(self):
        return not self._parameter(1) & OFF

    @property
    def identifier(self):
        return self._parameter(1) & 0x7FF

    @property
    def synchronous(self):
        return self._parameter(2) <= 240

    @property
    def event_s(self):
        return self._parameter(5) * 1e-3

    def _check_cob_id(self, value):
        if value & 0x3FFFF800 or (self._bit_30 and not value & NO_RTR):
            raise Abort(INVALID_VALUE)
        if self.valid and not value & OFF and value & 0x7FF != self.identifier:
            raise Abort(INVALID_VALUE)  # the identifier changes only while the PDO is off

    def _check_type(self, value):
        if 240 < value < 254:
            raise Abort(INVALID_VALUE)

    def _check_off(self, _):
        if self.valid:
            raise Abort(DEVICE_STATE)

    def _check_entry(self, value):
        if self.valid or self._dictionary.get(self._mapping, 0):
            raise Abort(DEVICE_STATE)
        self._mappable(value)

    def _check_count(self, count):
        self._check_off(count)
        if count > 8:
            raise Abort(PDO_TOO_LONG)
        entries = [self._mappable(self._dictionary.get(self._mapping, i + 1)) for i in range(count)]
        if sum(entry.size for entry in entries) > 8:
            raise Abort(PDO_TOO_LONG)

    def _mappable(self, mapped):
        try:
            entry = self._dictionary.entry(mapped >> 16, mapped >> 8 & 0xFF)
        except Abort:
            raise Abort(NOT_MAPPABLE) from None
        if ("t" if self._transmit else "r") not in entry.pdo or mapped & 0xFF != 8 * entry.size:
            raise Abort(NOT_MAPPABLE)
        return entry

    def _entries(self):
        for i in range(self._dictionary.get(self._mapping, 0)):
            yield self._mappable(self._dictionary.get(self._mapping, i + 1))

    # --- a receive PDO

    def receive(self, data, now):
        """Whether it is long enough. Synchronous ones act at the next SYNC."""
        if len(data) < sum(entry.size for entry in self._entries()):
            return False
        self.last, self.watched = now, True
        self._pending = bytes(data)
        if not self.synchronous:
            self.act()
        return True

    def act(self):
        data, self._pending = self._pending, None
        for entry in self._entries() if data is not None else ():
            try:
                entry.write(entry.decode(data[: entry.size]))
            except Abort:
                pass  # a value that the object does not take changes nothing
            data = data[entry.size :]

    def overdue(self, now):
        if not (self.valid and self.watched and self.event_s and now - self.last >= self.event_s):
            return False
        self.watched = False
        return True

    # --- a transmit PDO

    def on_sync(self, now):
        """The data to send at this SYNC; None: not now."""
        if not self.valid or not self.synchronous:
            return None
        self._syncs += 1
        if self._parameter(2) == 0:  # only if something has changed
            return self._sample(now) if self._content() != self._sent else None
        if self._syncs < self._parameter(2):
            return None
        self._syncs = 0
        return self._sample(now)

    def on_time(self, now):
        """The same between SYNCs: what is sent by event."""
        if not self.valid or self.synchronous:
            return None
        if now - self.last < self._parameter(3) * 1e-4:  # inhibit time
            return None
        timer = self.event_s and now - self.last >= self.event_s
        return self._sample(now) if timer or self._content() != self._sent else None

    def _content(self):
        return b"".join(entry.encode() for entry in self._entries())

    def _sample(self, now):
        self.last = now
        self._sent = self._content()
        return self._sent
