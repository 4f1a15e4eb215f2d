#!/usr/bin/env python3
"""A sweep that is killed at random moments, and one whose disk is full or read-only.

Usage: sweep_survival_test.py BIN_DIR
"""

import os
import pathlib
import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time

SOURCE = pathlib.Path(__file__).resolve().parents[2]
EXPERIMENT = f"""
scenario = "{SOURCE}/scenarios/paper.toml"
seeds = 40
trajectory_period_s = 0.5
[set]
run.duration_s = 6.0
[grid]
channel.prr = [1.0, 0.6, 0.3]
"""
RUNS = 120


class Failure(Exception):
    pass


def check(condition, what):
    if not condition:
        raise Failure(what)


class Bench:
    """A folder with an experiment in it, and `tether`."""

    def __init__(self, bin_dir, folder):
        self.tether = str(pathlib.Path(bin_dir) / "tether")
        self.folder = pathlib.Path(folder)
        self.experiment = self.folder / "e.toml"
        self.experiment.write_text(EXPERIMENT)

    def command(self, out, *more):
        return [self.tether, "sweep", str(self.experiment), "--out", str(out), *more]

    def run(self, *command):
        return subprocess.run(command, capture_output=True, text=True, timeout=120)

    def sweep(self, out, *more):
        return self.run(*self.command(out, *more))

    def csv(self, out):
        result = self.run(self.tether, "sweep", "export", str(out))
        check(result.returncode == 0, f"export: {result.stderr}")
        return result.stdout

    def refuses(self, out, code, *texts, more=()):
        result = self.sweep(out, *more)
        check(result.returncode == code, f"exit code {result.returncode}: {result.stderr}")
        for text in texts:
            check(text in result.stderr, f"no {text!r} in {result.stderr!r}")
        check(len(result.stderr.strip().splitlines()) == 1, f"not one line: {result.stderr!r}")


def loses_nothing_however_often_it_is_killed(bench):
    whole, killed = bench.folder / "whole", bench.folder / "killed"
    start = time.monotonic()
    check(bench.sweep(whole).returncode == 0, "the undisturbed sweep failed")
    bench.whole_s = time.monotonic() - start
    draw = random.Random(5)
    kills = 0
    seen = 0
    longest_s = 0.1  # until it is killed: as long as it takes to get on a little
    while True:
        process = subprocess.Popen(
            bench.command(killed, "--jobs", "2"), stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        try:
            output, _ = process.communicate(timeout=draw.uniform(0.02, longest_s))
            check(process.returncode == 0, f"it failed: {output.decode()}")
            break
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            kills += 1
        database = killed / "runs.sqlite"
        if database.exists():
            with sqlite3.connect(database) as connection:
                tables = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]
                runs = connection.execute("SELECT count(*) FROM runs").fetchone()[0] if tables else 0
            connection.close()
            check(runs >= seen, f"there were {seen} runs, and now {runs}")
            longest_s *= 0.8 if runs > seen else 1.1
            seen = runs
        check(kills < 500, f"no progress: {seen} runs after {kills} kills")
    check(kills >= 5, f"only {kills} kills: the test tested nothing")
    check(bench.csv(killed) == bench.csv(whole), "the results differ")
    with sqlite3.connect(killed / "runs.sqlite") as connection:
        count = "SELECT count(*) FROM trajectories"
        check(connection.execute(count).fetchone()[0] == RUNS, "trajectories are missing")
    connection.close()
    print(f"  killed {kills} times")


