#!/usr/bin/env -S python3 -B
"""Breaks the sources that keep a vehicle safe, one place at a time, and checks that a test notices.

All mutants of a source, or of the sources that the build compiles together, are compiled into one
object, in which the environment chooses one, and linked, in place of the original, with the test
programs as the build links them. One run of each program tells which tests reach which mutant; only
those are run with it, until one fails. What survives is an error unless survivors.toml says why it
may; a rule (rules.py) whose mutant is gone or lives is always one.

  mutate.py --build build/release                what ctest runs: all rules, and STRICT
  mutate.py --build build/release --all          every mutant of every source (sources.py)
  mutate.py --build build/release --only REGEX   those whose line of the list matches
  mutate.py --build build/release --can          the rules of what needs a kernel with CAN, there
  mutate.py --list                               only lists them

What kills which mutant is remembered in the build folder and asked first the next time.
"""
import argparse
import collections
import concurrent.futures
import json
import math
import os
import pathlib
import re
import shlex
import signal
import subprocess
import sys
import tempfile
import time
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE))
from rules import CAN_RULES, RULES, SPECIAL  # noqa: E402
from sources import CAN_SOURCES, SOURCES, STRICT  # noqa: E402
from syntax import Mutated  # noqa: E402

FIRST_LIMIT_S = 4  # processor time for programs that took milliseconds
WAITING = 15  # times as long a test may take in all, if it waits or the machine is busy


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, help="build folder, with the test programs built")
    parser.add_argument("--all", action="store_true", help="every mutant, not only rules and STRICT")
    parser.add_argument("--can", action="store_true", help="rules of sources that need a kernel with CAN")
    parser.add_argument("--only", metavar="REGEX", help="only mutants whose line matches")
    parser.add_argument("--list", action="store_true", help="list the mutants; with --build, after their fate")
    options = parser.parse_args()
    sources = [Source(path, programs) for path, programs in
               sources_and_programs(CAN_SOURCES if options.can else SOURCES)]
    number_all(sources)
    if not options.build:
        for source in sources:
            print("\n".join(map(str, source.mutants)))
        return 0
    # A guest kernel has a temporary folder of its own.
    place = options.build.resolve() if options.can else None
    with tempfile.TemporaryDirectory(prefix="tether-mutation-", dir=place) as folder:
        return Mutation(options, sources, pathlib.Path(folder)).run()


def sources_and_programs(listed):
    seen = set()
    for pattern, programs in listed:
        for path in sorted(ROOT.glob(pattern)):
            name = str(path.relative_to(ROOT))
            if name not in seen and not name.endswith("main.cpp"):
                seen.add(name)
                yield name, programs
        if not any(True for _ in ROOT.glob(pattern)):
            sys.exit(f"sources.py: there is no {pattern}")


def number_all(sources):
    first = 1
    for source in sources:
        source.first = first
        first += len(source.mutate().mutants)


def groups_of(tests):
    """The quick ones first: what most mutants die of."""
    groups, limit_ms, spent_ms = [[]], 20, 0
    for took, test in tests:
        if spent_ms + took > limit_ms and groups[-1]:
            groups.append([])
            limit_ms, spent_ms = 8 * limit_ms, 0
        groups[-1].append(test)
        spent_ms += took
    return groups if groups[-1] else []


class Source:
    def __init__(self, name, programs):
        self.name, self.programs = name, programs
        self.first = 1
        self.unasked = frozenset()  # mutants that are not run: compiled, they would cost most of the time
        self.without = frozenset()  # mutants that do not compile

    def mutate(self):
        mutated = Mutated((ROOT / self.name).read_text(), self.first, self.unasked | self.without, SPECIAL)
        self.mutants = mutated.mutants
        for mutant in self.mutants:
            mutant.file = self.name
        return mutated


