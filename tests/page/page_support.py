"""Common parts of tests and pictures of the page: Node.js, npm's packages by the lock file, Chromium."""

import pathlib
import sys

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parents[1]
sys.path.insert(0, str(SOURCE / "tests" / "support"))
import npm_packages  # noqa: E402
from npm_packages import fail, need  # noqa: E402, F401: for who uses this


def install(npm):
    """Installs the needs of Chromium and of the scripts beside this file into the folder `npm`."""
    need(("chromium", "chromium"))
    npm_packages.install(HERE, npm)


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
