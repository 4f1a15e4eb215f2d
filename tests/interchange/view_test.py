#!/usr/bin/env -S python3 -B
"""tether view, spoken to by Foxglove's own client, @foxglove/ws-protocol: by both names of the protocol, with
a log and with a run that is being computed.

Usage: view_test.py BIN_DIR NPM_DIR; packages of package-lock.json are installed to NPM_DIR once.
"""

import pathlib
import re
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "support"))
from npm_packages import fail, install  # noqa: E402

PAPER = HERE.parents[1] / "scenarios" / "paper.toml"
TETHER = pathlib.Path(sys.argv[1]).resolve() / "tether"
NPM = pathlib.Path(sys.argv[2]).resolve()


def spoken_to(work, kind, protocol, *command):
    """Runs the command, and the client against it."""
    errors = work / "errors"
    with open(errors, "w") as file:
        server = subprocess.Popen([TETHER, *command], stdout=subprocess.DEVNULL, stderr=file)
    try:
        end = time.monotonic() + 30
        while not (found := re.search(r"view at http://(\S+)", errors.read_text())):
            if time.monotonic() > end or server.poll() is not None:
                fail(f"{kind}: no address: {errors.read_text()}")
            time.sleep(0.02)
        client = subprocess.run(["node", NPM / "view_client.mjs", f"ws://{found[1]}", protocol, kind], timeout=60,
                                capture_output=True, text=True)
        if client.returncode != 0:
            fail(f"{kind}, {protocol}: {client.stdout}{client.stderr}")
        print(f"{kind}, {protocol}: {client.stdout.strip()}")
    finally:
        server.kill()
        server.wait()


install(HERE, NPM)
with tempfile.TemporaryDirectory() as folder:
    work = pathlib.Path(folder)
    common = ["--set", "vehicle.plant=kinematic", "--set", "sensor.rate_hz=20"]
    done = subprocess.run([TETHER, "run", PAPER, *common, "--set", "run.duration_s=20", "--out", work / "run"],
                          capture_output=True, text=True)
    if done.returncode != 0:
        fail(done.stderr)
    log = work / "run" / "run.lcmlog"
    for protocol in ("foxglove.websocket.v1", "foxglove.sdk.v1"):
        spoken_to(work, "log", protocol, "view", log, "--port=0")
    spoken_to(work, "run", "foxglove.websocket.v1", "run", PAPER, *common, "--view", "--port=0")
print("passed")
