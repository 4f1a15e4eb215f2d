"""Common parts of tests and pictures of the page: Node.js, npm's packages by the lock file, Chromium."""

import math
import pathlib
import struct
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


def lcm_type(name):
    sys.path.insert(0, str(SOURCE / "tests" / "live"))
    from live_support import LcmType

    return LcmType(name)


def record(number, utime, channel, data):
    """One of an LCM event log."""
    channel = channel.encode()
    return struct.pack(">IqqII", 0xEDA1DA01, number, utime, len(channel), len(data)) + channel + data


def write_hostile_log(path, texts):
    """An LCM event log of one vehicle whose texts try to be HTML and scripts, in names and contents of messages."""
    pose, autonomy, drives, counters, peer = map(
        lcm_type, ("pose", "autonomy_state", "drivetrain_state", "counters", "peer_report"))
    with path.open("wb") as log:
        for tick in range(40):
            text, now = texts[tick % len(texts)], {"utime": 100_000 * tick, "seq": tick}
            messages = {
                "AGV/POSE": pose.encode(**now, plan_id=-1, plan_session=-1),
                "AGV/AUTONOMY": autonomy.encode(**now, state_name=text, reason=text),
                "CAN/STATE": drives.encode(**now, state_name=text, reason=text, bus=text),
                "SIM/COUNTERS": counters.encode(**now, node=text, count=1, name=[text], value=[1]),
                "LINK/REPORT": peer.encode(**now, peer=text, up=1, count=1, refused=[text], refused_count=[1]),
                text: pose.encode(**now),
                f"{text}/POSE": pose.encode(**now, plan_id=-1, plan_session=-1),
            }
            for channel, data in messages.items():
                log.write(record(tick, now["utime"], channel, data))


def write_fleet_log(path, vehicles, rate_hz, seconds):
    """An LCM event log of the poses of many vehicles on circles, without any program of ours."""
    pose = lcm_type("pose")
    number = 0
    with path.open("wb") as log:
        for tick in range(int(rate_hz * seconds)):
            utime = tick * 1_000_000 // rate_hz
            for i in range(vehicles):
                turn, radius = 0.15 * utime / 1e6 + 0.7 * i, 3 + 18 * i / vehicles
                data = pose.encode(utime=utime, seq=tick, x_m=radius * math.cos(turn), y_m=radius * math.sin(turn),
                                   yaw_rad=math.remainder(turn + math.pi / 2, 2 * math.pi), plan_id=-1, plan_session=-1)
                log.write(record(number, utime, f"AGV{i + 1}/POSE", data))
                number += 1
