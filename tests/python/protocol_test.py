#!/usr/bin/env -S python3 -B
"""The Python package without network and programs: messages, the node in lockstep, logs."""

import decimal
import fractions
import hashlib
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import time
import types
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "python"))
import tether
from tether.run import RunClock

POSE, TWIST, PLAN = (tether.message_type(n) for n in ("pose_t", "twist_t", "plan_t"))
GRANT, REQUEST = tether.message_type("time_grant_t"), tether.message_type("time_request_t")
WELCOME, RESEND = tether.message_type("time_welcome_t"), tether.message_type("time_resend_t")
NEVER = (1 << 63) - 1
WANTED = "a pair (v_mps, omega_radps) of finite numbers, a tether.Plan or None is wanted"


RUN_KEY, NODE_KEY = bytes(range(32)), bytes(range(32, 64))


def keyed(data, key=RUN_KEY):
    return hashlib.blake2b(data, digest_size=16, key=key).hexdigest()


def mac_of(kind, values):
    return keyed(kind.encode(**values | {"seq": 0, "mac": ""}), NODE_KEY)


def pose(utime, seq, run=0):
    return POSE.encode(utime=utime, seq=seq, run=run, x_m=1.0)


class Messages(unittest.TestCase):
    def test_of_every_type_come_back_as_they_were_sent(self):
        for name, kind in tether.message_types().items():
            counts = {size for _, _, size in kind.fields if size and not size.isdigit()}
            fields = {}
            for i, (field, form, size) in enumerate(kind.fields):
                one = "text" if form == "string" else 1 if form == "boolean" else i + 1
                length = int(size) if size.isdigit() else 2
                fields[field] = [one] * length if size else 2 if field in counts else one
            data = kind.encode(**fields)
            self.assertEqual(tether.decode(data), (name, types.SimpleNamespace(**fields)))
            self.assertIsNone(kind.decode(data + b"\0"), name)
            for length in range(len(data)):
                self.assertIsNone(kind.decode(data[:length]), f"{name} cut to {length} bytes")

    def test_have_fields_that_are_known(self):
        with self.assertRaisesRegex(TypeError, "pose_t has no z_m"):
            POSE.encode(z_m=1.0)


class Node:
    """A node in lockstep, and all that it sends."""

    def __init__(self, law=lambda t, pose, path: (1.0, 0.0), rate_hz=0.0, heard=("AGV/CMD_VEL", "CTRL/CMD_VEL")):
        self.sent = []
        self.node = tether.Lockstep(lambda *what: self.sent.append(what), tether.Controller(law, rate_hz=rate_hz))
        self.node.join()
        join = tether.message_type("time_join_t").decode(self.sent.pop()[1])
        self.first = join.next_ns, join.next_order
        welcome = {"session": 7, "instance": join.instance, "node": "controller", "count": len(heard)}
        welcome |= {"run_key": RUN_KEY.hex(), "node_key": NODE_KEY.hex()}
        self.node.hear("TIME/WELCOME", WELCOME.encode(**welcome, subscription=list(heard)))

    def grant(self, number, messages=(), kind="RUN", until=(NEVER, NEVER, 99), **more):
        """`messages`: (ns, bytes). Returns the answer, if there is one, and the commands sent."""
        self.sent.clear()
        values = {"session": 7, "id": number, "node": "controller", "kind": GRANT.constants[kind]} | more
        values |= dict(zip(("until_ns", "until_order", "until_rank"), until))
        values |= {"count": len(messages), "publisher": ["netem"] * len(messages)}
        values |= {"channel": ["CTRL/POSE"] * len(messages), "number": list(range(1, len(messages) + 1))}
        values |= {"time_ns": [ns for ns, _ in messages], "order": [1 << 56 | i for i in range(len(messages))]}
        values |= {"size": [len(d) for _, d in messages], "digest": [keyed(d) for _, d in messages]}
        self.node.hear("TIME/GRANT", GRANT.encode(**{"mac": mac_of(GRANT, values)} | values))
        return self.answer(), self.commands()

    def answer(self):
        return next((REQUEST.decode(d) for channel, d in self.sent if channel == "TIME/REQUEST"), None)

    def commands(self):
        return [TWIST.decode(d) for channel, d in self.sent if channel == "CTRL/CMD_VEL"]


