#!/usr/bin/env -S python3 -B
"""Commands and requests on LCM that are broken, old or wrong.
Usage: bad_command_test.py BIN_DIR"""

import math
import time

from can_drivetrain import Drivetrain, patient_file, rim_speeds
from can_support import DRIVE_REQUEST
from live_support import TWIST, check, main

SPEED_MPS = 0.5


class Controller(Drivetrain):
    """Its commands may be spoilt: spoil(fields) returns what is sent instead."""

    spoil = None
    settings = ("can.max_speed_mps=2",)

    def _send(self, channel, kind, **values):
        if kind is not TWIST or self.spoil is None:
            return super()._send(channel, kind, **values)
        seq = self._seqs[channel] = self._seqs[channel] + 1
        fields = {"utime": self.utime(), "seq": seq, "run": self.start_utime, "pose_utime": -1} | values
        for payload in self.spoil(fields):
            self.network.send(channel, payload)

    def utime(self):
        return int(time.time() * 1e6) - self.start_utime


def numbers(fields):
    for v, omega in ((math.nan, 0.0), (0.5, math.inf), (-math.inf, 0.0), (1e300, 0.0)):
        yield TWIST.encode(**fields | {"v_mps": v, "omega_radps": omega})


def last_before(d):
    """The command that was sent last, again and again."""
    frozen = []

    def again(fields):
        frozen.append(fields)
        yield TWIST.encode(**frozen[0])

    return again


def shifted(seconds):
    return lambda fields: [TWIST.encode(**fields | {"utime": fields["utime"] + int(seconds * 1e6)})]


def of_another_run(fields):
    yield TWIST.encode(**fields | {"run": fields["run"] - 60_000_000})


def truncated(fields):
    whole = TWIST.encode(**fields)
    yield from (whole[:length] for length in (0, 7, 8, 20, len(whole) - 1))
    yield whole + b"\0"
    yield bytes(8) + whole[8:]


def bad_commands(test):
    """None refreshes the command's age: as in silence, a ramp after 200 ms, disarmed after 500."""
    with Controller(test, patient_file(test)) as d:
        cases = {
            "no numbers": (numbers, "command.non_finite"),
            "the same again": (last_before(d), "command.duplicated"),
            "numbered below zero": (lambda f: [TWIST.encode(**f | {"seq": -1})], "command.invalid_seq"),
            "clock 1 h ahead": (shifted(3600), "command.from_future"),
            "clock 1 h behind": (shifted(-3600), "command.before_start"),
            "clock 1 s behind": (shifted(-1), "command.time_backwards"),
            "of another run": (of_another_run, "command.other_run"),
            "truncated": (truncated, "command.undecodable"),
        }
        d.bring_up()
        for what, (spoil, counter) in cases.items():
            d.drive(SPEED_MPS)
            before = d.counters()
            begin = time.time()
            d.spoil = spoil
            d.wait_state("disarmed", 5, begin, "the newest command was")
            left = d.wait_for("CAN/STATE", lambda m: m.state_name != "armed", 5, what, begin).arrival - begin
            stand = d.wait_standstill(begin) - begin
            test.say(f"{what}: disarmed after {left * 1e3:.0f} ms, wheels stand after {stand * 1e3:.0f} ms")
            check(0.4 < left < 0.9, f"{what}: disarmed after {left:.3f} s")
            check(stand < 1.2, f"{what}: wheels stood after {stand:.3f} s")
            fastest = max(max(map(abs, rim_speeds(m))) for m in d.network.messages("SIM/WHEELS", begin))
            check(fastest < SPEED_MPS + 0.03, f"{what}: a wheel reached {fastest} m/s")
            d.spoil = None
            after = d.counters()
            check(after[counter] > before[counter] + 3, f"{what}: {counter} did not rise")
            d.arm()
        d.check_runs()


