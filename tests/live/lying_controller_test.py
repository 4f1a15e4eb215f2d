#!/usr/bin/env -S python3 -B
"""An external controller that lies to the coordinator, in each way of a table, at grants that a seed chooses: the run
fails and says so, or the lie has no effect and the log is byte for byte the honest one. Never another result with exit
code 0. Usage: lying_controller_test.py BIN_DIR [RUNS_OF_EACH_LIE [SEED]]"""

import os
import random
import sys

from live_support import PAPER, SOURCE, check, main

os.environ["PYTHONPATH"] = str(SOURCE / "python")
FAST = ("--set", "sensor.rate_hz=20", "--set", "channel.prr=0.9", "--set", "channel.delay_ms=20")
FAST += ("--set", "run.duration_s=1.5", "--set", "vehicle.plant=kinematic")
LAST_GRANT = 12  # last grant that a command answers; an honest run has more

# The controller's message at the chosen grant. `a`: its answer, as a dict; `self`: the node; `rows`: what it published.
LIES = """
answers another grant: a["grant"] += 1
answers a grant of long ago: a["grant"] = 16
answers a grant of far ahead: a["grant"] += 10**6
answers no grant: a["grant"] = 0
answers a negative grant: a["grant"] = -1
answers in another session: a["session"] += 1
answers in any session: a["session"] = 0
answers as another start of itself: a["instance"] += 1
answers as the simulator: a["node"] = "sim"
answers as the relay: a["node"] = "netem"
answers as a node that does not exist: a["node"] = "ghost"
answers without a name: a["node"] = ""
repeats the grant's mac wrongly: a["grant_mac"] = "00" * 16
repeats no mac: a["grant_mac"] = ""
has its next event in the past: a["next_ns"] = 0
has its next event before time: a["next_ns"] = -(1 << 62)
has its next event at once: a["next_ns"] = grant.until_ns
has a negative order: a["next_order"] = -1
does not say what it published: rows.clear()
says only half of what it published: del rows[len(rows) // 2 :]
says it twice: rows.extend(rows[:])
misses out a number: rows[0][1] += 1
begins its numbers again: rows[0][1] = 1
numbers backwards: rows[0][1] = -1
numbers beyond all: rows[0][1] = (1 << 63) - 1
published in its past: rows[0][2] = 0
published before time: rows[0][2] = -(1 << 62)
published beyond its grant: rows[0][2] = grant.until_ns + 10**9
published for ever after: rows[0][2] = (1 << 63) - 1
has another index: rows[0][3] = 7
has a negative index: rows[0][3] = -1
has another size: rows[0][4] += 1
has no size: rows[0][4] = 0
has a negative size: rows[0][4] = -1
has another digest: rows[0][5] = "11" * 16
has no digest: rows[0][5] = ""
names the truth: rows[0][0] = "SIM/TRUTH"
names the vehicle's command: rows[0][0] = "AGV/CMD_VEL"
names the protocol: rows[0][0] = "TIME/GRANT"
names nothing: rows[0][0] = ""
names what no pattern takes: rows[0][0] = "X" * 60
signs with another key: key = bytes(32)
does not sign: key = None
answers twice, differently: after = lambda: again({**a, "next_ns": grant.until_ns + 1})
answers twice, the same: after = lambda: again(a)
leaves: import os; os._exit(0)
says nothing: return
fails: a["error"] = "it does not work"
sends one that it does not say: self._send("CTRL/CMD_VEL", sent + b"")
sends others' truth: self._send("SIM/TRUTH", tether.message_type("ground_truth_t").encode())
grants the simulator time: self._say("TIME/GRANT", kind("grant"), session=self.session, node="sim", id=10**6, until_ns=10**10)
welcomes with another key: self._say("TIME/WELCOME", kind("welcome"), session=self.session, node="netem", run_key="22" * 32)
joins again: self.join()
joins as the relay: self._say("TIME/JOIN", kind("join"), session=self.session, instance=5, node="netem")
asks for what never was: self._say("TIME/RESEND", kind("resend"), session=self.session, publisher="sim", channel="AGV/POSE", number=10**9)
asks for a thousand: [self._say("TIME/RESEND", kind("resend"), session=self.session, publisher="sim", channel="AGV/POSE", number=n) for n in range(1000)]
answers garbage: self._send("TIME/REQUEST", b"garbage")
"""

