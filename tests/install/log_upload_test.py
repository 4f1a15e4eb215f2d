#!/usr/bin/env -S python3 -B
"""The upload of recorded logs that docs/howto/deployment.md describes, run as it is written there, by rsync over a remote
shell that stays on this host: all logs but the one that is being written arrive, and a second upload sends what is new.
Usage: log_upload_test.py"""

import os
import pathlib
import re
import subprocess
import sys
import tempfile

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PAGE = (SOURCE / "docs/howto/deployment.md").read_text()
# Remote shell for rsync: -l USER HOST COMMAND...
REMOTE_SHELL = """#!/bin/sh
[ "$1 $2 $3" = "-l logs 192.0.2.2" ] || { echo "called with $*" >&2; exit 1; }
shift 3
cd "$REMOTE_HOME" && exec "$@"
"""


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def log(number):
    return f"floor-{number:08}.lcmlog"  # rotating_log_test holds these names


def main():
    found = re.search(r"^    (cd /var/lib/tether && .*rsync .*)$", PAGE, re.MULTILINE)
    check(found, "deployment.md has no line with rsync")
    with tempfile.TemporaryDirectory() as work:
        vehicle, host = pathlib.Path(work, "vehicle"), pathlib.Path(work, "host")
        vehicle.mkdir()
        host.mkdir()
        shell = pathlib.Path(work, "shell")
        shell.write_text(REMOTE_SHELL)
        shell.chmod(0o755)
        line = found[1].replace("/var/lib/tether", str(vehicle))
        environment = os.environ | {"RSYNC_RSH": str(shell), "REMOTE_HOME": str(host)}

        def upload():
            done = subprocess.run(["sh", "-c", line], env=environment, text=True, capture_output=True)
            check(done.returncode == 0, f"{line}: exit code {done.returncode}: {done.stderr}")
            return {file.name: file.read_bytes() for file in sorted((host / "agv1").iterdir())}

        def write(number):
            (vehicle / log(number)).write_bytes(bytes([number]) * 100_000)
            return (vehicle / log(number)).read_bytes()

        written = {log(number): write(number) for number in (8, 9, 10)}
        (vehicle / "estop.AGV.can0").write_text("pressed\n")
        newest = written.pop(log(10))
        check(upload() == written, f"first upload: {os.listdir(host / 'agv1')}")
        inode = (host / "agv1" / log(9)).stat().st_ino
        write(11)
        written[log(10)] = newest
        check(upload() == written, f"second upload: {os.listdir(host / 'agv1')}")
        check((host / "agv1" / log(9)).stat().st_ino == inode, "what was there was sent again")
    print("passed: two uploads")


main()
