#!/usr/bin/env python3
"""Prints what took longest in the last build, and the slowest tests of the last run, in seconds.

  slowest.py [BUILD [NUMBER]]    BUILD: build/release; NUMBER: of each, 15

Times are wall clock: of a step while others ran beside it. What ccache had counts as short as it was.
"""

import pathlib
import sys


def steps(build):
    """(seconds, output) of the last time that each step of the build ran."""
    last = {}
    for line in (build / ".ninja_log").read_text().splitlines()[1:]:
        start, end, _, output, command = line.split("\t")
        last[(start, end, command)] = (int(end) - int(start)) / 1000, output
    return last.values()


def tests(build):
    """(mean seconds, name), as CTest keeps them to begin with the longest."""
    file = build / "Testing" / "Temporary" / "CTestCostData.txt"
    for line in file.read_text().splitlines() if file.exists() else ():
        words = line.split()
        if len(words) == 3 and float(words[2]) > 0:
            yield float(words[2]), words[0]


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
