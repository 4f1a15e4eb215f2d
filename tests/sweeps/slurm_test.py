#!/usr/bin/env python3
"""A sweep on a real Slurm of one machine, started and stopped here: its shards, one of them requeued
and one of them lost, give the same bytes as a sweep without Slurm.

Usage: slurm_test.py BIN_DIR
"""

import contextlib
import os
import pathlib
import pwd
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time

SOURCE = pathlib.Path(__file__).resolve().parents[2]
SUBMIT = SOURCE / "tools" / "slurm" / "submit.sh"
SHARDS = 4
EXPERIMENT = f"""
scenario = "{SOURCE}/scenarios/paper.toml"
seeds = 20
[set]
run.duration_s = 20.0
[grid]
channel.prr = [1.0, 0.6, 0.3]
"""


def run(*command, check=True, **options):
    result = subprocess.run(command, capture_output=True, text=True, timeout=180, **options)
    if check and result.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))}: {result.stdout}{result.stderr}")
    return result


def wait_until(seconds, condition, what):
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            sys.exit(f"not within {seconds} s: {what() if callable(what) else what}")
        time.sleep(0.1)


def free_port():
    """Not in a network of our own: Slurm wants an address that is not the loopback's."""
    with socket.socket() as probe:
        probe.bind(("", 0))
        return probe.getsockname()[1]


class Cluster:
    """munged, slurmctld and slurmd of this test's own, all files below one folder."""

    def __init__(self, folder):
        for program in ("munged", "slurmctld", "slurmd", "sbatch", "scontrol"):
            if shutil.which(program, path=os.environ["PATH"] + ":/usr/sbin:/sbin") is None:
                sys.exit(f"{program} is missing: apt-get install slurm-wlm munge")
        if os.getuid() != 0:
            sys.exit("Slurm's daemons need root")
        os.environ["PATH"] += ":/usr/sbin:/sbin"
        self.folder = folder
        self.processes = []

    def start(self):
        host = socket.gethostname().split(".")[0]
        for name in ("state", "spool"):
            (self.folder / name).mkdir()
        self.start_munge()
        config = self.folder / "slurm.conf"
        config.write_text(
            f"""
ClusterName=tether
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={free_port()}
SlurmdPort={free_port()}
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={self.folder}/munge.socket
CredType=cred/munge
StateSaveLocation={self.folder}/state
SlurmdSpoolDir={self.folder}/spool
SlurmctldPidFile={self.folder}/slurmctld.pid
SlurmdPidFile={self.folder}/slurmd.pid
SlurmctldLogFile={self.folder}/slurmctld.log
SlurmdLogFile={self.folder}/slurmd.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=batch_sched_delay=0,sched_min_interval=100000
ReturnToService=2
KillWait=5
MinJobAge=600
NodeName={host} NodeAddr=127.0.0.1 CPUs=2
PartitionName=all Nodes={host} Default=YES State=UP
"""
        )
        os.environ["SLURM_CONF"] = str(config)
        self.spawn("slurmctld", "-D")
        self.spawn("slurmd", "-D", "-N", host)
        wait_until(
            60, lambda: run("sinfo", "-h", "-o", "%T", check=False).stdout.strip() == "idle",
            "an idle node",
        )

    def start_munge(self):
        """Starts munge as its own user, who must own the key and all folders above."""
        key = self.folder / "munge.key"
        key.write_bytes(secrets.token_bytes(1024))
        user = pwd.getpwnam("munge")
        os.chown(self.folder, user.pw_uid, user.pw_gid)
        os.chown(key, user.pw_uid, user.pw_gid)
        key.chmod(0o400)
        files = ("pid", "log", "seed")
        options = [f"--{name}-file={self.folder}/munge.{name}" for name in files]
        self.spawn(
            "munged", "--foreground", "--force", f"--key-file={key}",
            f"--socket={self.folder}/munge.socket", *options,
            user=user.pw_uid, group=user.pw_gid, extra_groups=[],
        )
        wait_until(20, (self.folder / "munge.socket").exists, "munged's socket")

    def spawn(self, *command, **options):
        log = open(self.folder / f"{command[0]}.out", "wb")
        self.processes.append(
            subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, **options)
        )

    def stop(self):
        run("scancel", "--user", "root", check=False)
        for process in reversed(self.processes):
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=10)
            process.kill()


