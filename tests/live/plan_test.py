#!/usr/bin/env -S python3 -B
"""Plans over a real LCM network: the relay carries them, the vehicle executes them by time, poses name
the one in force, hostile ones are counted, and when they cease the vehicle ramps to a stop.
Usage: plan_test.py BIN_DIR"""

import math
import time

from live_support import PAPER, PLAN, POSE, PRESENCE, check, main, wait_until

SESSION = 2**40 + 7
STEP_US = 50_000
NONE, ANY = -1, -2


class Planner:
    """Answers each pose with a consistent plan of 2 s."""

    def __init__(self, network):
        self.network = network
        self.sent = 0
        self.on = True
        network.on_message("CTRL/POSE", self.answer)

    def send(self, channel, based_on, v=0.5, count=40, **fields):
        values = {"utime": self.now_us(), "seq": self.sent, "session": SESSION, "id": self.sent}
        values |= {"run": self.network.last("AGV/POSE").run}
        values |= {"based_on": based_on, "based_on_last": based_on}
        values |= {"step_us": STEP_US, "count": count}
        values |= {"v_mps": [v] * count, "omega_radps": [0.0] * count} | fields
        values.setdefault("start_utime", values["utime"])
        self.network.send(channel, PLAN.encode(**values))
        self.sent += 1

    def now_us(self):
        return self.network.last("SIM/TRUTH").utime

    def answer(self, payload):
        pose = POSE.decode(payload)
        if self.on and pose and self.network.last("SIM/TRUTH"):
            self.send("CTRL/PLAN", pose.plan_id if pose.plan_session == SESSION else NONE)


def counters(test):
    return test.network.counters("SIM/COUNTERS")


def follows_plans_and_stops_without_them(test):
    start = f"--start-utime={int(time.time() * 1e6) + 1_000_000}"
    options = (PAPER, start, "--set=actuator.policy=horizon", "--set=sensor.rate_hz=20")
    for name in ("tether-sim", "tether-netem"):
        test.start(name, *options)
    wait_until(10, lambda: test.network.last("SIM/TRUTH"), "the simulator")
    planner = Planner(test.network)
    wait_until(5, lambda: test.network.last("SIM/TRUTH").v_mps > 0.45, "the vehicle drives")
    time.sleep(1)
    pose = test.network.last("CTRL/POSE")
    check(pose.plan_session == SESSION and pose.plan_id > 10, f"poses name no plan: {pose}")
    check(math.isclose(test.network.last("SIM/TRUTH").v_mps, 0.5, abs_tol=0.02), "speed")

    planner.on = False
    time.sleep(0.3)  # messages under way arrive
    before = counters(test)
    check(before["plan.accepted"] > 10, f"few plans were accepted: {before}")
    place = {"run": pose.run, "program": "tether-netem", "vehicle": "AGV"}
    test.network.send("RUN/PRESENCE", PRESENCE.encode(**place))  # only the relay may send to the vehicle
    planner.send("AGV/PLAN", ANY, v=math.nan)
    planner.send("AGV/PLAN", ANY, step_us=-1)
    planner.send("AGV/PLAN", ANY, count=4001)
    planner.send("AGV/PLAN", 10**9)
    planner.send("AGV/PLAN", 0, session=SESSION + 1)
    planner.send("AGV/PLAN", ANY, start_utime=2**62)
    planner.send("AGV/PLAN", ANY, start_utime=0, count=1)
    test.network.send("AGV/PLAN", b"garbage")
    reasons = ("unusable", "bad_step", "too_long", "inconsistent", "other_session", "too_early")
    names = ["plan." + reason for reason in (*reasons, "expired", "undecodable")]
    wait_until(
        4,
        lambda: all(counters(test)[name] > before[name] for name in names),
        f"counters of all of {names}",
    )
    wait_until(4, lambda: abs(test.network.last("SIM/TRUTH").v_mps) < 0.01, "standstill")
    stands = test.network.last("CTRL/POSE")
    check(stands.plan_session == SESSION, "standing still is the end of the plan")
    planner.on = True
    wait_until(5, lambda: test.network.last("SIM/TRUTH").v_mps > 0.45, "the vehicle drives again")


def takes_a_preload_that_the_links_do_not_touch(test):
    start = f"--start-utime={int(time.time() * 1e6) + 2_000_000}"
    options = (PAPER, start, "--set=actuator.policy=horizon", "--set=run.lead_s=1")
    dead = ("--set=channel.downlink.prr=0",)
    for name in ("tether-sim", "tether-netem"):
        test.start(name, *options, *dead)
    wait_until(10, lambda: test.network.last("CTRL/POSE"), "poses")
    pose = test.network.last("CTRL/POSE")
    preload = {"session": SESSION, "utime": pose.utime, "run": pose.run}
    count = 20
    preload |= {"based_on": NONE, "based_on_last": NONE, "step_us": STEP_US, "count": count}
    preload |= {"v_mps": [0.5] * count, "omega_radps": [0.0] * count, "start_utime": 1_000_000}
    test.network.send("CTRL/PRELOAD", PLAN.encode(**preload))
    early = preload | {"id": 1, "based_on": ANY, "based_on_last": ANY}
    test.network.send("CTRL/PLAN", PLAN.encode(**early))
    wait_until(
        5, lambda: test.network.last("SIM/TRUTH") and test.network.last("SIM/TRUTH").v_mps > 0.45,
        "departure by the preload",
    )
    check(counters(test).get("plan.accepted", 1) == 1, "the link was dead")
    check(len(test.network.messages("AGV/PLAN")) == 0, "the link was dead")


main(follows_plans_and_stops_without_them, takes_a_preload_that_the_links_do_not_touch)
