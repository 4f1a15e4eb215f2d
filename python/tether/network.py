"""LCM over UDP multicast (udpm://GROUP:PORT?ttl=N), by sockets of the standard library."""

import errno
import re
import select
import socket
import struct

DEFAULT_URL = "udpm://239.255.76.67:7667?ttl=0"
_WHOLE, _PART = struct.pack(">I", 0x4C433032), struct.pack(">I", 0x4C433033)
_LARGEST = 65_000  # bytes of a datagram; more goes in parts
_MOST_UNFINISHED = 64


class Network:
    """Publishes and receives messages. Messages of one's own come back, as with LCM's library."""

    def __init__(self, url=DEFAULT_URL):
        found = re.fullmatch(r"udpm://([\d.]+):(\d+)(?:\?(.*))?", url)
        if not found or int(found[2]) > 0xFFFF:
            raise ValueError(f"LCM URL: must be udpm://GROUP:PORT?ttl=N, not {url!r}")
        settings = dict(pair.partition("=")[::2] for pair in (found[3] or "").split("&"))
        self.url = url
        self._address = (found[1], int(found[2]))
        self._sent = 0
        self._unfinished = {}
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._in = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._open(settings)
        except BaseException:
            self.close()
            raise

    def _open(self, settings):
        self._out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(settings.get("ttl", 0)))
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._in.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        self._in.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVBUF, int(settings.get("recv_buf_size", 1 << 21))
        )
        self._in.bind(("", self._address[1]))
        # A network of this host alone is reached over the loopback interface where there is no route.
        self._local = int(settings.get("ttl", 0)) == 0
        interfaces = ("0.0.0.0", "127.0.0.1") if self._local else ("0.0.0.0",)
        troubles = [trouble for trouble in map(self._join, interfaces) if trouble]
        if len(troubles) == len(interfaces):
            number, what = troubles[0]
            raise OSError(number, f"{what}: no route to {self._address[0]}; tether doctor --lcm-url '{self.url}' says more")
        self._in.setblocking(False)

    def _join(self, interface):
        """None, or why the group cannot be joined there: number and text, because an exception would keep its callers
        alive."""
        member = socket.inet_aton(self._address[0]) + socket.inet_aton(interface)
        try:
            self._in.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError as error:
            return error.errno, error.strerror
        return None

    def close(self):
        self._in.close()
        self._out.close()

    def publish(self, channel, data):
        number = self._sent & 0xFFFFFFFF
        self._sent += 1
        name = channel.encode() + b"\0"
        if len(name) + len(data) <= _LARGEST:
            self._send(_WHOLE + struct.pack(">I", number) + name + data)
            return
        first = _LARGEST - len(name)
        cuts = [0, *range(first, len(data), _LARGEST), len(data)]
        for i, (begin, end) in enumerate(zip(cuts, cuts[1:])):
            head = struct.pack(">IIIHH", number, len(data), begin, i, len(cuts) - 1)
            self._send(_PART + head + (b"" if i else name) + data[begin:end])

    def _send(self, datagram):
        try:
            self._out.sendto(datagram, self._address)
        except OSError as error:
            if not self._local or error.errno not in (errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN):
                raise
            self._out.setsockopt(
                socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1")
            )
            self._out.sendto(datagram, self._address)

    def receive(self, seconds):
        """The next message as (channel, bytes); None if none comes in this time (None: for ever)."""
        if not select.select([self._in], [], [], seconds)[0]:
            return None
        try:
            datagram, sender = self._in.recvfrom(1 << 16)
        except BlockingIOError:
            return None
        if datagram[:4] == _WHOLE:
            name, zero, data = datagram[8:].partition(b"\0")
            return (name.decode(errors="replace"), data) if zero else None
        return self._part(sender, datagram) if datagram[:4] == _PART and len(datagram) > 20 else None

    def _part(self, sender, datagram):
        number, size, begin, i, count = struct.unpack_from(">IIIHH", datagram, 4)
        key = (sender, number)
        if key not in self._unfinished:
            if len(self._unfinished) >= _MOST_UNFINISHED:
                del self._unfinished[next(iter(self._unfinished))]
            self._unfinished[key] = {}
        parts = self._unfinished[key]
        parts[i] = datagram[20:]
        if len(parts) < count:
            return None
        del self._unfinished[key]
        name, _, data = b"".join(parts.get(j, b"") for j in range(count)).partition(b"\0")
        return (name.decode(errors="replace"), data) if len(data) == size else None
