"""What tests and pictures of the page need: Node.js, npm's packages by the lock file, Chromium."""

import hashlib
import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parents[1]


def fail(what):
    sys.exit(f"FAILED: {what}")


def need(*programs):
    for program, package in programs:
        if shutil.which(program) is None:
            fail(f"{program} is missing; on Debian: sudo apt-get install {package} (or ./setup.sh tests)")


def install(npm):
    """npm ci into the folder `npm`, unless what the lock file says is there; and the scripts beside it,
    where Node.js looks for packages."""
    need(("node", "nodejs"), ("npm", "npm"), ("chromium", "chromium"))
    lock = (HERE / "package-lock.json").read_bytes()
    stamp, wanted = npm / "installed", hashlib.sha256(lock).hexdigest()
    npm.mkdir(parents=True, exist_ok=True)
    if not stamp.exists() or stamp.read_text() != wanted:
        for name in ("package.json", "package-lock.json"):
            shutil.copy(HERE / name, npm)
        done = subprocess.run(["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"], cwd=npm,
                              capture_output=True, text=True)
        if done.returncode != 0:
            fail(f"npm ci needs registry.npmjs.org, or its cache: {done.stdout}{done.stderr}")
        stamp.write_text(wanted)
    for script in HERE.glob("*.mjs"):
        shutil.copy(script, npm)


def write_fleet_log(path, vehicles, rate_hz, seconds):
    """An LCM event log of the poses of many vehicles on circles, without any program of ours."""
    import math
    import struct

    sys.path.insert(0, str(SOURCE / "tests" / "live"))
    from live_support import LcmType

    pose = LcmType("pose")
    number = 0
    with path.open("wb") as log:
        for tick in range(int(rate_hz * seconds)):
            utime = tick * 1_000_000 // rate_hz
            for i in range(vehicles):
                turn, radius = 0.15 * utime / 1e6 + 0.7 * i, 3 + 18 * i / vehicles
                data = pose.encode(utime=utime, seq=tick, x_m=radius * math.cos(turn), y_m=radius * math.sin(turn),
                                   yaw_rad=math.remainder(turn + math.pi / 2, 2 * math.pi), plan_id=-1, plan_session=-1)
                channel = f"AGV{i + 1}/POSE".encode()
                log.write(struct.pack(">IqqII", 0xEDA1DA01, number, utime, len(channel), len(data)) + channel + data)
                number += 1