class Lockstep(unittest.TestCase):
    def test_answers_each_pose_with_a_command_of_its_time(self):
        node = Node(lambda t, pose, path: (t, pose.t_s))
        data = pose(400_000, 3)
        node.node.hear("CTRL/POSE", data)
        answer, commands = node.grant(20, [(500_000_000, data)])
        self.assertEqual([(c.utime, c.pose_utime, c.v_mps, c.omega_radps) for c in commands], [(500_000, 400_000, 0.5, 0.4)])
        self.assertEqual((answer.grant, answer.session, answer.next_ns), (20, 7, NEVER))
        self.assertEqual((answer.channel, answer.number, answer.time_ns, answer.index), (["CTRL/CMD_VEL"], [1], [500_000_000], [0]))
        sent = dict(node.sent)["CTRL/CMD_VEL"]
        self.assertEqual((answer.size, answer.digest), ([len(sent)], [keyed(sent)]))
        self.assertEqual(answer.mac, mac_of(REQUEST, vars(answer)))

    def test_answers_a_probe_at_once_and_acts_no_further(self):
        node = Node(rate_hz=10)
        self.assertEqual(node.first, (0, 2 << 56 | 2 << 24))
        answer, commands = node.grant(20, kind="PROBE")
        self.assertEqual((answer.grant, answer.count, commands), (20, 0, []))
        self.assertEqual((answer.next_ns, answer.next_order), node.first)

    def test_ticks_from_the_start_on_up_to_the_bound(self):
        times = []
        node = Node(lambda t, pose, path: times.append(t), rate_hz=10)
        node.node.hear("CTRL/POSE", pose(0, 0))
        answer, _ = node.grant(20, [(0, pose(0, 0))], until=(250_000_000, 0, 0))
        self.assertEqual(times, [0.0, 0.1, 0.2])
        self.assertEqual((answer.next_ns, answer.next_order), (300_000_000, 2 << 56 | 20 << 24 | 2))

    def test_takes_a_pose_before_the_tick_of_its_instant(self):
        seen = []
        node = Node(lambda t, pose, path: seen.append((t, pose.seq)), rate_hz=10)
        poses = [(0, pose(0, 0)), (100_000_000, pose(100_000, 1))]
        for _, data in poses:
            node.node.hear("CTRL/POSE", data)
        node.grant(20, poses, until=(100_000_000, 3 << 56, 0))
        self.assertEqual(seen, [(0.0, 0), (0.1, 1)])

    def test_stops_where_what_it_published_arrives(self):
        node = Node(rate_hz=10)
        node.node.hear("CTRL/POSE", pose(0, 0))
        answer, commands = node.grant(20, [(0, pose(0, 0))])
        self.assertEqual(len(commands), 1)
        self.assertEqual((answer.next_ns, answer.index), (100_000_000, [0]))
        deaf = Node(rate_hz=10, heard=["AGV/CMD_VEL"])
        deaf.node.hear("CTRL/POSE", pose(0, 0))
        answer, commands = deaf.grant(20, [(0, pose(0, 0))], until=(250_000_000, 0, 0))
        self.assertEqual((len(commands), answer.index), (3, [0, 2, 4]))  # the ticks between have numbers, too

    def test_repeats_an_answer_and_takes_no_notice_of_older_grants(self):
        node = Node()
        data = pose(0, 0)
        node.node.hear("CTRL/POSE", data)
        first, commands = node.grant(20, [(0, data)])
        self.assertEqual(len(commands), 1)
        again, commands = node.grant(20, [(0, data)])
        self.assertEqual((again, commands), (first, []))
        self.assertEqual(node.grant(19), (None, []))
        self.assertEqual(node.grant(21, session=8), (None, []))
        self.assertEqual(node.grant(21, node="sim"), (None, []))

    def test_takes_no_notice_of_a_grant_without_its_key(self):
        node = Node()
        data = pose(0, 0)
        node.node.hear("CTRL/POSE", data)
        self.assertEqual(node.grant(20, [(0, data)], mac=""), (None, []))
        self.assertEqual(node.grant(20, [(0, data)], mac="00" * 16), (None, []))
        answer, commands = node.grant(20, [(0, data)])
        self.assertEqual((answer.grant, len(commands)), (20, 1))

    def test_waits_for_a_lost_message_and_asks_for_it(self):
        node = Node()
        data = pose(0, 0)
        self.assertEqual(node.grant(20, [(0, data)]), (None, []))
        time.sleep(0.06)
        node.node.tick()
        asked = [RESEND.decode(d) for channel, d in node.sent if channel == "TIME/RESEND"]
        self.assertEqual([(a.publisher, a.channel, a.number) for a in asked], [("netem", "CTRL/POSE", 1)])
        node.node.hear("CTRL/POSE", pose(0, 1))  # another one
        self.assertIsNone(node.answer())
        node.node.hear("CTRL/POSE", data)
        self.assertEqual((node.answer().grant, len(node.commands())), (20, 1))

    def test_publishes_again_what_is_asked_for(self):
        node = Node()
        node.node.hear("CTRL/POSE", pose(0, 0))
        node.grant(20, [(0, pose(0, 0))])
        sent = dict(node.sent)["CTRL/CMD_VEL"]
        node.sent.clear()
        for number, publisher in ((2, "controller"), (1, "sim"), (1, "controller")):
            asked = {"session": 7, "publisher": publisher, "channel": "CTRL/CMD_VEL", "number": number}
            node.node.hear("TIME/RESEND", RESEND.encode(**asked))
        self.assertEqual(node.sent, [("CTRL/CMD_VEL", sent)])

    def test_says_what_a_law_fell_over(self):
        node = Node(lambda t, pose, path: 1 / 0)
        node.node.hear("CTRL/POSE", pose(0, 0))
        with self.assertRaises(ZeroDivisionError):
            node.grant(20, [(0, pose(0, 0))])
        self.assertRegex(node.answer().error, r"^ZeroDivisionError: division by zero \(.*protocol_test\.py:\d+\)$")

    def test_says_what_is_wrong_with_what_a_law_returned(self):
        node = Node(lambda t, pose, path: "ab")
        node.node.hear("CTRL/POSE", pose(0, 0))
        with self.assertRaises(ValueError):
            node.grant(20, [(0, pose(0, 0))])
        self.assertEqual(node.answer().error, f"ValueError: <lambda> returned 'ab'; {WANTED}")

    def test_knows_that_a_run_is_over_or_another_has_begun(self):
        node = Node()
        node.grant(20, kind="LEAVE")
        self.assertTrue(node.node.over)
        node = Node()
        self.assertFalse(node.node.superseded)
        node.node.hear("TIME/WELCOME", WELCOME.encode(session=8))
        self.assertTrue(node.node.superseded)


