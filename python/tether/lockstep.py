"""A controller as the node "controller" of a run in simulated time (docs/reference/time.md)."""

import collections
import hashlib
import heapq
import itertools
import pathlib
import re
import time
import traceback

from .messages import message_type

_JOIN, _GRANT, _REQUEST, _RESEND, _WELCOME = (
    message_type(f"time_{name}_t") for name in ("join", "grant", "request", "resend", "welcome")
)
_HERE = pathlib.Path(__file__).parent
_NEVER = (1 << 63) - 1
_RUN, _LEAVE = _GRANT.constants["RUN"], _GRANT.constants["LEAVE"]
_DELIVERY, _NODE = 1 << 56, 2 << 56  # priorities in an event's order
_RANK = 2  # sim, netem, controller: what is scheduled before the run has it as its grant
_KEPT = 1000  # messages, to send again or until a grant names them
_REPEAT_S, _PATIENCE_S, _COORDINATOR_PATIENCE_S = 0.05, 5.0, 30.0


class LockstepError(Exception):
    pass


def _keyed_hash(data, key):
    return hashlib.blake2b(data, digest_size=16, key=key).hexdigest()


def _mac(kind, message, key):
    """Digest of a grant or an answer: of all but its seq, which differs between copies, and the mac."""
    return _keyed_hash(kind.encode(**message | {"seq": 0, "mac": ""}), key)


def _where(failure):
    """The last line of the law that it came from; nothing if it is not in the law."""
    lines = traceback.extract_tb(failure.__traceback__)
    of_laws = [f" ({at.filename}:{at.lineno})" for at in lines if pathlib.Path(at.filename).parent != _HERE]
    return of_laws[-1] if of_laws else ""


