#!/usr/bin/env python3
"""clang-tidy finds nothing in any source. Usage: tidy.py BUILD_DIR [FOLDER...]

Most of the work is in the system's headers, so sources are checked dozens at a time, as one file that
includes them. The compiler says which of them cannot stand beside those before them (two things of one
name): they are checked together in a next round.
"""
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = "common sim localiser controller autonomy netem can_bridge link margin tools bench".split()
AT_ONCE = 96
CHATTER = re.compile(r"\d+ warnings? (generated|treated)|Suppressed|Use -header-filter")


def options(commands):
    """What sources are compiled with, all together, but for precompiled headers: clang-tidy cannot read
    them."""
    found = {}
    for command in commands:
        command = re.sub(r" -Winvalid-pch -include \S+| -o \S+| -c \S+", "", command)
        found.update(dict.fromkeys(re.findall(r"-isystem \S+|\S+", command)[1:]))
    return shlex.split(" ".join(found))


def unlike(sources, output):
    """Those of the sources in which the compiler finds errors, by what it prints."""
    within, found = None, set()
    for line in output.splitlines():
        for path in re.findall(r"(/[^:\s]+\.cpp):\d+", line):
            within = path if path in sources else within
        if " error: " in line and within:
            found.add(within)
    return found or set(sources)


def run(command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT)


def check(folder, sources, flags):
    """Checks those of the sources that can stand together: returns what is found, and the others."""
    together = Path(folder) / "together.cpp"
    compiler = ["clang++", "-fsyntax-only", "-ferror-limit=0", *flags, together]
    tidy = ["clang-tidy", "--quiet", "--checks=-bugprone-suspicious-include",
            f"--header-filter=^{ROOT}/[a-z_/]+/[^/]*\\.[ch]pp$", together, "--", *flags]
    here, tool = sources, compiler
    while True:
        together.write_text("".join(  # of programs, each main() has a name of its own
            f'#define main main_{i}\n#include "{source}"\n#undef main\n' for i, source in enumerate(here)))
        result = run(tool)
        wrong = "clang-diagnostic-error" in result.stdout if tool is tidy else result.returncode != 0
        if wrong and len(here) > 1:
            wrong = unlike(here, result.stdout) & set(here[1:]) or set(here[len(here) // 2:])
            here = [source for source in here if source not in wrong]
        elif tool is tidy:
            found = [line for line in result.stdout.splitlines() if not CHATTER.match(line)]
            return found if result.returncode else [], [s for s in sources if s not in here]
        tool = tidy


def main():
    build, folders = Path(sys.argv[1]).resolve(), sys.argv[2:] or FOLDERS
    if not shutil.which("clang-tidy"):
        sys.exit("clang-tidy is missing: apt install clang-tidy")
    commands = {c["file"]: c["command"] for c in json.loads((build / "compile_commands.json").read_text())}
    rest = [str(path) for folder in folders for path in sorted((ROOT / folder).rglob("*.cpp"))]
    clean = True
    with tempfile.TemporaryDirectory(dir=build, prefix="tidy_") as scratch, \
            ThreadPoolExecutor(os.cpu_count()) as pool:
        def check_some(some):
            flags = options(commands[source] for source in some if source in commands)
            return check(tempfile.mkdtemp(dir=scratch), some, flags)

        while rest:
            # Neighbours have most names in common: each is checked with others.
            count = max(-(-len(rest) // AT_ONCE), min(os.cpu_count(), len(rest)))
            parts = [rest[i::count] for i in range(count)]
            rest = []
            for found, others in pool.map(check_some, parts):
                print("\n".join(found), end="\n" if found else "", flush=True)
                clean = clean and not found
                rest += others
    if not clean:
        sys.exit(1)
    print("clang-tidy: clean")


main()
