"""The same law in simulated time, live, and in a run that Python starts itself."""

import argparse
import contextlib
import json
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import weakref

from .controller import Controller
from .lockstep import Lockstep, LockstepError
from .messages import message_type
from .network import DEFAULT_URL, Network
from .path import Path, in_toml, program
from .results import Run

_CLOCK, _POSE, _PRESENCE = (message_type(name) for name in ("clock_t", "pose_t", "presence_t"))
_TICK_S = 0.05


class RunFailed(Exception):
    """Failure of `tether run`, with its output."""


class RunClock:
    """The time of a live run, from SIM/CLOCK or, where that is not heard, from poses."""

    def __init__(self):
        self._t_s = self._heard_s = None
        self._rate = 1.0
        self._by_clock = False

    def hear(self, channel, data, now_s):
        clock = _CLOCK.decode(data) if channel == "SIM/CLOCK" else None
        if clock:
            self._t_s, self._heard_s, self._rate = clock.utime / 1e6, now_s, clock.rate or 1.0
            self._by_clock = True
        elif not self._by_clock and channel.endswith("/POSE"):
            pose = _POSE.decode(data)
            if pose and (self._t_s is None or pose.utime / 1e6 > self.now(now_s)):
                self._t_s, self._heard_s = pose.utime / 1e6, now_s

    def now(self, now_s):
        """None before anything was heard."""
        return None if self._t_s is None else self._t_s + self._rate * (now_s - self._heard_s)


