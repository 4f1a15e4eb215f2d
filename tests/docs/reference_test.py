#!/usr/bin/env -S python3 -B
"""reference.py with programs that are scripts: it writes and compares the pages, and if a documented program is not
built, it names the program and leaves the pages alone."""

import contextlib
import io
import pathlib
import sys
import tempfile

import reference

PROGRAM = """#!/bin/sh
[ "$*" = "run --keys" ] && exec echo "run.duration_s = 60
    Duration of the run, s; above 0
channel.links.NAME.* = of a link"
echo "{help}"
"""


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def built(folder, programs):
    """A new folder of programs, each with its help: their names are what helps.py remembers."""
    folder.mkdir()
    for name, said in programs.items():
        (folder / name).write_text(PROGRAM.format(help=said))
        (folder / name).chmod(0o755)
    return folder


def run(bin_dir, *options):
    """Exit code, what is printed, and the pages afterwards."""
    said = io.StringIO()
    sys.argv = ["reference.py", str(bin_dir), *options]
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = reference.main()
    return code, said.getvalue(), {file.name: file.read_text() for file in reference.FOLDER.glob("*.md")}


def main():
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(scratch)
        reference.FOLDER = folder / "reference"
        both = {"tether": "Runs scenarios", "tether-drive": "Drives"}

        code, said, written = run(built(folder / "all", both), "--write")
        check(code == 0 and "## tether-drive\n" in written["commands.md"], (code, said, written))
        check("| `run.duration_s` | `60` | s | Duration of the run, s | above 0 |" in written["keys.md"], written["keys.md"])
        check(run(folder / "all", "--check")[:2] == (0, ""), "the pages that were just written are up to date")

        code, said, after = run(built(folder / "part", {"tether": "Runs scenarios"}), "--write")
        check(code == 1 and "not built: tether-drive," in said, (code, said))
        check(after == written, "a refused --write changes nothing")
        code, said, after = run(folder / "part", "--check")
        check(code == 1 and said.startswith("not built: tether-drive,"), (code, said))
        check("is not what the programs say" not in said and after == written, said)

        # A program whose help changed, and one that is new, are no obstacle.
        changed = built(folder / "changed", both | {"tether-drive": "Drives well", "tether-new": "New"})
        code, said, _ = run(changed, "--check")
        check(code == 1 and "commands.md is not what the programs say" in said and "Drives well" in said, (code, said))
        code, said, after = run(changed, "--write")
        check(code == 0 and "## tether-new\n" in after["commands.md"], (code, said, after))


main()
