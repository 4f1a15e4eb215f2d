#!/usr/bin/env python3
"""Takes the safety rules of can_bridge/ out, one at a time, and checks that a test notices.

Each mutant is one source file with one replacement (mutants.py). It is compiled with the build's
own flags and linked with the build's own test objects and libraries, in which it takes the place of
the original. A mutant that no test kills, a replacement that no longer applies, and an unmutated
copy that fails are errors.
"""
import argparse
import concurrent.futures
import itertools
import json
import os
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True
from mutants import MUTANTS  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[2]
TEST_TIMEOUT_S = 60


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", required=True, help="build folder")
    parser.add_argument("--objects", action="append", default=[], metavar="PROGRAM=FILE,FILE…",
                        help="the test program's own objects")
    parser.add_argument("--link", required=True, metavar="FILE,FILE…", help="libraries, in order")
    parser.add_argument("--only", default="", help="only mutants whose name contains this")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tether-mutation-") as folder:
        return Mutation(options, pathlib.Path(folder)).run()


class Mutation:
    def __init__(self, options, folder):
        self.folder = folder
        self.only = options.only
        self.objects = {}
        for argument in options.objects:
            program, _, files = argument.partition("=")
            self.objects[program] = files.split(",")
        self.libraries = options.link.split(",")
        commands = json.loads((pathlib.Path(options.build) / "compile_commands.json").read_text())
        self.compile_commands = {
            pathlib.Path(c["file"]).name: c
            for c in commands if (ROOT / "can_bridge") in pathlib.Path(c["file"]).parents}

    def run(self):
        mutants = [m for m in MUTANTS if self.only in m[0]]
        sources = {m[2]: self.source(m[2]) for m in mutants}
        broken = [f"mutation '{m[0]}' no longer applies: {m[2]} contains it "
                  f"{sources[m[2]].count(m[3])} times: {m[3]}"
                  for m in mutants if sources[m[2]].count(m[3]) != 1]
        if broken:
            print("\n".join(broken))
            return 1
        if not self.unmutated_pass(mutants, sources):
            return 1
        survivors = 0
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            jobs = [pool.submit(self.kill, i, m, sources[m[2]]) for i, m in enumerate(mutants)]
            for mutant, job in zip(mutants, jobs):
                killer = job.result()
                survivors += killer is None
                print(f"{mutant[0]:52} {'killed by ' + killer if killer else 'SURVIVED'}",
                      flush=True)
        print(f"{len(mutants)} mutants, {survivors} survived")
        return 1 if survivors else 0

    def source(self, name):
        return pathlib.Path(self.compile_commands[name]["file"]).read_text()

    def unmutated_pass(self, mutants, sources):
        """The unmutated copies of all files, compiled and linked the same way, pass."""
        compiled = {f: self.compile("original", f, text) for f, text in sources.items()}
        for program in sorted({m[1] for m in mutants}):
            killer = self.first_failure(self.link("original", program, list(compiled.values())))
            print(f"{'unmutated: ' + program:52} {'FAILS: ' + killer if killer else 'passes'}",
                  flush=True)
            if killer:
                return False
        return True

    def kill(self, number, mutant, source):
        """The name of the first test that fails, None if all pass."""
        _, program, file, old, new = mutant
        mutated = self.compile(f"mutant{number}", file, source.replace(old, new))
        return self.first_failure(self.link(f"mutant{number}", program, [mutated]))

    def compile(self, name, file, text):
        source = self.folder / name / file
        source.parent.mkdir(exist_ok=True)
        source.write_text(text)
        entry = self.compile_commands[file]
        command = shlex.split(entry["command"])
        command[command.index("-o") + 1] = f"{source}.o"
        command[command.index("-c") + 1] = str(source)
        # A mutant may leave something unused. Other flags as they are: the precompiled headers do
        # not go with others.
        self.check(command + ["-w"], entry["directory"])
        return f"{source}.o"

    def link(self, name, program, objects):
        entry = shlex.split(self.compile_commands["safety_core.cpp"]["command"])
        compiler = list(itertools.takewhile(lambda word: not word.startswith("-"), entry))
        flags = [word for word in entry if word.startswith("-fsanitize")]
        binary = f"{self.folder}/{name}/{program}"
        # Objects come before libraries: the mutant's symbols win over the original's.
        self.check(compiler + flags + objects + self.objects[program] + self.libraries +
                   ["-lpthread", "-o", binary], self.folder)
        return binary

    @staticmethod
    def check(command, directory):
        done = subprocess.run(command, cwd=directory, capture_output=True, text=True)
        if done.returncode != 0:
            sys.exit(f"cannot build a mutant: {shlex.join(command)}\n{done.stderr}")

    @staticmethod
    def first_failure(binary):
        try:
            done = subprocess.run([binary, "--gtest_fail_fast"], capture_output=True, text=True,
                                  timeout=TEST_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            return "the time limit"
        finally:
            os.remove(binary)
        if done.returncode == 0:
            return None
        failed = re.findall(r"\[  FAILED  \] ([\w./]+)", done.stdout)
        started = re.findall(r"\[ RUN      \] ([\w./]+)", done.stdout)
        return failed[0] if failed else (started or ["nothing started"])[-1] + " (crashed)"


if __name__ == "__main__":
    sys.exit(main())