def states(job):
    """States of the tasks of an array, by task number."""
    lines = run("squeue", "-h", "-r", "-t", "all", "-j", job, "-o", "%K %T").stdout.split("\n")
    return dict(line.split() for line in lines if line)


def rows(database):
    if not database.exists():
        return 0
    text = run("tether", "sweep", "export", str(database), check=False).stdout
    return max(0, text.count("\n") - 1)


def submit(experiment, out):
    said = run(str(SUBMIT), str(experiment), str(out), str(SHARDS)).stdout
    print(said.strip().splitlines()[-1])
    words = said.replace(",", " ").split()
    return words[words.index("job") + 1], words[words.index("merge:") + 2]


def survives_a_requeued_and_a_lost_task(folder):
    experiment, out = folder / "e.toml", folder / "cluster"
    experiment.write_text(EXPERIMENT)
    array, merge = submit(experiment, out)
    # Task 1 is requeued in the middle, task 2 lost.
    wait_until(60, lambda: states(array).get("1") == "RUNNING", "task 1 runs")
    wait_until(60, lambda: rows(out / f"shard-1-of-{SHARDS}.sqlite") > 0, "task 1 has runs")
    run("scontrol", "requeue", f"{array}_1")
    run("scancel", f"{array}_2")
    wait_until(60, lambda: states(array).get("1") == "PENDING", "task 1 waits again")
    run("scontrol", "update", f"JobId={array}_1", "StartTime=now")  # not in two minutes
    ended = {"COMPLETED", "CANCELLED", "FAILED"}
    wait_until(
        120, lambda: set(states(array).values()) <= ended, lambda: f"the tasks end: {states(array)}"
    )
    after = states(array)
    assert after["1"] == "COMPLETED", after
    assert after["2"] == "CANCELLED", after
    wait_until(30, lambda: not states(merge) or "PENDING" not in states(merge).values(),
               "the merge is given up")
    assert not (out / "runs.sqlite").exists(), "merged although a shard is missing"

    before = [rows(out / f"shard-{i}-of-{SHARDS}.sqlite") for i in (1, 3, 4)]
    array, merge = submit(experiment, out)
    wait_until(120, (out / "runs.sqlite").exists, "the second submission merges")
    after = [rows(out / f"shard-{i}-of-{SHARDS}.sqlite") for i in (1, 3, 4)]
    assert after == before, f"shards that were complete have changed: {before}, {after}"

    run("tether", "sweep", str(experiment), "--out", str(folder / "whole"))
    exports = [run("tether", "sweep", "export", str(folder / name)).stdout
               for name in ("cluster", "whole")]
    assert exports[0] == exports[1], "the results differ"
    assert exports[0].count("\n") == 61
    print("requeued and lost tasks: the same 60 runs, byte for byte")


def main():
    bin_dir = pathlib.Path(sys.argv[1]).resolve()
    os.environ["PATH"] = f"{bin_dir}:{os.environ['PATH']}"
    os.environ["TETHER"] = str(bin_dir / "tether")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))
    with tempfile.TemporaryDirectory(prefix="tether-slurm-") as folder:
        os.chmod(folder, 0o755)
        cluster = Cluster(pathlib.Path(folder) / "slurm")
        cluster.folder.mkdir()
        try:
            cluster.start()
            survives_a_requeued_and_a_lost_task(pathlib.Path(folder))
        finally:
            cluster.stop()


if __name__ == "__main__":
    main()
