"""For the process tests of the CAN drivetrain: tether-can-bridge and tether-can-drive on vcan0
without a simulator (the emulated drives turn wheels of their own), an operator, a controller that
sends twists, and the two-node drivetrain's process data as its file and CiA 402 describe them.

Nothing here uses the project's own codecs.
"""

import math
import threading
import time

import can

from can_support import DRIVE_FAULT, DRIVE_REQUEST, Candump, integer
from live_support import SOURCE, TWIST, Failure, check, wait_until

SCENARIO = SOURCE / "scenarios" / "hil_vcan.toml"
TWO_NODES = SOURCE / "drivetrains" / "two_node_cia402.toml"

REQUESTS = {"arm": 1, "disarm": 2, "estop": 3, "estop_release": 4, "reset": 5}
FAULTS = {"none": 0, "fault": 1, "reboot": 2, "silence": 3, "sdo_abort": 4, "safety_input": 7}

# The two-node drivetrain on a vehicle with wheels of 0.4 m radius, 1.2 m apart.
WHEEL_RADIUS_M = 0.4
TRACK_M = 1.2
UNITS_PER_REVOLUTION = 12000  # per second: 0.1 rpm of a motor geared 1:20
SIGNS = {1: 1, 2: -1}  # node 1: left; node 2: right, mounted the other way round
NODES = (1, 2)
MPS_PER_UNIT = 2 * math.pi * WHEEL_RADIUS_M / UNITS_PER_REVOLUTION
STANDING_MPS = 0.005
COUPLING_MS = 20  # between messages of SIM/WHEELS

NMT, SYNC, BRIDGE_BEAT = 0x000, 0x080, 0x77F


def emcy(node):
    return 0x080 + node


def tpdo1(node):
    return 0x180 + node


def rpdo1(node):
    return 0x200 + node


def heartbeat(node):
    return 0x700 + node


def controlword(frame):
    return integer(frame.data, 0, 2, signed=False)


def target_mps(frame):
    """Rim speed, forward positive, that an RPDO1 asks for."""
    return SIGNS[frame.arbitration_id & 0x7F] * integer(frame.data, 2, 4) * MPS_PER_UNIT


def moves(frame):
    """Whether an RPDO1 lets its wheel turn: enabled, with a speed."""
    return controlword(frame) & 0x0F == 0x0F and integer(frame.data, 2, 4) != 0


DRIVE_STATES = (  # mask, value, of the statusword (CiA 402)
    (0x4F, 0x00, "not ready"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "operation enabled"),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction"),
    (0x4F, 0x08, "fault"),
)


def drive_state(frame):
    """State of the drive in a TPDO1."""
    word = integer(frame.data, 0, 2, signed=False)
    return next(name for mask, value, name in DRIVE_STATES if word & mask == value)


def rim_speeds(m):
    """Rim speeds in a SIM/WHEELS message: left, right, in m/s."""
    return (m.left_speed_radps * WHEEL_RADIUS_M, m.right_speed_radps * WHEEL_RADIUS_M)


def wheel_speeds(v_mps, omega_radps):
    """Rim speeds of left and right wheel for a twist of the axle's midpoint."""
    return (v_mps - omega_radps * TRACK_M / 2, v_mps + omega_radps * TRACK_M / 2)


class Record:
    """All frames on vcan0 while it lasts, in a file of candump; python-can reads it afterwards.
    Cheaper than a CanBus: these tests may run on one slow CPU."""

    def __init__(self, test, name):
        self._candump = Candump(test, name)
        self._frames = []

    def stop(self):
        """From now on frames() has what was recorded; the file."""
        path = self._candump.stop()
        self._frames = [f for f in can.CanutilsLogReader(path) if not f.is_extended_id]
        return path

    def frames(self, *identifiers, since=0.0, until=math.inf):
        return [
            f
            for f in self._frames
            if since < f.timestamp < until
            and (not identifiers or f.arbitration_id in identifiers)
        ]


def steps(values):
    """Without repetitions in a row."""
    values = list(values)
    return [v for i, v in enumerate(values) if i == 0 or v != values[i - 1]]


