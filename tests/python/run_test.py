#!/usr/bin/env -S python3 -B
"""The Python package against the programs: a law in Python gives the run that the same law in C++
gives, bit for bit; paths, runs and sweeps are read as they are. Usage: run_test.py BIN_DIR"""

import csv
import math
import os
import pathlib
import re
import sqlite3
import subprocess
import sys
import tempfile
import unittest
import unittest.mock

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BIN = pathlib.Path(sys.argv.pop(1)).resolve()
os.environ["TETHER"] = str(BIN / "tether")
sys.path.insert(0, str(SOURCE / "python"))
import tether
from folder import WithAFolder

PAPER = SOURCE / "scenarios" / "paper.toml"


def law(t, pose, path):
    """The paper's PID with P gains alone; hypot as C has it."""
    target = path.at(t + 2.0)
    dx, dy = target.x_m - pose.x_m, target.y_m - pose.y_m
    heading_error = math.remainder(math.atan2(dy, dx) - pose.yaw_rad, 2 * math.pi)
    return 0.495 * abs(complex(dx, dy)), 0.2925 * heading_error


def run_tether(*words):
    done = subprocess.run([BIN / "tether", *map(str, words)], capture_output=True, text=True)
    if done.returncode:
        raise AssertionError(f"tether {words}: {done.stderr}")
    return done.stdout


class Runs(WithAFolder):
    def expect_as_in_cpp(self, settings, timer=None):
        common = {"run.duration_s": 20, "sensor.rate_hz": 20, "channel.downlink.prr": 0.8} | settings
        ours = tether.simulate(PAPER, law, common, rate_hz=timer or 0.0)
        theirs = common | {"controller.v.d": 0, "controller.omega.d": 0, "controller.pose_timeout_s": 0}
        if timer:
            theirs |= {"controller.trigger": "timer", "controller.rate_hz": timer}
        run_tether("run", PAPER, "--out", self.work / "cpp", *[f"--set={k}={v}" for k, v in theirs.items()])
        channels = "SIM/TRUTH|CTRL/CMD_VEL|AGV/CMD_VEL"
        ours, theirs = list(ours.log(channels)), list(tether.read_run(self.work / "cpp").log(channels))
        self.assertGreater(len(theirs), 1000)
        self.assertEqual(ours, theirs)

    def test_by_poses(self):
        self.expect_as_in_cpp({"channel.delay_ms": 50, "channel.uplink.prr": 0.7})

    def test_by_a_timer_whose_ticks_meet_poses(self):
        self.expect_as_in_cpp({}, timer=20)
        self.expect_as_in_cpp({"channel.delay_ms": 0}, timer=40)

    def test_that_fail_say_why(self):
        with self.assertRaisesRegex(ValueError, "nonsense.toml"):
            tether.simulate("nonsense.toml", law)
        with self.assertRaisesRegex(ValueError, "channel.prr"):
            tether.simulate(PAPER, law, {"channel.prr": 2})
        with self.assertRaises(ZeroDivisionError):
            tether.simulate(PAPER, lambda t, pose, path: 1 / 0)


    def test_leave_nothing_whatever_the_law_raises(self):
        path = tether.Path(PAPER)  # another program's: stays
        self.addCleanup(path.close)
        before = children()
        folder = unittest.mock.patch.object(tempfile, "tempdir", str(self.work))
        folder.start()
        self.addCleanup(folder.stop)
        for error in (SystemExit(3), KeyboardInterrupt(), GeneratorExit(), ZeroDivisionError()):

            def fail(t, pose, path, error=error):
                self.assertGreater(len(children() - before), 0)
                path.at(t)
                raise error

            with self.assertRaises(type(error)):
                tether.simulate(PAPER, fail)
            self.assertEqual(children(), before, error)
            self.assertEqual(list(self.work.iterdir()), [], error)
        with self.assertRaises(ValueError):
            tether.simulate("nonsense.toml", law)
        self.assertEqual(list(self.work.iterdir()), [])
        run = tether.simulate(PAPER, law, {"run.duration_s": 1})
        self.assertEqual([run.folder], list(self.work.iterdir()))
        self.assertGreater(len(run.trajectory["x_m"]), 10)
        del run
        self.assertEqual((children(), list(self.work.iterdir())), (before, []))

    def test_leave_the_folder_that_was_named(self):
        with self.assertRaises(ZeroDivisionError):
            tether.simulate(PAPER, lambda t, pose, path: 1 / 0, out=self.work / "mine")
        self.assertTrue((self.work / "mine" / "scenario.toml").exists())

    def test_refuse_plans_that_the_vehicle_would_not_follow(self):
        def planner(t, pose, path):
            return tether.Plan(t, 0.1, [1.0] * 20, [0.0] * 20)

        why = 'paper.toml: planner is a law that sends plans, which the vehicle follows with actuator.policy = "horizon" only'
        with self.assertRaisesRegex(ValueError, why):
            tether.simulate(PAPER, planner, {"run.duration_s": 5})
        run = tether.simulate(PAPER, planner, {"run.duration_s": 5, "actuator.policy": "horizon"})
        self.assertGreater(run.trajectory["x_m"][-1], 3.0)