class Lockstep:
    """Joins one run and takes part until it is over. `send(channel, bytes)` publishes."""

    instances = itertools.count(time.time_ns())

    def __init__(self, send, controller):
        self._send = send
        self._controller = controller
        self._instance = next(self.instances)
        self.session = 0
        self._seq = 0
        self._events = []  # heap of (ns, order, grant's channel and bytes, or None: the timer)
        if controller.period_ns:
            heapq.heappush(self._events, (0, _NODE | _RANK << 24, None))
        self._inbox = collections.deque(maxlen=_KEPT)  # (channel, bytes) that no grant has named yet
        self._grant = None  # the grant that waits for its messages: [grant, bytes or None of each]
        self._granted_at = self._asked_at = self._joined_at = 0.0
        self.heard_at = None  # time of the coordinator's last message
        self._answer = (0, b"")  # to which grant
        self._numbers = collections.Counter()
        self._sent = collections.OrderedDict()  # (channel, number): bytes
        self.over = False
        self.superseded = False  # another run is on this network
        self._heard = None  # channels that have a receiver
        self._run_key = self._key = b""  # key of digests; key of this node's grants and answers

    def _say(self, on, kind, /, **fields):
        data = kind.encode(seq=self._seq, **fields)
        self._seq += 1
        self._send(on, data)
        return data

    def _next(self):
        ns, order = self._events[0][:2] if self._events else (_NEVER, _NEVER)
        return {"next_ns": ns, "next_order": order}

    def tick(self):
        """Regularly, every 50 ms or so: repeats what may have been lost. Raises LockstepError."""
        now = time.monotonic()
        if self.heard_at is not None and now - self.heard_at > _COORDINATOR_PATIENCE_S:
            raise LockstepError(f"the coordinator has been silent for {_COORDINATOR_PATIENCE_S:.0f} s")
        if not self.session and now - self._joined_at >= 2 * _REPEAT_S:
            self.join()
        if not self._grant or now - self._asked_at < _REPEAT_S:
            return
        grant, have = self._grant
        if now - self._granted_at > _PATIENCE_S:
            i = have.index(None)
            what = f"message {grant.number[i]} of {grant.publisher[i]} on {grant.channel[i]}"
            raise LockstepError(f"{what} has not come within {_PATIENCE_S:.0f} s")
        self._asked_at = now
        for i, data in enumerate(have):
            if data is None:
                what = {"channel": grant.channel[i], "number": grant.number[i]}
                what |= {"publisher": grant.publisher[i], "session": self.session}
                self._say("TIME/RESEND", _RESEND, **what)

    def join(self):
        self._joined_at = time.monotonic()
        me = {"session": _JOIN.constants["ANY"], "instance": self._instance, "node": "controller"}
        wanted = [re.escape(self._controller.pose_channel)]
        self._say("TIME/JOIN", _JOIN, **me, **self._next(), count=1, subscription=wanted)

    def hear(self, channel, data):
        """Whatever comes on the network."""
        if channel == self._controller.pose_channel:
            self._inbox.append((channel, data))
        elif channel == "TIME/WELCOME":
            self._on_welcome(_WELCOME.decode(data))
        elif channel == "TIME/GRANT":
            self._on_grant(_GRANT.decode(data))
        elif channel == "TIME/RESEND":
            again = _RESEND.decode(data)
            if again and (again.session, again.publisher) == (self.session, "controller"):
                sent = self._sent.get((again.channel, again.number))
                if sent:
                    self._send(again.channel, sent)
        if self._grant:
            self._carry_out()

    def _on_welcome(self, welcome):
        if welcome is None:
            return
        if self.session in (0, welcome.session):
            self.heard_at = time.monotonic()
        else:
            self.superseded = True
        if not self.session and welcome.node == "controller" and welcome.instance == self._instance:
            try:
                self._run_key, self._key = bytes.fromhex(welcome.run_key), bytes.fromhex(welcome.node_key)
            except ValueError:
                return
            self.session = welcome.session
            self._heard = [re.compile(expression) for expression in welcome.subscription]
        elif not self.session and not welcome.node:  # a coordinator waits
            self.join()

    def _on_grant(self, grant):
        if grant is None or grant.node != "controller" or not self.session:
            return
        if grant.session != self.session or grant.mac != _mac(_GRANT, vars(grant), self._key):
            return
        self.heard_at = time.monotonic()
        if grant.id == self._answer[0]:  # the answer was lost
            self._send("TIME/REQUEST", self._answer[1])
        elif grant.id > self._answer[0] and not self._grant:
            self.over = grant.kind == _LEAVE
            if not self.over:
                self._grant = [grant, [None] * grant.count]
                self._granted_at = self._asked_at = time.monotonic()

    def _carry_out(self):
        """Once all of the grant's messages are there: its events up to its bound, and the answer."""
        grant, have = self._grant
        for i in range(grant.count):
            for kept in self._inbox if have[i] is None else ():
                name, data = kept
                if name == grant.channel[i] and len(data) == grant.size[i]:
                    if _keyed_hash(data, self._run_key) == grant.digest[i]:
                        have[i] = data
                        self._inbox.remove(kept)
                        break
        if None in have:
            return
        self._grant = None
        for i, data in enumerate(have):
            heapq.heappush(self._events, (grant.time_ns[i], grant.order[i], data))
        published, error = [], ""
        if grant.kind == _RUN:
            try:
                self._run(grant, published)
            except Exception as failure:
                error = f"{type(failure).__name__}: {failure}{_where(failure)}"
                raise
            finally:
                self._reply(grant, published, error)
        else:
            self._reply(grant, published, error)

    def _run(self, grant, published):
        bound = (grant.until_ns, grant.until_order, grant.until_rank)
        index = 0  # index of publications and tasks under this grant
        while self._events and (*self._events[0][:2], _RANK) < bound:
            ns, _, data = heapq.heappop(self._events)
            if data is None:
                messages = self._controller.on_timer(ns / 1e9)
            else:
                messages = self._controller.on_pose(ns / 1e9, data)
            for channel, sent in messages:
                self._numbers[channel] += 1
                number = self._numbers[channel]
                self._sent[channel, number] = sent
                if len(self._sent) > _KEPT:
                    self._sent.popitem(last=False)
                self._send(channel, sent)
                published.append((channel, number, ns, index, len(sent), _keyed_hash(sent, self._run_key)))
                if any(expression.fullmatch(channel) for expression in self._heard):
                    bound = min(bound, (ns, _DELIVERY | grant.id << 24 | index, -1))
                index += 1
            if data is None:  # same order as in TimerQueue: after the tick's consequences
                order = _NODE | grant.id << 24 | index
                heapq.heappush(self._events, (ns + self._controller.period_ns, order, None))
                index += 1

    def _reply(self, grant, published, error):
        names = ("channel", "number", "time_ns", "index", "size", "digest")
        columns = dict(zip(names, zip(*published))) if published else {}
        me = {"session": self.session, "instance": self._instance, "node": "controller"}
        answer = {"grant": grant.id, "grant_mac": grant.mac, "error": error, "count": len(published)}
        answer |= me | self._next() | columns
        data = self._say("TIME/REQUEST", _REQUEST, **answer, mac=_mac(_REQUEST, answer, self._key))
        self._answer = (grant.id, data)