def _live(network, controller, first):
    """For ever: poses and ticks as they come."""
    clock = RunClock()
    period_s = controller.period_ns / 1e9
    due_s = None  # the next tick
    heard = first
    while True:
        now_s = time.monotonic()
        t_s = clock.now(now_s)
        if heard:
            clock.hear(*heard, now_s)
            t_s = clock.now(now_s)
            if heard[0] == controller.pose_channel and t_s is not None:
                for channel, data in controller.on_pose(t_s, heard[1]):
                    network.publish(channel, data)
        wait_s = None
        if period_s and t_s is not None:
            if due_s is None or t_s < due_s - 2.0 * period_s:  # another run
                due_s = max(0.0, (t_s // period_s + 1.0) * period_s)
            if t_s >= due_s:
                for channel, data in controller.on_timer(t_s):
                    network.publish(channel, data)
                due_s = max(due_s + period_s, t_s // period_s * period_s)
            wait_s = max(0.0, (due_s - t_s) / clock._rate)
        heard = network.receive(wait_s)


def _in_lockstep(network, node, warm=False, alive=lambda: True):
    """Until the run is over. Returns what was heard first, if that is of a live run: then it is one."""
    node.join()
    while not node.over and alive():
        heard = network.receive(_TICK_S)
        if heard:
            channel, data = heard
            if not warm and not node.session and (_PRESENCE.decode(data) or _POSE.decode(data)):
                return heard
            node.hear(channel, data)
        node.tick()
        if warm and node.superseded:
            return None
    return None


def main(law, rate_hz=0.0, scenario=None, settings=None, vehicle="AGV"):
    """A controller as a program: in simulated time or live, whichever run is on its network.

    `law`: a function (t, pose, path), or a class whose instances are such; each run has its own.
    `rate_hz`: the law is called so often, from t = 0 on; 0: for each pose. `scenario`, `settings`:
    whose path it gets, if the command line names none."""
    parser = argparse.ArgumentParser(description=(law.__doc__ or "A controller for Tether").strip())
    parser.add_argument("--url", "--lcm-url", default=DEFAULT_URL, help="the run's LCM network [%(default)s]")
    parser.add_argument("--scenario", default=scenario, help="whose path it is [%(default)s]")
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", type=_setting, help="as of the run"
    )
    parser.add_argument("--warm", action="store_true", help="serve one run after another")
    options = parser.parse_args()
    settings = dict(settings or {}) | dict(options.set)
    try:
        with contextlib.closing(Network(options.url)) as network:
            _serve(network, law, rate_hz, vehicle, settings, options)
    except (LockstepError, OSError, ValueError) as error:
        sys.exit(f"{pathlib.Path(sys.argv[0]).name}: {error}")
    except KeyboardInterrupt:
        sys.exit(130)


def _setting(text):
    key, is_one, value = text.partition("=")
    if not key or not is_one:
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE, not {text!r}")
    return key, value


def _serve(network, law, rate_hz, vehicle, settings, options):
    """One run, or with --warm one after another."""
    check = _check_of_plans(options.scenario, settings)

    def controller(path, session=1):
        return Controller(law, path, vehicle, rate_hz, session, check)

    while True:
        with _Lazy(options.scenario, settings) as path:
            node = Lockstep(network.publish, controller(path))
            live = _in_lockstep(network, node, options.warm)
            if live:
                _live(network, controller(path, time.time_ns()), live)
        if not options.warm:
            return


def _check_of_plans(file, settings, named=None):
    """Refuses a law's plans if the run's scenario, as far as it is known here, has a vehicle that follows
    none. `file` is read when the first plan comes; what it does not say is not known, nor what the vehicles
    of a fleet have otherwise."""

    def check(law):
        policy = settings.get("actuator.policy")
        with contextlib.suppress(OSError, ValueError, TypeError):  # there is none, or it cannot be read
            scenario = tomllib.loads(pathlib.Path(file).read_text())
            policy = None if "fleet" in scenario else policy or scenario.get("actuator", {}).get("policy")
        if policy and str(policy).strip("'\"") != "horizon":
            only = f'which the vehicle follows with actuator.policy = "horizon" only, not with {policy}'
            raise ValueError(f"{named or file}: {law} is a law that sends plans, {only}")

    return check


class _Lazy:
    """A path that is asked for when it is first used: a warm program begins before its next run's
    scenario is written."""

    def __init__(self, scenario, settings):
        self._what = (scenario, settings)
        self._path = None

    def at(self, t_s):
        if self._path is None:
            if not self._what[0]:
                raise ValueError("the law asks for its path: name the scenario (--scenario FILE)")
            self._path = Path(*self._what)
        return self._path.at(t_s)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self._path:
            self._path.close()


def _end(process):
    process.kill()
    process.wait()


def simulate(scenario, law, settings=None, rate_hz=0.0, out=None, seed=None, vehicle="AGV"):
    """Makes one run in simulated time with this law in this process; the same for the same seed.

        run = tether.simulate("scenarios/paper.toml", law, {"channel.prr": 0.45})
        run.summary["epsilon_m"], run.trajectory, run.table("CTRL/CMD_VEL")

    Returns the Run; its folder is `out`, or a temporary one that ends with it. Raises RunFailed,
    and what the law raises; then neither processes nor a temporary folder are left."""
    options = [f"--set={key}={in_toml(value)}" for key, value in (settings or {}).items()]
    options += [] if seed is None else [f"--seed={seed}"]
    url = f"udpm://239.255.76.67:{random.SystemRandom().randrange(20000, 30000)}?ttl=0"
    with contextlib.ExitStack() as kept, contextlib.ExitStack() as used:  # whatever is raised, nothing is left
        where = tempfile.mkdtemp() if out is None else str(out)
        if out is None:
            kept.callback(shutil.rmtree, where, ignore_errors=True)
        command = [program(), "run", str(scenario), f"--lcm-url={url}", f"--out={where}", "--json"]
        command += ["--set=controller.external=true", *options]
        network = used.enter_context(contextlib.closing(Network(url)))
        process = used.enter_context(
            subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        )
        used.callback(_end, process)
        path = used.enter_context(Path(scenario, settings))
        check = _check_of_plans(pathlib.Path(where) / "scenario.toml", {}, named=scenario)
        node = Lockstep(network.publish, Controller(law, path, vehicle, rate_hz, check_plans=check))
        _in_lockstep(network, node, alive=lambda: process.poll() is None)
        said, complaints = process.communicate(timeout=60)
        if process.returncode != 0:
            raise RunFailed(complaints.strip().splitlines()[-1] if complaints.strip() else "no word why")
        run = Run(where)
        run.summary = json.loads(said)
        weakref.finalize(run, kept.pop_all().close)
    return run