def children():
    """Processes of this one."""
    return {int(pid) for task in pathlib.Path("/proc/self/task").iterdir() for pid in (task / "children").read_text().split()}


class Programs(WithAFolder):
    """Programs of laws, by tether.main."""

    def program(self, *words, returns="1.0, 0.0", before=()):
        (self.work / "mine.py").write_text(
            f"import tether\n\ndef law(t, pose, path):\n    return {returns}\n\ntether.main(law)\n"
        )
        command = [*before, sys.executable, "-B", self.work / "mine.py", *words]
        environment = os.environ | {"PYTHONPATH": str(SOURCE / "python")}
        return subprocess.run(command, capture_output=True, text=True, env=environment)

    def test_refuse_settings_that_are_none(self):
        for text in ("foo", "=1"):
            done = self.program("--set", text)
            self.assertEqual(done.returncode, 2)
            self.assertIn(f"mine.py: error: argument --set: must be KEY=VALUE, not '{text}'\n", done.stderr)

    def test_say_that_there_is_no_network(self):
        for words, why in (
            (["--url", "udp:nonsense"], "LCM URL: must be udpm://GROUP:PORT"),
            (["--url", "udpm://239.255.76.67:99999"], "LCM URL: must be udpm://GROUP:PORT"),
        ):
            done = self.program(*words)
            self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
            self.assertIn(f"mine.py: {why}", done.stderr)
        done = self.program(before=["unshare", "--net", *([] if os.getuid() == 0 else ["--user"])])
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
        self.assertRegex(done.stderr, r"^mine.py: .*no route to 239\.255\.76\.67; tether doctor")

    def run_with(self, returns, *words, more=""):
        self.program("--help", returns=returns)
        command = f"{sys.executable} -B {self.work}/mine.py --url {{url}} {more}"
        settings = ["--set", "run.duration_s=5", "--set", f'controller.command="{command}"']
        environment = os.environ | {"PYTHONPATH": str(SOURCE / "python")}
        done = subprocess.run([BIN / "tether", "run", PAPER, *settings, *words], capture_output=True, text=True, env=environment)
        return done.returncode, done.stderr

    def test_refuse_plans_where_the_scenario_is_known(self):
        plan = "tether.Plan(t, 0.1, [1.0] * 20, [0.0] * 20)"
        scenario = "--scenario {scenario}"
        code, said = self.run_with(plan, more=scenario)
        self.assertEqual(code, 1)
        self.assertRegex(said, r'toml: law is a law that sends plans, .*actuator.policy = "horizon" only, not with hold')
        self.assertEqual(self.run_with(plan, "--set", "actuator.policy=horizon", more=scenario), (0, ""))
        code, said = self.run_with(plan)  # it cannot know, the run does
        self.assertEqual(code, 1, said)
        self.assertIn('plans without actuator.policy = "horizon" (sim.plan.unasked)', said)
        as_of_the_run = f"--scenario {PAPER} --set actuator.policy=horizon"
        self.assertEqual(self.run_with(plan, "--set", "actuator.policy=horizon", more=as_of_the_run), (0, ""))

    def test_that_return_nonsense_end_the_run(self):
        code, said = self.run_with("float('nan'), 0.0")
        self.assertEqual(code, 1)
        self.assertIn("ValueError: law returned (nan, 0.0); a pair (v_mps, omega_radps) of finite numbers", said)