def bad_commands_among_good_ones(test):
    """Change nothing. One beyond the limits is followed as far as the limits go."""
    with Controller(test, patient_file(test)) as d:
        d.settings += ("can.stale_ms=1000", "can.disarm_ms=2000")  # so many messages make this process late
        d.bring_up(SPEED_MPS)
        before = d.counters()

        def mixed(fields):
            yield from numbers(fields)
            yield from truncated(fields)
            yield TWIST.encode(**fields)
            yield TWIST.encode(**fields | {"v_mps": -1.0})  # the same number and time: a forgery
            yield from shifted(3600)(fields | {"v_mps": -1.0})
            yield from shifted(-2)(fields | {"v_mps": -1.0})

        since = time.time()
        d.spoil = mixed
        time.sleep(1.5)
        d.check_unimpressed(since, SPEED_MPS, "bad commands among good ones")
        d.spoil = None
        after = d.counters()
        for name in ("non_finite", "undecodable", "duplicated", "from_future", "reordered"):
            check(after[f"command.{name}"] > before[f"command.{name}"] + 10, f"command.{name} did not rise")

        since = time.time()
        d.hold(100.0)
        d.wait_for("CAN/STATE", lambda m: m.v_mps > 1.9, 10, "the limit", since)
        time.sleep(0.7)
        setpoints = [m.v_mps for m in d.network.messages("CAN/STATE", since)]
        check(max(setpoints) <= 2.0 + 1e-9, f"setpoint {max(setpoints)} m/s, limit 2")
        fastest = max(max(rim_speeds(m)) for m in d.network.messages("SIM/WHEELS", since))
        check(1.9 < fastest < 2.1, f"a wheel reached {fastest} m/s, limit 2")
        steepest = max(b - a for a, b in zip(setpoints, setpoints[1:])) / 0.02
        test.say(f"commanded 100 m/s: {max(setpoints)} m/s, steepest {steepest:.2f} m/s²")
        check(steepest < 3.0 + 0.1, f"accelerates with {steepest} m/s², limit 3")


def bad_requests(test):
    """An ARM that is old, early, repeated, broken or unknown is none; an old ESTOP is one."""
    with Controller(test, patient_file(test)) as d:
        d.start_drives()
        d.start_bridge()
        d.hold(0.0)
        d.wait_state("disarmed", 15)

        def send(offset_s=0.0, **values):
            fields = {"utime": d.utime() + int(offset_s * 1e6), "run": d.start_utime, "request": 1} | values
            payload = DRIVE_REQUEST.encode(**fields)
            d.network.send("CAN/REQUEST", payload)
            return payload

        before = d.counters()
        since = time.time()
        send(-1.5, seq=1)
        send(+1.5, seq=2)
        send(seq=-1)
        send(seq=3, run=d.start_utime - 60_000_000)
        for unknown in (0, 7, -1, 2**31 - 1):
            send(seq=3, request=unknown)
        whole = DRIVE_REQUEST.encode(utime=d.utime(), seq=4, request=1)
        for broken in (whole[:-1], whole + b"\0", bytes(8) + whole[8:], b""):
            d.network.send("CAN/REQUEST", broken)
        time.sleep(0.5)
        check(d.states(since) == ["disarmed"], f"bad requests: {d.states(since)}")
        after = d.counters()
        wanted = {"stale": 1, "from_future": 1, "invalid_seq": 1, "unknown": 4, "undecodable": 4, "other_run": 1}
        for name, count in wanted.items():
            risen = after[f"request.{name}"] - before[f"request.{name}"]
            check(risen == count, f"request.{name}: {risen}, not {count}")

        since = time.time()
        recorded = send(seq=5)
        d.wait_state("armed", 5, since)
        send(seq=6, request=2)
        since = time.time()
        d.wait_state("disarmed", 5, since)
        d.network.send("CAN/REQUEST", recorded)
        time.sleep(0.5)
        check("armed" not in d.states(since)[1:], f"a recorded ARM armed: {d.states(since)}")

        since = time.time()
        send(-30.0, seq=7, request=3)
        d.wait_state("estop", 5, since)


main(bad_commands, bad_commands_among_good_ones, bad_requests)
