#!/usr/bin/env python3
"""Prints what took longest in the last build, and the slowest tests of the last run, in seconds.

  slowest.py [BUILD [NUMBER]]    BUILD: build/release; NUMBER: of each, 15

Times are wall clock: of a step while others ran beside it. What ccache had counts as short as it was.
"""

import pathlib
import re
import sys


def steps(build):
    """(seconds, output) of the last time that each step of the build ran."""
    last, one_of = {}, {}
    for line in (build / ".ninja_log").read_text().splitlines()[1:]:
        start, end, _, output, command = line.split("\t")
        if (build / output).exists():
            last[output] = start, end, command
    for output, step in last.items():
        one_of[step] = (int(step[1]) - int(step[0])) / 1000, output  # a step may have several
    return one_of.values()


def tests(build):
    """(seconds, name), as CTest wrote them in its last run."""
    file = build / "Testing" / "Temporary" / "LastTest.log"
    name = None
    for line in file.read_text(errors="replace").splitlines() if file.exists() else ():
        if begins := re.match(r"\d+/\d+ Test: (\S+)$", line):
            name = begins[1]
        elif name and (took := re.match(r"Test time = +([\d.]+) sec$", line)):
            yield float(took[1]), name
            name = None


def table(title, rows, number):
    rows = sorted(rows, reverse=True)
    print(f"{title}: {len(rows)}, {sum(seconds for seconds, _ in rows):.0f} s in sum")
    for seconds, name in rows[:number]:
        print(f"{seconds:8.1f}  {name}")


def main():
    build = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "build/release")
    number = int(sys.argv[2]) if len(sys.argv) > 2 else 15
    if not (build / ".ninja_log").exists():
        sys.exit(f"{build}: not a build folder of Ninja; cmake --preset release makes build/release")
    table("steps of the build", steps(build), number)
    table("tests", tests(build), number)


if __name__ == "__main__":
    main()