class TheController(unittest.TestCase):
    def test_takes_only_newer_poses_but_all_of_another_run(self):
        controller = tether.Controller(lambda t, pose, path: (1.0, 0.0))
        counts = [len(controller.on_pose(1.0, pose(*p))) for p in ((0, 5), (0, 5), (0, 4), (9, 6), (0, 0, 1), (-1, 9, 1))]
        self.assertEqual(counts, [1, 0, 0, 1, 1, 0])
        self.assertEqual(controller.on_pose(1.0, TWIST.encode()), [])

    def test_gives_each_run_a_law_of_its_own_where_the_law_is_a_class(self):
        class Counting:
            calls = 0

            def __call__(self, t, pose, path):
                self.calls += 1
                return float(self.calls), 0.0

        for _ in range(2):
            ((_, data),) = tether.Controller(Counting).on_pose(0.0, pose(0, 0))
            self.assertEqual(TWIST.decode(data).v_mps, 1.0)

    def test_sends_plans(self):
        controller = tether.Controller(lambda t, pose, path: tether.Plan(t, 0.05, [1.0, 2.0], [0.0, 0.5]), vehicle="AGV7")
        ((channel, data),) = controller.on_pose(2.0, pose(1_900_000, 0))
        plan = PLAN.decode(data)
        self.assertEqual(channel, "CTRL7/PLAN")
        self.assertEqual((plan.start_utime, plan.step_us, plan.count, plan.v_mps), (2_000_000, 50_000, 2, [1.0, 2.0]))
        self.assertEqual((plan.based_on, plan.pose_utime), (-2, 1_900_000))

    def test_calls_by_the_clock_only_once_there_is_a_pose(self):
        controller = tether.Controller(lambda t, pose, path: (1.0, 0.0), rate_hz=20)
        self.assertEqual(controller.on_timer(0.0), [])
        self.assertEqual(controller.on_pose(0.0, pose(0, 0)), [])
        self.assertEqual(len(controller.on_timer(0.05)), 1)


