"""A scenario's reference path, as Tether itself computes it: by its program, to the last bit."""

import contextlib
import csv
import math
import os
import pathlib
import shutil
import subprocess
import typing


class PathPoint(typing.NamedTuple):
    """Where the vehicle's controlled point should be, and how it should move there."""

    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float
    omega_radps: float


def program():
    """The program tether: $TETHER, in $PATH, or in the build folder of this source tree."""
    built = pathlib.Path(__file__).resolve().parents[2] / "build" / "release" / "bin" / "tether"
    found = os.environ.get("TETHER") or shutil.which("tether") or (str(built) if built.exists() else None)
    if not found:
        raise FileNotFoundError("no program tether in $PATH: install it, or set $TETHER to where it is")
    return found


class Path:
    """`path.at(t)` is where to be t seconds after the run's start. Points once asked for are kept."""

    def __init__(self, scenario, settings=None, vehicle=1):
        """`settings`: keys that override the scenario's, as {"path.speed_mps": 1.0}."""
        options = [f"--set={key}={in_toml(value)}" for key, value in (settings or {}).items()]
        command = [program(), "path", str(scenario), "--ask", f"--vehicle={vehicle}", *options]
        self._points = {}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        if not self._process.stdout.readline():  # the heading
            raise ValueError(self._process.communicate()[1].strip())

    def at(self, t_s):
        """ValueError for a time that is not finite."""
        t_s = float(t_s)
        if not math.isfinite(t_s):
            raise ValueError(f"path.at({t_s}): the time must be finite, in seconds")
        point = self._points.get(t_s)
        if point is None:
            self._process.stdin.write(f"{t_s!r}\n")
            self._process.stdin.flush()
            row = self._process.stdout.readline().split(",")
            if len(row) != 6:
                raise ValueError(self._process.stderr.read().strip())
            if len(self._points) >= 1 << 16:
                self._points.clear()
            point = self._points[t_s] = PathPoint(*map(float, row[1:]))
        return point

    def close(self):
        with contextlib.suppress(BrokenPipeError):  # it has ended, and what it was asked is still here
            self._process.stdin.close()
        self._process.stdout.close()
        self._process.stderr.close()
        self._process.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def in_toml(value):
    """Value in the form that --set takes."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(f'"{v}"' if isinstance(v, str) else in_toml(v) for v in value) + "]"
    return str(value)


def number_or_text(text):
    try:
        return float(text)
    except ValueError:
        return text


def read_csv(file):
    """Columns by name; a cell that is no number stays text."""
    with open(file, newline="") as rows:
        names, *cells = csv.reader(rows)
    return {name: [number_or_text(row[i]) for row in cells] for i, name in enumerate(names)}
