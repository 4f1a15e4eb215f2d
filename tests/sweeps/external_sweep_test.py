#!/usr/bin/env -S python3 -B
"""Sweeps whose controller is an external program: the same results with any number of threads, cold
or warm, and with unknown senders on the network; what fails, hangs or lies is ended and named.
Usage: external_sweep_test.py BIN_DIR"""

import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BIN = pathlib.Path(sys.argv.pop(1)).resolve()
os.environ["TETHER"] = str(BIN / "tether")
os.environ["PYTHONPATH"] = str(SOURCE / "python")
sys.path.insert(0, str(SOURCE / "python"))
import tether

COMMAND = "cd . && A=b python3 -B law.py --url {url} --scenario {scenario}"
COLD = f'controller.command = "{COMMAND}"'
WARM = f'controller.command = "{COMMAND} --warm"\ncontroller.warm = true'
EXPERIMENT = """
scenario = "{scenario}"
seeds = {seeds}
[set]
vehicle.plant = "kinematic"
sensor.rate_hz = 5.0
run.duration_s = 8.0
{settings}
[grid]
channel.prr = [0.4, 0.7, 1.0]
[figure]
kind = "curve"
x = "channel.prr"
metric = "epsilon_m"
"""
# The paper's PID with P gains alone.
LAW = """
import math, os, pathlib, subprocess, sys, time, tomllib
import tether

def law(t, pose, path):
    target = path.at(t + 2.0)
    dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
    heading_error = math.remainder(math.atan2(dy, dx) - pose.yaw_rad, 2 * math.pi)
    return 0.495 * abs(complex(dx, dy)), 0.2925 * heading_error
"""
# Same code as in docs/howto/python.md.
SMOOTH = """
class Smooth:
    def __init__(self):
        self.v_mps = 0.0

    def __call__(self, t, pose, path):
        v_mps, omega_radps = law(t, pose, path)
        self.v_mps += 0.5 * (v_mps - self.v_mps)
        return self.v_mps, omega_radps

tether.main(Smooth)
"""
# Failures at 4 s, by seed.
FAILING = LAW + """
SCENARIO = sys.argv[sys.argv.index("--scenario") + 1]

class Failing:
    seed = None

    def __call__(self, t, pose, path):
        if self.seed is None:
            self.seed = tomllib.loads(pathlib.Path(SCENARIO).read_text())["run"]["seed"]
        if t >= 4.0 and self.seed == 2:
            raise KeyError("what")
        if t >= 4.0 and self.seed == 3:
            print("no more", flush=True)
            os._exit(3)
        if t >= 4.0 and self.seed == 4:
            child = subprocess.Popen(["sleep", "600"])
            pathlib.Path("pids").write_text(f"{os.getpid()} {child.pid}")
            time.sleep(600)
        if t >= 4.0 and self.seed == 5:
            tether.Lockstep._numbers_of_a_liar = True
        if t >= 4.0 and self.seed == 6:
            return math.nan, 0.0
        return law(t, pose, path)

def lie(self, grant, published, error, honest=tether.Lockstep._reply):
    if hasattr(tether.Lockstep, "_numbers_of_a_liar"):
        published = [(channel, number + 7, *rest) for channel, number, *rest in published]
    honest(self, grant, published, error)

tether.Lockstep._reply = lie
tether.main(Failing)
"""
# Killed at 4 s with seed 2, until there is a file "lives".
KILLED = LAW + """
import signal
SCENARIO = sys.argv[sys.argv.index("--scenario") + 1]

def killed(t, pose, path):
    if t >= 4.0 and not os.path.exists("lives"):
        if tomllib.loads(pathlib.Path(SCENARIO).read_text())["run"]["seed"] == 2:
            os.kill(os.getpid(), signal.SIGKILL)
    return law(t, pose, path)

tether.main(killed)
"""
SPOILT = LAW + """
def spoilt(self, grant, published, honest=tether.Lockstep._run):
    on_pose = self._controller.on_pose
    self._controller.on_pose = lambda *seen: [(channel, b"no command") for channel, _ in on_pose(*seen)]
    try:
        honest(self, grant, published)
    finally:
        self._controller.on_pose = on_pose

tether.Lockstep._run = spoilt
tether.main(law)
"""
REASONS = {
    2: "controller could not carry out grant .*KeyError: 'what'",
    3: "controller ended with exit code 3, saying \"no more\"; it owed the answer to grant",
    4: r"controller did not answer within 1\.0 s: it owes the answer to grant",
    5: "controller .*CTRL/CMD_VEL.*grant",
    6: r"controller could not carry out grant .*ValueError: Failing returned \(nan, 0\.0\); a pair .* is wanted$",
}