def changed_file(test, name, source, *changes):
    """A copy of a file in the test's folder with each (old, new) replaced wherever it occurs."""
    text = source.read_text()
    for old, new in changes:
        check(old in text, f"{source.name} has no {old!r}")
        text = text.replace(old, new)
    path = test.work / name
    path.write_text(text)
    return path


def patient_file(test):
    """The two-node drivetrain with longer deadlines: for tests that start programs, or pass frames
    on, while wheels turn, and so make a slow machine late."""
    return changed_file(
        test,
        "patient.toml",
        TWO_NODES,
        ("event_timer_ms = 100", "event_timer_ms = 400"),
        ("feedback_timeout_ms = 100", "feedback_timeout_ms = 400"),
        ("heartbeat_timeout_ms = 300", "heartbeat_timeout_ms = 900"),
        ("timeout_ms = 250", "timeout_ms = 600"),
    )


class Drivetrain:
    """The programs are started one by one; commands are sent from hold() on."""

    PERIOD_S = 0.04
    settings = ()  # settings of the scenario, such as "can.max_speed_mps=2"

    def __init__(self, test, drivetrain=TWO_NODES):
        self.test = test
        self.network = test.network
        self.drivetrain = drivetrain
        self.start_utime = int(time.time() * 1e6)
        self.sent = []  # commands: when, v, omega
        self._seqs = {}
        self._command = None
        self._closed = False
        self._thread = threading.Thread(target=self._control, daemon=True)
        self._thread.start()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._closed = True
        self._thread.join()

    def _start(self, program, *settings):
        settings = (
            f"can.drivetrain={self.drivetrain}",
            "can.wheels=model",
            f"can.coupling_ms={COUPLING_MS}",
            *self.settings,
            *settings,
        )
        options = (part for setting in settings for part in ("--set", setting))
        return self.test.start(program, SCENARIO, *options, "--start-utime", self.start_utime)

    def start_drives(self):
        since = time.time()
        self.drives = self._start("tether-can-drive")
        self.wait_for("SIM/WHEELS", lambda m: True, 10, "drives run", since)
        return self.drives

    def start_bridge(self, wait=True):
        since = time.time()
        self.bridge = self._start("tether-can-bridge")
        if wait:
            self.wait_for("CAN/STATE", lambda m: True, 10, "bridge runs", since)
        return self.bridge

    def bring_up(self, speed_mps=None):
        """Until armed; with a speed, until both wheels have it."""
        self.start_drives()
        self.start_bridge()
        self.arm()
        if speed_mps is not None:
            self.drive(speed_mps)

    # --- controller

    def _control(self):
        due = time.monotonic()
        while not self._closed:
            due = max(due + self.PERIOD_S, time.monotonic())
            time.sleep(max(0.0, due - time.monotonic()))
            if (command := self._command) is not None:
                self.sent.append((time.time(), *command))
                v_mps, omega_radps = command
                twist = {"pose_utime": -1, "v_mps": v_mps, "omega_radps": omega_radps}
                self._send("AGV/CMD_VEL", TWIST, **twist)

    def hold(self, v_mps, omega_radps=0.0):
        """Sends this twist at 25 Hz from now on."""
        self._command = (v_mps, omega_radps)

    def hush(self):
        """Sends none any more; when the last one was sent."""
        self._command = None
        time.sleep(2 * self.PERIOD_S)
        return self.sent[-1][0]

    # --- operator

    def _send(self, channel, lcm_type, **values):
        seq = self._seqs[channel] = self._seqs.get(channel, -1) + 1
        utime = int(time.time() * 1e6) - self.start_utime
        if lcm_type is not DRIVE_FAULT:
            values = {"run": self.start_utime} | values
        self.network.send(channel, lcm_type.encode(utime=utime, seq=seq, **values))

    def request(self, name):
        """When it was sent."""
        now = time.time()
        self._send("CAN/REQUEST", DRIVE_REQUEST, request=REQUESTS[name])
        return now

    def inject(self, kind, node=0, value=0.0):
        now = time.time()
        self._send("CAN/INJECT", DRIVE_FAULT, node=node, kind=FAULTS[kind], value=value)
        return now

    def arm(self, seconds=15):
        """From whatever state leads there, with zero commands; they go on."""
        self.hold(0.0)
        self.wait_state("disarmed", seconds)
        self.wait_for("CAN/STATE", lambda m: 0 <= m.command_age_s < 0.1, 5, "zero commands arrive")
        self.request("arm")
        return self.wait_state("armed", 5)

    def drive(self, v_mps, omega_radps=0.0, seconds=10):
        """Commands a twist, until both wheels turn as it says."""
        self.hold(v_mps, omega_radps)
        wanted = wheel_speeds(v_mps, omega_radps)

        def reached(m):
            return all(abs(s - w) < 0.02 for s, w in zip(rim_speeds(m), wanted))

        self.wait_for("SIM/WHEELS", reached, seconds, f"wheels at {wanted} m/s")

    # --- what is heard

    def wait_for(self, channel, condition, seconds, what, since=None):
        """The first message from now (or since) on that fulfils the condition."""
        since = time.time() if since is None else since

        def found():
            return next((m for m in self.network.messages(channel, since) if condition(m)), None)

        return self._wait(seconds, found, what)

    def _wait(self, seconds, condition, what):
        try:
            return wait_until(seconds, condition, what)
        except Failure as failure:
            raise Failure(f"{failure}; {self.now()}") from None

    def wait_state(self, name, seconds=5, since=None, reason=""):
        """The first CAN/STATE message with this state, and this in its reason."""
        condition = lambda m: m.state_name == name and reason in m.reason  # noqa: E731
        return self.wait_for("CAN/STATE", condition, seconds, f"state {name} {reason!r}", since)

    def states(self, since):
        """Names of the states that followed each other."""
        return steps(m.state_name for m in self.network.messages("CAN/STATE", since))

    def state(self):
        return self.network.last("CAN/STATE")

    def counters(self, channel="CAN/COUNTERS"):
        """Present counters: they come once a second."""
        since = time.time()
        wait_until(3, lambda: self.network.last(channel, since), channel)
        return self.network.counters(channel)

    def now(self):
        last = self.state()
        if not last:
            return "no state yet"
        return f"{time.time() - last.arrival:.2f} s ago {last.state_name!r}: {last.reason}"

    def wait_standstill(self, since, seconds=5):
        """When both wheels came to rest after `since`: the first of a fifth of a second of
        messages that all say so."""

        def rest():
            still = None
            for m in self.network.messages("SIM/WHEELS", since):
                if any(abs(s) > STANDING_MPS for s in rim_speeds(m)):
                    still = None
                elif still is None:
                    still = m.arrival
                elif m.arrival - still > 0.2:
                    return still
            return None

        return self._wait(seconds, rest, "standstill")

    def check_still(self, since, what):
        """Neither wheel has turned since."""
        messages = self.network.messages("SIM/WHEELS", since)
        check(len(messages) > 5, f"{what}: only {len(messages)} messages on the wheels")
        moved = [m for m in messages if max(map(abs, rim_speeds(m))) > STANDING_MPS]
        check(not moved, f"{what}: wheels turned: {moved and rim_speeds(moved[0])}")

    def check_unimpressed(self, since, speed_mps, what):
        """It was armed and drove at this speed all the time."""
        check(self.states(since) == ["armed"], f"{what}: {self.states(since)}: {self.now()}")
        messages = self.network.messages("SIM/WHEELS", since)
        speeds = [s for m in messages for s in rim_speeds(m)]
        check(speeds, f"{what}: no messages on the wheels")
        told = f"wheels {min(speeds)} to {max(speeds)} m/s"
        check(all(abs(s - speed_mps) < 0.03 for s in speeds), f"{what}: {told}")

    def check_runs(self):
        check(self.bridge.running(), "the bridge has ended")
        check(self.drives.running(), "the drives have ended")
