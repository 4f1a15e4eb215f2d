#!/usr/bin/env -S python3 -B
"""Where Node.js, npm or Chromium is missing, the tests that need it fail and say what to install."""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
SHELL = ("sh", "env", "dirname", "python3", "rm", "mkdir")
TESTS = {
    "page/logic_test.sh": ("node",),
    "page/page_test.py": ("node", "npm", "chromium"),
    "page/report_view_test.py": ("node", "npm", "chromium"),
    "interchange/mcap_test.py": ("node", "npm"),
    "interchange/view_test.py": ("node", "npm"),
}
PACKAGES = {"node": "nodejs", "npm": "npm", "chromium": "chromium"}


def run_without(missing, test, scratch):
    """The test, where only programs that it needs are found, but this one."""
    programs = scratch / f"{test.replace('/', '_')}_without_{missing}"
    programs.mkdir()
    for name in SHELL + tuple(p for p in TESTS[test] if p != missing):
        (programs / name).symlink_to(shutil.which(name) or "/bin/true")
    return subprocess.run([HERE.parent / test, scratch, programs / "npm_packages"], cwd=scratch, text=True,
                          env=os.environ | {"PATH": str(programs)}, timeout=60,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT)


def main():
    wrong = []
    with tempfile.TemporaryDirectory() as scratch:
        for test, needs in TESTS.items():
            for missing in needs:
                result = run_without(missing, test, pathlib.Path(scratch))
                expected = (f"FAILED: {missing} is missing; on Debian: sudo apt-get install "
                            f"{PACKAGES[missing]} (or ./setup.sh tests)\n")
                if result.returncode != 1 or result.stdout != expected:
                    wrong.append(f"{test} without {missing}: exit {result.returncode}\n{result.stdout}")
    sys.exit("".join(wrong) or 0)


main()