class WhatALawReturns(unittest.TestCase):
    def sent(self, decision, **more):
        def law(t, pose, path):
            return decision

        return tether.Controller(law, **more).on_pose(0.0, pose(0, 0))

    def test_is_a_pair_of_finite_numbers_a_plan_or_nothing(self):
        nan, inf = float("nan"), float("inf")
        for decision in ("ab", ("0.1", "0.2"), (10**400, 0.0), (10**5000, 0.0), 1.0, (nan, 0.0), (0.0, inf), (-inf, 0.0),
                         (1e9, 0.0), (1.0, 2.0, 3.0), (1.0,), (), (1.0, None), (1j, 0.0), {1.0: 2.0, 3.0: 4.0}, {1.0, 2.0}):
            with self.assertRaises(ValueError) as failure:
                self.sent(decision)
            self.assertRegex(str(failure.exception), "^law returned .{,60}; a pair")
            self.assertTrue(str(failure.exception).endswith(f"; {WANTED}"))
        self.assertEqual(self.sent(None), [])
        for decision in ((1, 0.5), [1.0, 0.5], (fractions.Fraction(1), decimal.Decimal("0.5"))):
            ((_, data),) = self.sent(decision)
            self.assertEqual((TWIST.decode(data).v_mps, TWIST.decode(data).omega_radps), (1.0, 0.5))

    def test_may_be_numpys(self):
        ask = """import numpy, tether
twist, plan = tether.message_type("twist_t"), tether.message_type("plan_t")
def sent(decision):
    ((_, data),) = tether.Controller(lambda t, pose, path: decision).on_pose(0.0, tether.message_type("pose_t").encode())
    return data
for decision in (numpy.array([1.0, 0.5]), (numpy.float32(1), numpy.float64(0.5)), numpy.array([[1, 2], [0.5, 2]])[:, 0]):
    assert sent(decision) == sent((1.0, 0.5))
assert plan.decode(sent(tether.Plan(0.0, 0.1, numpy.ones(3), numpy.zeros(3)))).v_mps == [1.0, 1.0, 1.0]
for decision in (numpy.ones(3), numpy.array([1.0, numpy.nan]), numpy.ones((2, 2)), numpy.float64(1.0)):
    try:
        sent(decision)
    except ValueError as error:
        print(error)
"""
        environment = os.environ | {"PYTHONPATH": str(pathlib.Path(__file__).resolve().parents[2] / "python")}
        debians = ["/usr/bin/python3", "-B", "-c", ask]
        said = subprocess.run(debians, capture_output=True, text=True, env=environment)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertEqual(said.stdout.count(f"; {WANTED}\n"), 4, said.stdout)

    def test_is_a_plan_that_a_vehicle_can_follow(self):
        nan = float("nan")
        for plan, why in (
            ((0.0, 0.0, [1], [0]), r"step_s = 0.0; 0.000001 to 600 seconds are wanted"),
            ((0.0, nan, [1], [0]), "step_s = nan"),
            ((0.0, 301.0, [1, 1], [0, 0]), r"step_s = 301.0; 0.000001 to 300 seconds"),
            ((nan, 0.1, [1], [0]), "start_s = nan; seconds of the run are wanted"),
            ((0.0, 0.1, [1, 2], [0]), "2 v_mps and 1 omega_radps; as many of both are wanted"),
            ((0.0, 0.1, [], []), r"v_mps = \[\]; 1 to 4000 finite numbers are wanted"),
            ((0.0, 0.1, [0] * 4001, [0] * 4001), "v_mps = .*; 1 to 4000"),
            ((0.0, 0.1, [1, nan], [0, 0]), r"v_mps = \[1, nan\]; 1 to 4000"),
            ((0.0, 0.1, [1], ["0"]), r"omega_radps = \['0'\]; 1 to 4000"),
            ((0.0, 0.1, 1.0, 0.0), "v_mps = 1.0; 1 to 4000"),
            ((0.0, 0.1, [1e39], [0]), r"v_mps = \[1e\+39\]; 1 to 4000"),
        ):
            with self.assertRaisesRegex(ValueError, f"^law returned a Plan with {why}"):
                self.sent(tether.Plan(*plan))

    def test_is_refused_under_the_name_of_a_class_that_is_the_law(self):
        class Mine:
            def __call__(self, t, pose, path):
                return 1.0

        for law in (Mine, Mine()):
            with self.assertRaisesRegex(ValueError, "^Mine returned 1.0; "):
                tether.Controller(law).on_pose(0.0, pose(0, 0))


