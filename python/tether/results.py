"""Output of runs and sweeps: logs, folders of runs, databases of sweeps.

A Table is a dict of columns; .rows() are its rows as dicts, .numpy() and .pandas() what these
libraries make of it, where they are installed.
"""

import contextlib
import json
import pathlib
import re
import sqlite3
import struct
import tomllib
import typing

from . import messages
from .path import number_or_text, read_csv


class Table(dict):
    """Columns by name, all of one length."""

    def rows(self):
        return [dict(zip(self, row)) for row in zip(*self.values())]

    def numpy(self):
        import numpy

        return {name: numpy.array(column) for name, column in self.items()}

    def pandas(self):
        import pandas

        return pandas.DataFrame(self)


class Logged(typing.NamedTuple):
    t_s: float  # when it was recorded: seconds of the run, or since 1970 in a log of lcm-logger
    channel: str
    type: str  # "pose_t"; "" if it is not one of Tether's
    message: object  # its fields; None if it is not one of Tether's


_SYNC = struct.pack(">I", 0xEDA1DA01)  # before each message of a log
_SQLITE = b"SQLite format 3\0"


def _looks_like(where):
    """For errors: what is there."""
    where = pathlib.Path(where)
    if where.is_dir():
        if (where / "runs.sqlite").exists():
            return "the folder of a sweep (tether.read_sweep)"
        if (where / "summary.json").exists():
            return "the folder of a run (tether.read_run)"
        is_run = (where / "run.lcmlog").exists()
        return "the folder of a run that is not over" if is_run else "a folder of something else"
    if not where.exists():
        return "nothing: there is no such file or folder"
    with open(where, "rb") as file:
        head = file.read(16)
    if head == _SQLITE:
        return "an SQLite database"
    return "an LCM log (tether.read_log)" if head.startswith(_SYNC) else "a file of something else"


def read_log(file, channels=".*"):
    """The messages of an LCM log, one after another, whose whole channel matches the expression.
    A last message that is cut off, by a program that was killed, is left out. ValueError for what is no
    LCM log, or damaged."""
    wanted = re.compile(channels)
    if pathlib.Path(file).is_dir():
        raise ValueError(f"{file}: an LCM log is wanted (a run's is run.lcmlog); this is {_looks_like(file)}")
    with open(file, "rb") as log:
        while head := log.read(28):
            if not head.startswith(_SYNC[: len(head)]):
                at = log.tell() - len(head)
                what = f"damaged at byte {at}" if at else f"no LCM log; it is {_looks_like(file)}"
                raise ValueError(f"{file}: {what}")
            if len(head) < 28:
                return
            _, stamp_us, name_size, size = struct.unpack(">qqII", head[4:])
            name, data = log.read(name_size), log.read(size)
            if len(name) + len(data) < name_size + size:
                return
            channel = name.decode(errors="replace")
            if wanted.fullmatch(channel):
                kind, message = messages.decode(data) or ("", None)
                yield Logged(stamp_us / 1e6, channel, kind, message)


def log_table(file, channel):
    """The messages of one channel as columns: t_s and the message's fields."""
    table = Table(t_s=[])
    for logged in read_log(file, re.escape(channel)):
        if logged.message is None:
            continue
        table["t_s"].append(logged.t_s)
        for name, value in vars(logged.message).items():
            table.setdefault(name, []).append(value)
    return table


class Run:
    """The folder of a run (tether run --out FOLDER)."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        why = self.folder / "incomplete.txt"
        if why.exists():
            raise ValueError(f"{folder}: the run is incomplete: {why.read_text().strip()}")
        if not (self.folder / "summary.json").exists():
            wanted = "the folder of a run that is over, with summary.json, is wanted"
            raise FileNotFoundError(f"{folder}: {wanted}; this is {_looks_like(folder)}")
        self.summary = json.loads((self.folder / "summary.json").read_text())
        self.scenario = tomllib.loads((self.folder / "scenario.toml").read_text())
        self.log_file = self.folder / "run.lcmlog"

    @property
    def trajectory(self):
        return Table(read_csv(self.folder / "trajectory.csv"))

    def log(self, channels=".*"):
        return read_log(self.log_file, channels)

    def table(self, channel):
        return log_table(self.log_file, channel)


def read_run(folder):
    return Run(folder)


def read_sweep(where):
    """The runs of a sweep (a folder or its runs.sqlite): arm, what the arm varies, seed, failure and
    the metrics. Metrics of a run that failed are None. Checksums of rows are verified by
    `tether sweep export`, not here."""
    file = pathlib.Path(where)
    file = file / "runs.sqlite" if file.is_dir() else file
    wanted = "a sweep's folder, or its runs.sqlite, is wanted"
    if not file.exists():
        raise FileNotFoundError(f"{where}: {wanted}; this is {_looks_like(where)}")
    try:
        with contextlib.closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as database:
            arms = {
                arm: {key: number_or_text(value) for key, value in json.loads(text)}
                for arm, text in database.execute("SELECT arm, settings FROM arms")
            }
            cursor = database.execute("SELECT * FROM runs ORDER BY arm, seed")
            names = [column[0] for column in cursor.description]
            runs = [dict(zip(names, row)) for row in cursor]
    except sqlite3.DatabaseError as error:
        raise ValueError(f"{where}: {wanted}; this is {_looks_like(where)}: {error}") from None
    varied = list(dict.fromkeys(key for settings in arms.values() for key in settings))
    table = Table(arm=[run["arm"] for run in runs])
    for key in varied:
        table[key] = [arms[run["arm"]].get(key) for run in runs]
    for name in names:
        if name not in ("arm", "sum"):
            table[name] = [run[name] for run in runs]
    return table