class Sweeps(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.work = pathlib.Path(folder.name)
        self.write_law(LAW + "\ntether.main(law)\n")

    def write_law(self, text):
        (self.work / "law.py").write_text(text)

    def experiment(self, name, settings=COLD, seeds=3):
        file = self.work / f"{name}.toml"
        scenario = SOURCE / "scenarios" / "paper.toml"
        file.write_text(EXPERIMENT.format(scenario=scenario, settings=settings, seeds=seeds))
        return file

    def tether(self, *words, code=0):
        done = subprocess.run([BIN / "tether", *map(str, words)], cwd=self.work, capture_output=True, text=True)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return done.stdout + done.stderr

    def controllers(self):
        """Processes of laws in this test's folder."""
        found = []
        for process in pathlib.Path("/proc").glob("[0-9]*"):
            try:
                if b"law.py" in (process / "cmdline").read_bytes() and os.readlink(process / "cwd") == str(self.work):
                    found.append(int(process.name))
            except OSError:  # it has ended
                pass
        return found

    def csv(self, out):
        self.tether("sweep", "export", out, "--out", f"{out}.csv")
        return (self.work / f"{out}.csv").read_bytes()

    def sweep(self, name, *options, **experiment):
        self.tether("sweep", self.experiment(name, **experiment), "--out", name, *options)
        return self.csv(name)

    def test_do_not_depend_on_threads_nor_on_warmth(self):
        one = self.sweep("one", "--jobs=1")
        self.assertEqual(len(one.splitlines()), 1 + 9)
        for name, options in (("two", {}), ("warm", {"settings": WARM})):
            for jobs in (1, 3):
                self.assertEqual(self.sweep(f"{name}{jobs}", f"--jobs={jobs}", **options), one, f"{name}, {jobs} threads")

    def test_do_not_depend_on_threads_where_a_warm_law_remembers_in_a_class(self):
        self.write_law(LAW + SMOOTH)
        one = self.sweep("smooth", settings=COLD)
        for jobs in (1, 2):
            self.assertEqual(self.sweep(f"smooth{jobs}", f"--jobs={jobs}", settings=WARM), one, f"{jobs} threads")

    def test_give_what_the_same_law_in_cpp_gives(self):
        self.sweep("python", settings=WARM)
        gains = "controller.v.d = 0.0\ncontroller.omega.d = 0.0\ncontroller.pose_timeout_s = 0.0"
        self.sweep("cpp", settings=gains)
        tables = [tether.read_sweep(self.work / name) for name in ("python", "cpp")]
        for metric in ("epsilon_m", "max_error_m", "uplink_sent", "late_s"):
            self.assertEqual(tables[0][metric], tables[1][metric], metric)

    def test_are_drawn(self):
        self.sweep("drawn", settings=WARM)
        self.tether("report", "drawn")
        for file in ("drawn.png", "drawn.svg", "report.html", "report.md"):
            self.assertGreater((self.work / "drawn" / file).stat().st_size, 500, file)

    def failures(self, name, settings):
        started = time.monotonic()
        file = self.experiment(name, settings + "\ncontroller.patience_s = 1.0", seeds=7)
        self.tether("sweep", file, "--out", name)
        self.assertLess(time.monotonic() - started, 60)
        for row in tether.read_sweep(self.work / name).rows():
            self.assertRegex(row["failure"] or "", REASONS.get(row["seed"], "^$"))
            self.assertEqual(row["epsilon_m"] is None, row["seed"] in REASONS)
        for pid in map(int, (self.work / "pids").read_text().split()):
            self.assertTrue(soon(lambda: not is_alive(pid)), f"{pid} is left")

    def test_name_what_fails_and_go_on(self):
        self.write_law(FAILING)
        self.failures("cold", COLD)
        self.failures("warm", WARM)

    def test_have_no_result_of_a_law_that_is_killed(self):
        """Killed like by the out-of-memory killer: it is tried again, at once and by the next sweep."""
        for name, settings in (("cold", COLD), ("warm", WARM)):
            (self.work / "lives").unlink(missing_ok=True)
            self.write_law(KILLED)
            file = self.experiment(name, settings)
            said = self.tether("sweep", file, "--out", name, code=1)
            self.assertEqual(said.count("no result: "), 3, said)
            self.assertRegex(said, r"no result: channel.prr = 0.4, seed 2: controller "
                                   r"(was killed by signal 9|ended with exit code 137)")
            self.assertIn("not complete; the same command goes on", said)
            table = tether.read_sweep(self.work / name)
            self.assertEqual(sorted(table["seed"]), [1, 1, 1, 3, 3, 3])
            self.assertEqual(table["failure"].count(None), 6)
            (self.work / "lives").touch()
            self.tether("sweep", file, "--out", name)
            self.write_law(LAW + "\ntether.main(law)\n")
            self.assertEqual(self.csv(name), self.sweep(f"{name}_undisturbed", settings=settings))

    def test_fail_where_the_vehicle_got_what_is_no_command(self):
        self.write_law(SPOILT)
        said = self.tether("sweep", self.experiment("spoilt", seeds=1), "--out", "spoilt", code=1)
        why = r"AGV got \d+ messages from the controller that are no commands to it: bytes that are no twist \(sim"
        self.assertRegex(said, why)
        command = COLD.replace(" = ", "=")
        self.assertRegex(self.tether("run", SOURCE / "scenarios" / "paper.toml", "--set", command, code=1), why)

    def test_name_a_command_that_never_joins(self):
        file = self.experiment("none", 'controller.command = "nonesuch {url} {seed} {arm}"', seeds=1)
        said = self.tether("sweep", file, "--out", "none", code=1)
        self.assertRegex(said, r"\nfailed    channel.prr = 0.4, seed 1: controller ended with exit code 127")
        for failure in tether.read_sweep(self.work / "none")["failure"]:
            self.assertRegex(failure, "controller ended with exit code 127, saying .*nonesuch: not found")

    def test_go_on_after_a_kill(self):
        whole = self.sweep("whole", settings=WARM, seeds=12)
        file = self.experiment("killed", settings=WARM, seeds=12)
        seen = 0
        for _ in range(20):
            sweep = subprocess.Popen([BIN / "tether", "sweep", file, "--out", "killed"], cwd=self.work,
                                     stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(0.6)
            seen += len(self.controllers())
            sweep.send_signal(signal.SIGKILL)
            if sweep.wait() != -signal.SIGKILL:
                break
        self.tether("sweep", file, "--out", "killed")
        self.assertEqual(self.csv("killed"), whole)
        self.assertGreater(seen, 0)
        self.assertTrue(soon(lambda: not self.controllers()), f"{self.controllers()} are left")

    def test_are_refused_with_another_program(self):
        self.sweep("again")
        self.write_law(LAW + "\n# another\ntether.main(law)\n")
        self.assertIn("inputs", self.tether("sweep", self.work / "again.toml", "--out", "again", code=2))

        command = "python3 -B 'l a/w.py' --url {url} --scenario {scenario}"
        (self.work / "l a").mkdir()
        (self.work / "l a" / "w.py").write_text(LAW + "\ntether.main(law)\n")
        self.sweep("quoted", settings=f'controller.command = "{command}"', seeds=1)
        (self.work / "l a" / "w.py").write_text(LAW + "\n# another\ntether.main(law)\n")
        self.assertIn("l a/w.py", self.tether("sweep", self.work / "quoted.toml", "--out", "quoted", code=2))

    def test_find_what_lies_beside_the_experiment(self):
        (self.work / "in here").mkdir()
        self.write_law(LAW + "\ntether.main(law)\n")
        (self.work / "law.py").rename(self.work / "in here" / "law.py")
        command = "python3 -B {folder}/law.py --url {url} --scenario {scenario}"
        file = self.experiment("beside", f'controller.command = "{command}"', seeds=1)
        file.rename(self.work / "in here" / "beside.toml")
        self.tether("sweep", "in here/beside.toml", "--out", "beside")
        self.assertEqual(tether.read_sweep(self.work / "beside")["failure"].count(None), 3)

    def test_ignore_unknown_senders_except_on_the_runs_channels(self):
        quiet = self.sweep("quiet", settings=WARM)
        self.write_law(LAW + "\npathlib.Path('url').write_text(sys.argv[2])\ntether.main(law)\n")
        over = threading.Event()
        sent = []

        def disturb(channels=()):
            network = None
            join, grant, twist = (tether.message_type(n) for n in ("time_join_t", "time_grant_t", "twist_t"))
            while not over.is_set():
                if network is None and (self.work / "url").exists():
                    network = tether.Network((self.work / "url").read_text())
                if network:
                    network.publish("TIME/JOIN", join.encode(node="sim", next_ns=0))
                    network.publish("TIME/JOIN", join.encode(node="camera"))
                    network.publish("TIME/GRANT", grant.encode(node="sim", id=99, kind=3))
                    network.publish("TIME/REQUEST", b"garbage")
                    network.publish("MY/NOTES", twist.encode(v_mps=7.0))
                    for channel in channels:
                        network.publish(channel, twist.encode(v_mps=7.0))
                    sent.append(5)
                time.sleep(0.01)
            if network:
                network.close()

        sender = threading.Thread(target=disturb)
        sender.start()
        try:
            disturbed = self.sweep("disturbed", "--jobs=1", settings=WARM)
        finally:
            over.set()
            sender.join()
        self.assertGreater(len(sent), 10)
        self.assertEqual(disturbed, quiet)

        over.clear()
        (self.work / "url").unlink()
        sender = threading.Thread(target=disturb, args=(("CTRL/CMD_VEL", "CTRL/POSE"),))
        sender.start()
        try:
            file = self.experiment("forged", settings=WARM, seeds=1)
            said = self.tether("sweep", file, "--out", "forged", "--jobs=1", code=1)
        finally:
            over.set()
            sender.join()
        self.assertRegex(said, r"no result: .*messages? on CTRL/(CMD_VEL|POSE) .* no node's: another program takes part")
        self.assertEqual(tether.read_sweep(self.work / "forged")["seed"], [])

    def test_refuse_what_cannot_be(self):
        for settings, why in (
            ('controller.command = "a {what}"', "controller.command: {what} must be {url}, {scenario}, {folder}, {seed}, {arm}"),
            ('controller.command = "a {seed}"\ncontroller.warm = true', "{seed} must be {url}, {scenario}, {folder} with controller.warm"),
            ('controller.command = "a {scenario}"', 'bad.toml: controller.command = "a {scenario}" must have {url} in it'),
            ("controller.external = true", "controller.external = true without controller.command"),
            ("controller.ros2 = true", "controller.ros2 = true needs ROS 2 nodes that run"),
            ("controller.warm = true", "there is no controller.command"),
            ("controller.patience_s = 3.0", "neither a controller.command nor controller.external"),
        ):
            self.assertIn(why, self.tether("sweep", self.experiment("bad", settings), code=2))


def is_alive(pid):
    try:
        return pathlib.Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] not in "ZX"
    except FileNotFoundError:
        return False


def soon(holds):
    """Whether it comes true: what is killed goes when a busy machine comes to it."""
    deadline = time.monotonic() + 10
    while not holds() and time.monotonic() < deadline:
        time.sleep(0.01)
    return holds()


if __name__ == "__main__":
    unittest.main()