LIAR = '''
import pathlib
import sys
import tether
from tether import lockstep

at, lie = int(sys.argv.pop(1)), sys.argv.pop(1)
told = pathlib.Path(sys.argv.pop(1))
kind = lambda name: tether.message_type(f"time_{name}_t")
decisions = 0
source = """
def tell(self, a, rows, grant, sent, again):
    key, after = self._key, lambda: None
    LIE
    return key, after
""".replace("LIE", lie)
exec(source)

def reply(self, grant, published, error, honest=tether.Lockstep._reply):
    global decisions
    decisions += len(published) > 0
    if not published or decisions != at:
        return honest(self, grant, published, error)
    told.write_text(lie)
    a = {"grant": grant.id, "grant_mac": grant.mac, "error": error, "session": self.session}
    a |= {"instance": self._instance, "node": "controller"} | self._next()
    rows = [list(row) for row in published]
    names = ("channel", "number", "time_ns", "index", "size", "digest")

    def again(what, by=None):
        mac = lockstep._mac(lockstep._REQUEST, what, by or self._key)
        return self._say("TIME/REQUEST", lockstep._REQUEST, **what, mac=mac)

    def columns():
        a["count"] = len(rows)
        a.update({name: tuple(row[i] for row in rows) for i, name in enumerate(names)})

    columns()
    sent = self._sent[published[0][0], published[0][1]]
    done = tell(self, a, rows, grant, sent, again)
    if done is None:  # silent
        return
    key, after = done
    columns()
    if key is None:
        data = self._say("TIME/REQUEST", lockstep._REQUEST, **a, mac="")
    else:
        data = again(a, key)
    self._answer = (grant.id, data)
    after()

tether.Lockstep._reply = reply
tether.main(lambda t, pose, path: (0.5, 0.1))
'''


def run(test, name, at, lie):
    """(exit code, log, output, whether the lie was sent)"""
    script, out, told = (test.work / f"{name}{end}" for end in (".py", "", ".told"))
    script.write_text(LIAR)
    starter = test.work / f"{name}.sh"
    starter.write_text(f'exec python3 -B {script} {at} "$LIE" {told} "$@"\n')
    command = f"sh {starter} --url {{url}} --scenario {{scenario}}"
    done = test.run("tether", "run", PAPER, *FAST, "--set", f'controller.command="{command}"', "--out", out,
                    seconds=60, env=os.environ | {"LIE": lie})
    log = out / "run.lcmlog"
    return done.process.returncode, log.read_bytes() if log.exists() else b"", done.err(), told.exists()


def no_lie_changes_a_result_with_exit_code_0(test):
    times, seed = [*map(int, sys.argv[2:]), *(1, 1)[len(sys.argv) - 2 :]]
    lies = [line.split(": ", 1) for line in LIES.strip().splitlines()]
    check(len({name for name, _ in lies}) == len(lies) >= 40, f"{len(lies)} kinds of lies")
    code, honest, said, told = run(test, "honest", 1 << 30, "pass")
    check(code == 0 and len(honest) > 10_000 and not told, f"an honest controller: {code} {said}")
    choice = random.Random(seed)
    failed = harmless = 0
    for i, (name, lie) in enumerate(lies * times):
        at = choice.randrange(2, LAST_GRANT)
        code, log, said, told = run(test, f"lie{i}", at, lie)
        check(told, f"{name}: was not told: {said}")
        check(code in (0, 1), f"{name}: exit code {code}: {said}")
        if code == 0:
            check(log == honest, f"{name}, at decision {at}: another result with exit code 0: {said}")
        else:
            check("error: " in said and "signal 0" not in said, f"{name}: exit code 1 without a reason: {said}")
        failed += code == 1
        harmless += code == 0
        test.say(f"{name}: " + ("no effect" if code == 0 else said.strip().splitlines()[-1][:150]))
    n = failed + harmless
    test.say(f"{n} lies of {len(lies)} kinds: {failed} ended the run, {harmless} had no effect, none changed a result "
             f"(at most {3 / n:.1e} of them do, with 95 % confidence)")


main(no_lie_changes_a_result_with_exit_code_0)