class Mutation:
    def __init__(self, options, sources, folder):
        self.options, self.sources, self.folder = options, sources, folder
        self.build = options.build.resolve()
        self.commands = {
            source: c for c in json.loads((self.build / "compile_commands.json").read_text())
            for source in self.sources_in(pathlib.Path(c["file"]))
        }
        self.cache = self.build / "mutation_killers.json"
        self.killers = json.loads(self.cache.read_text()) if self.cache.exists() else {}
        self.expected = tomllib.loads((HERE / "survivors.toml").read_text()).get("survivor", [])

    def run(self):
        chosen, problems = self.choose()
        self.sources = [s for s in self.sources if any(m.file == s.name for m in chosen)]
        asked = {m.number for m in chosen}
        for source in self.sources:
            source.unasked = frozenset(m.number for m in source.mutants) - asked
        started = time.monotonic()
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            units = self.units()
            objects = list(pool.map(self.compile, units))
            runtime = self.compile_runtime()
            programs = sorted({p for s in self.sources for p in s.programs})
            self.binaries = dict(zip(programs, pool.map(
                lambda p: self.link(p, [runtime, *(made for made, unit in zip(objects, units)
                                                   if any(p in s.programs for s in unit))]),
                programs)))
            print(f"{len(self.sources)} sources compiled, {len(programs)} programs linked: "
                  f"{time.monotonic() - started:.0f} s", flush=True)
            if not self.options.can:
                self.reach = dict(zip(programs, pool.map(self.trace, programs)))
            left_out = {n for s in self.sources for n in s.without}
            chosen = [m for m in chosen if m.number not in left_out]
            lost = set(self.rules.values()) - {self.rules.get(m.number) for m in chosen}
            if self.rules and not self.options.only:
                problems += [f"rule '{name}': its mutant does not compile" for name in sorted(lost)]
            programs_of = {s.name: s.programs for s in self.sources}
            if self.options.can:
                killers = self.kill_where_can_is(chosen, programs[0])
            else:
                killers = list(pool.map(lambda m: self.kill(m, programs_of[m.file]), chosen))
        self.cache.write_text(json.dumps(self.killers, indent=0, sort_keys=True))
        problems += self.judge(chosen, killers)
        print(f"{len(chosen)} mutants, {sum(k is None for k in killers)} survived, {len(left_out)} do not "
              f"compile; {time.monotonic() - started:.0f} s")
        print("\n".join(problems))
        return 1 if problems else 0

    # --- which

    def choose(self):
        """Chooses the mutants to run; returns the faults of the rules."""
        everything = [m for s in self.sources for m in s.mutants]
        self.rules, problems = {}, []
        for name, function, operator, text in CAN_RULES if self.options.can else RULES:
            found = [m for m in everything if m.operator == operator
                     and re.search(function, m.function) and re.search(text, m.text)]
            if not found:
                problems.append(f"rule '{name}': no mutant '{operator}' of /{text}/ in /{function}/")
            for m in found:
                self.rules.setdefault(m.number, name)
        if self.options.only:
            return [m for m in everything if re.search(self.options.only, str(m))], []
        if self.options.all:
            return everything, problems
        chosen = [m for m in everything if m.number in self.rules
                  or any(re.match(p, m.file) and m.operator in o for p, o in STRICT)]
        return chosen, problems

    # --- building

    def sources_in(self, file):
        """The sources that are compiled with this file: those that a batch includes, or itself."""
        if self.build in file.parents:
            return re.findall(r'^#include "(.+\.cpp)"$', file.read_text(), re.MULTILINE) if file.exists() else []
        return [str(file.relative_to(ROOT))] if ROOT in file.parents else []

    def units(self):
        """Sources that the build compiles together, as lists."""
        units = collections.defaultdict(list)
        for source in self.sources:
            units[self.commands[source.name]["file"]].append(source)
        return list(units.values())

    def compile(self, unit):
        """One object, whole like the build's: two would define what they share twice, and what is
        inlined within a batch would stay without mutants."""
        names = ", ".join(source.name for source in unit)
        entry = self.commands[unit[0].name]
        made = self.folder / f"{unit[0].name}.o"
        for _ in range(8):
            lines = {self.folder / s.name: s.mutate().text.split("\n") for s in unit}
            for file, text in lines.items():
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text("\n".join(text))
            command = shlex.split(entry["command"])
            command[command.index("-o") + 1] = str(made)
            if entry["file"] == str(ROOT / unit[0].name):
                command[command.index("-c") + 1] = str(self.folder / unit[0].name)
            command[1:1] = ["-I", str(self.folder)]  # a batch finds the copies before the originals
            done = subprocess.run([*command, "-w", "-O1", "-fmax-errors=0"], cwd=entry["directory"],
                                  capture_output=True, text=True)
            if done.returncode == 0:
                return made
            bad = {source: self.bad(lines[self.folder / source.name], self.folder / source.name, done.stderr)
                   for source in unit}
            if not any(numbers - source.without for source, numbers in bad.items()):
                break
            for source, numbers in bad.items():
                source.without |= numbers
        sys.exit(f"cannot compile the mutants of {names}:\n{done.stderr[:3000]}")

    @staticmethod
    def bad(lines, file, errors):
        """The mutants in lines of the file that the compiler does not take."""
        found = re.findall(rf"{re.escape(str(file))}:(\d+):\d+: (?:error|  required)", errors)
        return {int(n) for number in found for n in re.findall(r"tether_mutant\((\d+)\)", lines[int(number) - 1])}

    def compile_runtime(self):
        done = subprocess.run(["c++", "-std=c++20", "-O1", "-c", HERE / "runtime.cpp", "-o", self.folder / "runtime.o"])
        done.check_returncode()
        return self.folder / "runtime.o"

    def link(self, program, objects):
        """Links like the build, but with these objects, whose symbols win over those of the libraries."""
        commands = subprocess.run(["ninja", "-C", self.build, "-t", "commands", "-s", f"tests/{program}"],
                                  capture_output=True, text=True, check=True).stdout
        steps = commands.strip().splitlines()[-1].split(" && ")
        command = shlex.split(next(step for step in steps if f" -o tests/{program} " in step))
        binary = self.folder / program
        command[command.index("-o") + 1] = str(binary)
        at = next(i for i, word in enumerate(command) if word.endswith(".o"))
        command[at:at] = map(str, objects)
        done = subprocess.run(command, cwd=self.build, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"cannot link {program}:\n{done.stderr[:3000]}")
        return binary

    # --- running

    def trace(self, program):
        """Mutant -> [(milliseconds, test that reaches it)], cheapest first."""
        file = self.folder / f"{program}.trace"
        failed = self.failure(program, None, 300, {"TETHER_MUTANT_TRACE": str(file)})
        if failed:
            sys.exit(f"{program} fails without any mutant: {failed}")
        reach = collections.defaultdict(list)
        for line in file.read_text().splitlines():
            test, took, *numbers = line.split()
            for number in numbers:
                reach[int(number)].append((float(took), test))
        return {number: sorted(tests) for number, tests in reach.items()}

    def kill(self, mutant, programs):
        """The first test that fails; None if there is none."""
        key = "|".join(mutant.key())
        for program in programs:
            tests = self.reach[program].get(mutant.number, [])
            names = [test for _, test in tests]
            limit = FIRST_LIMIT_S + 5e-3 * sum(took for took, _ in tests)
            hint = [[self.killers[key]]] if self.killers.get(key) in names else []
            for group in hint + groups_of(tests):
                if killer := self.failure(program, group, limit, {"TETHER_MUTANT": str(mutant.number)}):
                    self.killers[key] = killer.split(" ")[0]
                    return killer
        return None

    def kill_where_can_is(self, chosen, program):
        """Like kill(), all in one boot of a kernel with CAN, and without any mutant first."""
        numbers = ["", *(str(m.number) for m in chosen)]
        results = self.folder / "results"
        results.mkdir()
        limit_s = 30 * len(numbers)
        subprocess.run([ROOT / "tests/uml/with_can.sh", HERE / "where_can_is.sh", self.binaries[program], *numbers],
                       env=os.environ | {"TETHER_CAN_RESULTS": str(results), "TETHER_CAN_TIMEOUT": str(limit_s)},
                       check=True)
        killers = [self.killer(program, *(results / f"mutant_{n}").read_text().split("exit code: ")) for n in numbers]
        if killers[0]:
            sys.exit(f"{program} fails without any mutant: {killers[0]}")
        return killers[1:]

    def failure(self, program, tests, limit_s, environment):
        environment = os.environ | environment | {"TMPDIR": str(self.folder)}
        if tests:
            environment["GTEST_FILTER"] = ":".join(tests)
        # A hanging program computes without end: on a busy machine, too, it is noticed by the processor's time.
        command = ["prlimit", f"--cpu={math.ceil(limit_s)}:unlimited", self.binaries[program], "--gtest_fail_fast",
                   "--gtest_brief=0"]
        try:
            done = subprocess.run(command, env=environment, capture_output=True, timeout=WAITING * limit_s,
                                  cwd=self.folder)
            output, hangs = done.stdout, done.returncode == -signal.SIGXCPU
        except subprocess.TimeoutExpired as late:
            output, hangs = late.stdout or b"", True
        if hangs:
            started = re.findall(rb"\[ RUN      \] (\S+)", output)
            return (started[-1].decode() if started else program) + " (hung)"
        return self.killer(program, output.decode(errors="replace"), done.returncode)

    @staticmethod
    def killer(program, output, code):
        if int(code) == 0:
            return None
        failed = re.findall(r"\[  FAILED  \] ([\w./]+)", output)
        started = re.findall(r"\[ RUN      \] ([\w./]+)", output)
        return failed[0] if failed else (started or [program])[-1] + " (crashed)"

    # --- judging

    def judge(self, chosen, killers):
        problems = []
        for mutant, killer in zip(chosen, killers):
            rule = self.rules.get(mutant.number)
            may_live = not rule and any(self.matches(entry, mutant) for entry in self.expected)
            if killer is None and not may_live:
                problems.append(f"SURVIVED: {f'rule {rule!r}: ' if rule else ''}{mutant}")
            if self.options.list:
                print(f"{mutant}   {killer or 'SURVIVED'}{f'   [{rule}]' if rule else ''}")
        return problems

    @staticmethod
    def matches(entry, mutant):
        return (re.fullmatch(entry["function"], mutant.function)
                and mutant.operator in entry["operators"].split(", ")
                and re.search(entry["text"], mutant.text))


if __name__ == "__main__":
    sys.exit(main())
