"""The object dictionary of a CANopen device, and the SDO server that gives access to it (CiA 301,
7.4 and 7.2.4)."""

# Abort codes, CiA 301, table 22.
TOGGLE_NOT_ALTERNATED = 0x05030000
UNKNOWN_COMMAND = 0x05040001
WRITE_ONLY = 0x06010001
READ_ONLY = 0x06010002
NO_OBJECT = 0x06020000
NOT_MAPPABLE = 0x06040041
PDO_TOO_LONG = 0x06040042
WRONG_LENGTH = 0x06070010
NO_SUBINDEX = 0x06090011
INVALID_VALUE = 0x06090030
DEVICE_STATE = 0x08000022


class Abort(Exception):
    def __init__(self, code):
        super().__init__(f"{code:08X}")
        self.code = code


class Entry:
    """One object. kind: u8, i16 …, or text. access: ro, rw or wo. pdo: the letters of PDOs that may
    carry it, r(eceive) and t(ransmit)."""

    def __init__(self, kind, default, access, pdo, check, written):
        self.kind = kind
        self.default = self.value = default
        self.access = access
        self.pdo = pdo
        self.check = check  # check(value) raises Abort
        self.written = written  # written(value), after each write

    @property
    def size(self):
        return len(self.value) if self.kind == "text" else int(self.kind[1:]) // 8

    def encode(self):
        if self.kind == "text":
            return self.value.encode()
        mask = (1 << 8 * self.size) - 1
        return (int(self.value) & mask).to_bytes(self.size, "little")

    def decode(self, data):
        return int.from_bytes(data, "little", signed=self.kind[0] == "i")

    def write(self, value):
        if self.check:
            self.check(value)
        self.value = value
        if self.written:
            self.written(value)


class Dictionary:
    def __init__(self, ignored=()):
        """`ignored`: objects that take values, return them by SDO, and act as if they were 0."""
        self._entries = {}
        self._ignored = ignored

    def add(self, index, sub, kind, default, access="rw", pdo="", check=None, written=None):
        self._entries[index, sub] = Entry(kind, default, access, pdo, check, written)

    def remove(self, index, sub=None):
        """One subindex, or the whole object."""
        for key in [k for k in self._entries if k[0] == index and sub in (None, k[1])]:
            del self._entries[key]

    def entry(self, index, sub):
        if found := self._entries.get((index, sub)):
            return found
        known = any(key[0] == index for key in self._entries)
        raise Abort(NO_SUBINDEX if known else NO_OBJECT)

    def get(self, index, sub=0, otherwise=0):
        """The value; `otherwise` where the device has no such object."""
        if any(index == i and s in (None, sub) for i, s in self._ignored):
            return 0
        found = self._entries.get((index, sub))
        return found.value if found else otherwise

    def set(self, index, sub, value):
        """By the device itself."""
        if found := self._entries.get((index, sub)):
            found.value = value

    def reset(self, first=0, last=0xFFFF):
        for (index, _), entry in self._entries.items():
            if first <= index <= last:
                entry.value = entry.default


class SdoServer:
    """Expedited download; expedited and segmented upload. One client."""

    def __init__(self, dictionary):
        self._dictionary = dictionary
        self._upload = None  # rest of a segmented upload
        self._toggle = 0
        self._name = bytes(3)

    def reset(self):
        self._upload = None

    def refuse(self, request):
        """The response that the device's state does not allow it."""
        return b"\x80" + bytes(request[1:4]) + DEVICE_STATE.to_bytes(4, "little")

    def answer(self, request):
        """The 8 bytes of the response; None if the request asks for none."""
        if len(request) != 8:
            return None
        specifier = request[0] >> 5
        if specifier == 4:  # the client gives up
            self._upload = None
            return None
        if specifier != 3:
            self._name = bytes(request[1:4])
        try:
            if specifier == 1:
                return self._download(request)
            if specifier == 2:
                return self._begin_upload()
            if specifier == 3:
                return self._upload_segment(request)
            raise Abort(UNKNOWN_COMMAND)
        except Abort as abort:
            self._upload = None
            return b"\x80" + self._name + abort.code.to_bytes(4, "little")

    def _entry(self):
        return self._dictionary.entry(int.from_bytes(self._name[:2], "little"), self._name[2])

    def _download(self, request):
        entry = self._entry()
        if entry.access == "ro":
            raise Abort(READ_ONLY)
        if not request[0] & 2:
            raise Abort(WRONG_LENGTH)  # nothing here is longer than an expedited transfer
        size = 4 - (request[0] >> 2 & 3) if request[0] & 1 else entry.size
        if size != entry.size:
            raise Abort(WRONG_LENGTH)
        entry.write(entry.decode(request[4 : 4 + size]))
        return b"\x60" + self._name + bytes(4)

    def _begin_upload(self):
        entry = self._entry()
        if entry.access == "wo":
            raise Abort(WRITE_ONLY)
        data = entry.encode()
        if len(data) <= 4:
            return bytes([0x43 | (4 - len(data)) << 2]) + self._name + data.ljust(4, b"\0")
        self._upload, self._toggle = data, 0
        return b"\x41" + self._name + len(data).to_bytes(4, "little")

    def _upload_segment(self, request):
        if self._upload is None:
            raise Abort(UNKNOWN_COMMAND)
        if request[0] >> 4 & 1 != self._toggle:
            raise Abort(TOGGLE_NOT_ALTERNATED)
        data, rest = self._upload[:7], self._upload[7:]
        command = self._toggle << 4 | (7 - len(data)) << 1 | (0 if rest else 1)
        self._upload = rest or None
        self._toggle ^= 1
        return bytes([command]) + data.ljust(7, b"\0")