class Commands(WithAFolder):
    def test_are_started_by_tether_and_the_run_is_the_same_by_processes_or_not(self):
        (self.work / "law.py").write_text(
            "import tether\n\ndef law(t, pose, path):\n    target = path.at(t + 1.0)\n"
            "    return target.x_m - pose.x_m, target.y_m - pose.y_m\n\ntether.main(law)\n"
        )
        path = unittest.mock.patch.dict(os.environ, {"PYTHONPATH": str(SOURCE / "python")})
        path.start()
        self.addCleanup(path.stop)
        command = f'controller.command="{sys.executable} -B {self.work}/law.py --url {{url}} --scenario {{scenario}}"'
        settings = ["--set", "run.duration_s=5", "--set", "sensor.rate_hz=10", "--set", "channel.prr=0.8", "--set", command]
        for kind in ("", "--processes"):
            run_tether("run", PAPER, "--out", self.work / f"run{kind}", *settings, *([kind] if kind else []))
        logs = [(self.work / f"run{kind}" / "run.lcmlog").read_bytes() for kind in ("", "--processes")]
        self.assertGreater(logs[0].count(b"CTRL/CMD_VEL"), 20)
        self.assertEqual(logs[0], logs[1])

    def test_without_a_url_are_refused_at_once_where_only_the_run_knows_it(self):
        command = [BIN / "tether", "run", PAPER, "--set", "controller.command='echo Hello; exit 3'"]
        for kind in ([], ["--processes"]):
            done = subprocess.run([*command, *kind], capture_output=True, text=True)
            self.assertEqual(done.returncode, 2)
            self.assertRegex(done.stderr, "paper.toml: controller.command = .* must have {url} in it")
        network = ["--lcm-url", "udpm://239.255.76.67:7781?ttl=0"]
        done = subprocess.run([*command, *network], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn('ended with exit code 3, saying "Hello"', done.stderr)


class Paths(WithAFolder):
    def test_are_the_simulators_to_the_bit(self):
        for scenario in ("paper", "warehouse_lap", "factory"):
            file = SOURCE / "scenarios" / f"{scenario}.toml"
            out = self.work / scenario
            run_tether("run", file, "--out", out, "--set", "run.duration_s=10")
            truth = tether.read_run(out).table("SIM/TRUTH")
            self.assertGreater(len(truth["t_s"]), 100)
            with tether.Path(file) as path:
                points = [path.at(utime / 1e6) for utime in truth["utime"]]
            self.assertEqual([p.x_m for p in points], truth["x_ref_m"], scenario)
            self.assertEqual([p.y_m for p in points], truth["y_ref_m"], scenario)

    def test_take_other_settings(self):
        with tether.Path(PAPER, {"path.kind": "line", "path.speed_mps": 0.5, "path.length_m": 10}) as path:
            self.assertEqual(path.at(1e6), (10.0, 0.0, 0.0, 0.0, 0.0))
            self.assertEqual(path.at(5.0).v_mps, 0.5)


    def test_can_be_used_after_a_time_that_is_none(self):
        with tether.Path(PAPER) as path:
            for t_s in (math.nan, math.inf, -math.inf):
                with self.assertRaisesRegex(ValueError, rf"path.at\({t_s}\): the time must be finite, in seconds"):
                    path.at(t_s)
            self.assertLess(path.at(-1.0).x_m, 0.0)


class Sweeps(WithAFolder):
    def test_are_read_as_they_are_exported(self):
        file = self.work / "small.toml"
        file.write_text(
            f'scenario = "{PAPER}"\nseeds = 3\n[set]\nvehicle.plant = "kinematic"\nrun.duration_s = 5.0\n'
            "[grid]\nchannel.prr = [0.45, 1.0]\n[figure]\nkind = 'curve'\nx = 'channel.prr'\nmetric = 'epsilon_m'\n"
        )
        run_tether("sweep", file, "--out", self.work / "out")
        table = tether.read_sweep(self.work / "out")
        run_tether("sweep", "export", self.work / "out", "--out", self.work / "runs.csv")
        with open(self.work / "runs.csv") as file:
            exported = list(csv.DictReader(file))
        self.assertEqual(len(exported), 6)
        for row, text in zip(table.rows(), exported, strict=True):
            for name in ("channel.prr", "seed", "epsilon_m", "max_error_m"):
                self.assertEqual(float(row[name]), float(text[name]), name)

    def test_become_what_numpy_and_pandas_work_with(self):
        run_tether("run", PAPER, "--set", "run.duration_s=5", "--out", self.work / "run")
        ask = """import sys, tether
table = tether.read_run(sys.argv[1]).table("SIM/TRUTH")
numbers, frame = table.numpy()["x_m"], table.pandas()
assert str(numbers.dtype) == "float64" and list(numbers) == table["x_m"]
assert list(frame.columns) == list(table) and len(frame) == len(table["x_m"]) and frame["x_m"].max() == numbers.max()
print(len(frame))
"""
        environment = os.environ | {"PYTHONPATH": str(SOURCE / "python")}
        debians = ["/usr/bin/python3", "-B", "-c", ask, self.work / "run"]
        said = subprocess.run(debians, capture_output=True, text=True, env=environment)
        self.assertEqual(said.returncode, 0, said.stderr)
        self.assertGreater(int(said.stdout), 50)

    def test_that_are_not_there_are_named(self):
        wanted = "a sweep's folder, or its runs.sqlite, is wanted"
        with self.assertRaisesRegex(FileNotFoundError, f"nothing: {wanted}; this is nothing: there is no such"):
            tether.read_sweep(self.work / "nothing")

    def test_and_runs_and_logs_are_told_from_one_another(self):
        run, sweep, mine = (self.work / name for name in ("run", "sweep", "mine.py"))
        run_tether("run", PAPER, "--set", "run.duration_s=1", "--out", run)
        sweep.mkdir()
        sqlite3.connect(sweep / "runs.sqlite").execute("CREATE TABLE others (a)").connection.close()
        mine.write_text("import tether\n")
        of_run = "the folder of a run that is over, with summary.json, is wanted; this is"
        of_sweep = "a sweep's folder, or its runs.sqlite, is wanted; this is"
        for read, what, why in (
            (tether.read_run, sweep, rf"{of_run} the folder of a sweep \(tether.read_sweep\)"),
            (tether.read_run, self.work / "nothing", f"{of_run} nothing: there is no such file or folder"),
            (tether.read_run, run / "run.lcmlog", rf"{of_run} an LCM log \(tether.read_log\)"),
            (tether.read_run, self.work, f"{of_run} a folder of something else"),
            (tether.read_sweep, run, rf"{of_sweep} the folder of a run \(tether.read_run\)"),
            (tether.read_sweep, mine, f"{of_sweep} a file of something else: file is not a database"),
            (tether.read_sweep, sweep, f"{of_sweep} the folder of a sweep .*: no such table: arms"),
            (tether.read_log, run, r"an LCM log is wanted \(a run's is run.lcmlog\); this is the folder of a run"),
            (tether.read_log, sweep / "runs.sqlite", "no LCM log; it is an SQLite database"),
            (tether.read_log, mine, "no LCM log; it is a file of something else"),
        ):
            with self.assertRaisesRegex((ValueError, FileNotFoundError), f"^{what}: {why}"):
                list(read(what))


class Live(WithAFolder):
    COMMAND = f"controller.command='{sys.executable} {SOURCE}/examples/controller.py --url {{url}} --scenario {{scenario}}'"

    def live(self, command, *words):
        settings = ("--set", "run.duration_s=4", "--set", "sensor.rate_hz=10", "--set", command)
        command = [tether.path.program(), "live", PAPER, *settings, *words]
        environment = os.environ | {"PYTHONPATH": str(SOURCE / "python")}
        return subprocess.run(command, capture_output=True, text=True, env=environment)

    def test_runs_start_the_command(self):
        done = self.live(self.COMMAND, "--out", self.work / "live")
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        commands = tether.read_run(self.work / "live").table("CTRL/CMD_VEL")["v_mps"]
        self.assertGreater(len(commands), 30)
        self.assertGreater(max(commands), 0.1)

    def test_runs_end_with_the_command_and_say_how(self):
        done = self.live("controller.command='sleep 3; echo no more; exit 3'")
        self.assertEqual(done.returncode, 1, done.stdout + done.stderr)
        self.assertRegex(done.stderr, 'controller.command ended with exit code 3, saying "no more"')


def sources():
    return {file for file in (SOURCE / "python").rglob("*") if "__pycache__" not in file.parts}


class Installed(WithAFolder):
    def setUp(self):
        super().setUp()
        subprocess.run(["/usr/bin/python3", "-m", "venv", self.work / "venv"], check=True)
        self.pip("uninstall", "--yes", "setuptools")  # nor is anything else there to build with

    def pip(self, *words):
        command = [self.work / "venv/bin/pip", "--disable-pip-version-check", *words]
        done = subprocess.run(command, capture_output=True, text=True, cwd=self.work)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return done.stdout

    def installed(self):
        """Where it is, and the messages that it knows."""
        ask = "import tether; print(tether.__file__, *tether.message_types())"
        said = subprocess.run([self.work / "venv/bin/python", "-c", ask], cwd=self.work, capture_output=True, text=True)
        where, *names = said.stdout.split()
        return where, names

    def test_by_pip_without_a_network_and_setuptools(self):
        version = re.search(r"VERSION (\d+\.\d+\.\d+)", (SOURCE / "CMakeLists.txt").read_text())[1]
        before = sources()
        for isolated in ([], ["--no-build-isolation"]):
            self.pip("install", "--no-index", *isolated, SOURCE / "python")
            where, names = self.installed()
            self.assertEqual(len(names), len(list((SOURCE / "lcmtypes").glob("*.lcm"))))
            self.assertTrue(where.startswith(str(self.work / "venv")), where)
            self.assertIn(f"Version: {version}\n", self.pip("show", "--files", "tether"))
            self.pip("uninstall", "--yes", "tether")
            self.assertFalse(pathlib.Path(where).exists())
        self.assertEqual(sources(), before)  # nothing is left beside them

    def test_as_a_link_to_the_source_tree(self):
        self.pip("install", "--no-index", "--editable", SOURCE / "python")
        self.assertEqual(self.installed()[0], str(SOURCE / "python" / "tether" / "__init__.py"))

    def test_is_the_same_wheel_each_time(self):
        wheels = []
        for folder in ("a", "b"):
            self.pip("wheel", "--no-index", "--no-deps", "--wheel-dir", folder, SOURCE / "python")
            ((wheel,),) = [list((self.work / folder).iterdir())]
            wheels.append((wheel.name, wheel.read_bytes()))
        self.assertEqual(wheels[0], wheels[1])


if __name__ == "__main__":
    unittest.main()