class ALiveRunsClock(unittest.TestCase):
    def test_goes_by_the_simulators_and_in_slow_motion(self):
        clock = RunClock()
        self.assertIsNone(clock.now(100.0))
        clock.hear("CTRL/POSE", pose(2_000_000, 0), 100.0)
        self.assertEqual(clock.now(101.0), 3.0)
        data = tether.message_type("clock_t").encode(utime=5_000_000, rate=0.5)
        clock.hear("SIM/CLOCK", data, 102.0)
        clock.hear("CTRL/POSE", pose(9_000_000, 0), 102.0)
        self.assertEqual(clock.now(104.0), 6.0)


class Logs(unittest.TestCase):
    def record(self, number, channel, data):
        head = struct.pack(">IqqII", 0xEDA1DA01, number, 1_500_000 * number, len(channel), len(data))
        return head + channel.encode() + data

    def test_are_read_up_to_where_they_were_cut_off(self):
        log = self.record(0, "CTRL/POSE", pose(5, 0)) + self.record(1, "OTHER", b"what")
        log += self.record(2, "CTRL/POSE", pose(6, 1))
        with tempfile.TemporaryDirectory() as folder:
            file = pathlib.Path(folder) / "a.lcmlog"
            for cut, count in ((0, 3), (1, 2), (90, 2), (len(log), 0)):
                file.write_bytes(log[: len(log) - cut])
                self.assertEqual(len(list(tether.read_log(file))), count)
            file.write_bytes(log)
            self.assertEqual([(e.t_s, e.channel, e.type) for e in tether.read_log(file)],
                             [(0.0, "CTRL/POSE", "pose_t"), (1.5, "OTHER", ""), (3.0, "CTRL/POSE", "pose_t")])
            table = tether.log_table(file, "CTRL/POSE")
            self.assertEqual((table["t_s"], table["utime"], table.rows()[1]["seq"]), ([0.0, 3.0], [5, 6], 1))
            for other in (b"x" * 100, b"x", b"short text\n"):
                file.write_bytes(other)
                with self.assertRaisesRegex(ValueError, "a.lcmlog: no LCM log; it is a file of something else"):
                    list(tether.read_log(file))
            file.write_bytes(log + b"x")
            with self.assertRaisesRegex(ValueError, f"a.lcmlog: damaged at byte {len(log)}"):
                list(tether.read_log(file))


if __name__ == "__main__":
    unittest.main()