def is_one_file_at_its_end_for_every_reader(bench):
    """After all kills, too; also while it is there already, and in spite of a reader that was there."""
    def files(out):
        return sorted(file.name for file in out.glob("runs.sqlite*"))

    killed, read = bench.folder / "killed", bench.folder / "read"
    for _ in range(2):
        result = bench.run(bench.tether, "report", str(killed))
        check(result.returncode == 0, result.stderr)
        check(files(killed) == ["runs.sqlite"], f"{files(killed)} after a report")
        check(bench.sweep(killed, "--report").returncode == 0, "going on where nothing is left to do failed")
        check(files(killed) == ["runs.sqlite"], f"{files(killed)} after a sweep with a report")
    process = subprocess.Popen(bench.command(read), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not (read / "runs.sqlite").exists():
        time.sleep(0.01)
    reader = sqlite3.connect(f"file:{read}/runs.sqlite?mode=ro", uri=True, timeout=30)
    while process.poll() is None:
        time.sleep(0.05)
        try:
            reader.execute("SELECT count(*) FROM runs").fetchone()
        except sqlite3.OperationalError:
            pass  # not made yet
    check(process.returncode == 0, "a sweep suffered from its reader")
    reader.close()
    check(bench.csv(read) == bench.csv(bench.folder / "whole"), "the results differ")
    check(bench.sweep(read).returncode == 0 and files(read) == ["runs.sqlite"], f"{files(read)} at last")


def stops_on_ctrl_c_and_goes_on(bench):
    out = bench.folder / "interrupted"
    process = subprocess.Popen(
        bench.command(out), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    time.sleep(0.4 * bench.whole_s)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    check(process.returncode == 1, f"exit code {process.returncode}")
    check("the same command goes on" in errors, errors)
    again = bench.sweep(out)
    check(again.returncode == 0 and "runs already" in again.stderr, again.stderr)
    check(bench.csv(out) == bench.csv(bench.folder / "whole"), "the results differ")


def two_sweeps_into_one_database_are_refused(bench):
    out = bench.folder / "twice"
    process = subprocess.Popen(bench.command(out), stdout=subprocess.DEVNULL)
    while not (out / "runs.sqlite.lock").exists():
        time.sleep(0.01)
    time.sleep(0.1)
    bench.refuses(out, 2, "another process is writing")
    check(process.wait(timeout=120) == 0, "the first one suffered from it")


def shards_merge_to_the_same_bytes(bench):
    shards, merged = bench.folder / "shards", bench.folder / "merged"
    for i in (3, 1, 2):
        check(bench.sweep(shards, "--shard", f"{i}/3").returncode == 0, f"shard {i}")
        if i == 1:
            result = bench.run(bench.tether, "merge", str(shards), "--out", str(merged))
            check(result.returncode == 2 and "shard 2/3 is missing" in result.stderr, result.stderr)
    result = bench.run(bench.tether, "merge", str(shards), "--out", str(merged))
    check(result.returncode == 0, result.stderr)
    check(bench.csv(merged) == bench.csv(bench.folder / "whole"), "the results differ")
    bench.refuses(shards, 2, "4/3", "I/N", more=["--shard", "4/3"])


def merging_onto_a_full_disk_leaves_no_half_result(bench):
    size = (bench.folder / "merged" / "runs.sqlite").stat().st_size
    disk = bench.folder / "small"
    disk.mkdir()
    merge = (bench.tether, "merge", str(bench.folder / "shards"), "--out", str(disk))
    failures = 0
    # Enough for nothing; for the log, but not for the database too; for nearly all.
    for share in (0.5, 1.3, 1.9):
        room = int(share * size / 4096) * 4
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={room}k", "tmpfs", str(disk)], check=True
        )
        try:
            result = bench.run(*merge)
            if result.returncode != 0:
                failures += 1
                check("full" in result.stderr or "disk" in result.stderr, result.stderr)
                check(not (disk / "runs.sqlite").exists(), f"a half result at {room} kB")
                subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
                check(bench.run(*merge).returncode == 0, "merging again")
            check(bench.csv(disk) == bench.csv(bench.folder / "whole"), "the results differ")
        finally:
            subprocess.run(["umount", str(disk)], check=True)
    check(failures >= 2, f"the disk was full {failures} times: the test tested little")


def exporting_onto_a_database_is_refused(bench):
    database = bench.folder / "merged" / "runs.sqlite"
    before = database.read_bytes()
    for name in ("runs.sqlite", "runs.sqlite-wal"):
        result = bench.run(
            bench.tether, "sweep", "export", str(database), "--out", str(database.with_name(name))
        )
        check(result.returncode == 2 and "is a database" in result.stderr, result.stderr)
    check(database.read_bytes() == before, "the database was changed")


def another_experiment_is_refused(bench):
    text = bench.experiment.read_text()
    bench.experiment.write_text(text.replace("seeds = 40", "seeds = 41"))
    bench.refuses(bench.folder / "whole", 2, "seeds = 1 to 40; now it is 1 to 41")
    bench.experiment.write_text(text)


def a_damaged_database_is_refused_and_kept(bench):
    out = bench.folder / "damaged"
    out.mkdir()
    database = out / "runs.sqlite"
    good = (bench.folder / "whole" / "runs.sqlite").read_bytes()
    bad = good[:4096] + random.Random(1).randbytes(len(good) - 4096)
    database.write_bytes(bad)
    bench.refuses(out, 2, str(database))
    check(database.read_bytes() == bad, "it was changed")


def a_full_disk_loses_nothing(bench):
    disk = bench.folder / "disk"
    disk.mkdir()
    # Less than the complete database needs.
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=92k", "tmpfs", str(disk)], check=True)
    try:
        result = bench.sweep(disk / "out")
        check(result.returncode == 1, f"exit code {result.returncode}: {result.stderr}")
        check("database or disk is full" in result.stderr, result.stderr)
        check(str(disk) in result.stderr, result.stderr)
        subprocess.run(["mount", "-o", "remount,size=64m", str(disk)], check=True)
        again = bench.sweep(disk / "out")
        check(again.returncode == 0, again.stderr)
        check(bench.csv(disk / "out") == bench.csv(bench.folder / "whole"), "the results differ")
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def threads_that_cannot_be_made_are_an_error(bench):
    def with_little_memory():
        resource.setrlimit(resource.RLIMIT_AS, (400 << 20, 400 << 20))

    command = bench.command(bench.folder / "threads", "--jobs", "200")
    result = subprocess.run(
        command, capture_output=True, text=True, timeout=60, preexec_fn=with_little_memory
    )
    check(result.returncode == 1, f"exit code {result.returncode}: {result.stderr}")
    for text in ("cannot start thread", "of 200", "--jobs"):
        check(text in result.stderr, result.stderr)


def a_read_only_folder_is_refused(bench):
    disk = bench.folder / "read_only"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", str(disk)], check=True)
    try:
        bench.refuses(disk / "out", 2, "cannot make the folder", "Read-only")
        bench.refuses(disk, 1, "Read-only")
        # But what is complete can be read there.
        subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)
        check(bench.sweep(disk / "whole").returncode == 0, "the sweep")
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        check(bench.csv(disk / "whole") == bench.csv(bench.folder / "whole"), "the results differ")
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def main():
    if os.environ.get("TETHER_OWN_MOUNTS") != "yes":
        os.environ["TETHER_OWN_MOUNTS"] = "yes"
        own = ["unshare", "--mount"] if os.getuid() == 0 else ["unshare", "-r", "--mount"]
        os.execvp("unshare", [*own, sys.executable, *sys.argv])
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(sys.argv[1], folder)
        for part in (
            loses_nothing_however_often_it_is_killed,
            is_one_file_at_its_end_for_every_reader,
            stops_on_ctrl_c_and_goes_on,
            two_sweeps_into_one_database_are_refused,
            shards_merge_to_the_same_bytes,
            merging_onto_a_full_disk_leaves_no_half_result,
            exporting_onto_a_database_is_refused,
            another_experiment_is_refused,
            a_damaged_database_is_refused_and_kept,
            a_full_disk_loses_nothing,
            threads_that_cannot_be_made_are_an_error,
            a_read_only_folder_is_refused,
        ):
            start = time.monotonic()
            try:
                part(bench)
            except Failure as failure:
                sys.exit(f"{part.__name__}: {failure}")
            print(f"{part.__name__}: ok, {time.monotonic() - start:.1f} s")


if __name__ == "__main__":
    main()
