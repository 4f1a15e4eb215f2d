"""Tether's messages, as lcmtypes/*.lcm describes them: encoding and decoding, without LCM's library.

    POSE = tether.message_type("pose_t")
    pose = POSE.decode(data)            # None for what is no pose_t
    data = POSE.encode(utime=0, seq=0, run=0, x_m=1.0)   # omitted fields are zero or empty
"""

import functools
import pathlib
import re
import struct
import types

_HERE = pathlib.Path(__file__).resolve().parent
_FORMATS = {"int8_t": "b", "int16_t": "h", "int32_t": "i", "int64_t": "q", "boolean": "b", "byte": "B"}
_FORMATS |= {"float": "f", "double": "d"}


def _folder():
    """Installed, the descriptions are beside this file; in the source tree they are in lcmtypes/."""
    for folder in (_HERE / "lcmtypes", _HERE.parents[1] / "lcmtypes"):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"no lcmtypes beside {_HERE}")


class MessageType:
    """One struct: `name`, `fields` as (name, type, size or ""), `constants` by name."""

    def __init__(self, text):
        text = re.sub(r"//[^\n]*", "", text)
        self.name, body = re.search(r"struct\s+(\w+)\s*\{(.*)\}", text, re.DOTALL).groups()
        self.fields = [
            (name, kind, size)
            for kind, name, size in re.findall(r"^\s*(\w+)\s+(\w+)(?:\[(\w+)\])?\s*;", body, re.MULTILINE)
        ]
        constants = re.findall(r"const\s+\w+\s+(\w+)\s*=\s*([^;,\s]+)\s*;", body)
        self.constants = {name: float(v) if "." in v else int(v, 0) for name, v in constants}
        self.fingerprint = self._fingerprint()

    def _fingerprint(self):
        value = 0x12345678
        for name, kind, size in self.fields:
            numbers = [len(name), *name.encode(), len(kind), *kind.encode(), 1 if size else 0]
            if size:
                numbers += [0 if size.isdigit() else 1, len(size), *size.encode()]
            for number in numbers:
                signed = value - (1 << 64) if value >> 63 else value
                value = ((value << 8) ^ (signed >> 55)) + number & (1 << 64) - 1
        return struct.pack(">Q", (value << 1 | value >> 63) & (1 << 64) - 1)

    def encode(self, **values):
        unknown = values.keys() - {name for name, _, _ in self.fields}
        if unknown:
            raise TypeError(f"{self.name} has no {', '.join(sorted(unknown))}")
        data = [self.fingerprint]
        for name, kind, size in self.fields:
            value = values.get(name, [] if size else "" if kind == "string" else 0)
            items = value if size else [value]
            if kind == "string":
                for text in items:
                    raw = text.encode() + b"\0"
                    data.append(struct.pack(">i", len(raw)) + raw)
            else:
                data.append(struct.pack(f">{len(items)}{_FORMATS[kind]}", *items))
        return b"".join(data)

    def decode(self, data):
        """A namespace with the fields; None for anything that is not exactly one such message."""
        if data[:8] != self.fingerprint:
            return None
        at = 8
        message = types.SimpleNamespace()
        try:
            for name, kind, size in self.fields:
                count = 1 if not size else int(size) if size.isdigit() else getattr(message, size)
                if kind == "string":
                    value = []
                    for _ in range(count):
                        (length,) = struct.unpack_from(">i", data, at)
                        if length < 1 or at + 4 + length > len(data):
                            return None
                        value.append(data[at + 4 : at + 3 + length].decode())
                        at += 4 + length
                else:
                    layout = f">{count}{_FORMATS[kind]}"
                    value = list(struct.unpack_from(layout, data, at))
                    at += struct.calcsize(layout)
                setattr(message, name, value if size else value[0])
        except (struct.error, UnicodeDecodeError):
            return None
        return message if at == len(data) else None


@functools.cache
def message_types():
    """All of them, by name ("pose_t")."""
    all_types = [MessageType(file.read_text()) for file in sorted(_folder().glob("tether_*.lcm"))]
    return {one.name: one for one in all_types}


def message_type(name):
    return message_types()[name]


@functools.cache
def _by_fingerprint():
    return {one.fingerprint: one for one in message_types().values()}


def decode(data):
    """A message of whichever type: (name, namespace); None for bytes that are no message."""
    kind = _by_fingerprint().get(bytes(data[:8]))
    message = kind.decode(data) if kind else None
    return (kind.name, message) if message is not None else None
