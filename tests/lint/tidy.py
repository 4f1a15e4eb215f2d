#!/usr/bin/env -S python3 -B
"""clang-tidy finds nothing in any source. Usage: tidy.py [--no-cache] BUILD_DIR [FOLDER...]

Most of the work is in the system's headers, so sources are checked dozens at a time, as one file that
includes them. Sources that cannot stand beside those before them (two things of one name) have errors of
the compiler there, and are checked together in a next round.

Clean sources are remembered in ${XDG_CACHE_HOME:-~/.cache}/tether/tidy (tidy_cache.py) and skipped while
nothing changes that a check depends on. --no-cache neither reads nor writes that folder.
"""
import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tidy_cache import Cache, Sources

ROOT = Path(__file__).resolve().parents[2]
CONFIGURATION = ROOT / ".clang-tidy"
FOLDERS = "common sim controller netem can_bridge onboard doors tools bench".split()
AT_ONCE = 96
# Nothing else that GCC is called with changes what a source means; some of it clang does not know.
MEANING = re.compile(r"-[DUI].|-std=|-pthread$")
MEANING_IN_TWO_WORDS = {"-I", "-D", "-U", "-isystem", "-iquote", "-idirafter"}
TIDY = ["clang-tidy", "--quiet", "--checks=-bugprone-suspicious-include", f"--config-file={CONFIGURATION}",
        f"--header-filter=^{ROOT}/[a-z_/]+/[^/]*\\.[ch]pp$"]
CHATTER = re.compile(r"\d+ (warning|error)s?\b.* (generated|treated)|Suppressed|Use -header-filter|"
                     r"Error while processing|Found compiler error|$")
FATAL = re.compile("file not found|cannot open|too many|nested too|maximum")
MESSAGE = re.compile(r"(/[^:]+):\d+:\d+: (\w+): .*?(\[[\w.,-]+\])?$")
PLACE = re.compile(r"(/[^:\s'\"()]+):\d+:\d+")


def options(build):
    """Compile options of product and benchmark sources, all together. A batch (tether_batches) has the
    options of its sources, so that few sources have a command of their own."""
    ours = re.compile(f"({re.escape(str(build))}|{re.escape(str(ROOT))})/({'|'.join(FOLDERS)})/")
    found = {}
    for entry in json.loads((build / "compile_commands.json").read_text()):
        if not ours.match(entry["file"]):
            continue
        words = iter(shlex.split(entry["command"]))
        for word in words:
            if word in MEANING_IN_TWO_WORDS:
                found[word, next(words)] = True
            elif MEANING.match(word):
                found[word,] = True
    if not found:
        sys.exit(f"{build}/compile_commands.json has no command for a source of {', '.join(FOLDERS)}: "
                 "run cmake first")
    return [word for option in found for word in option]


def run(command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)


def messages(output):
    """Output of clang-tidy, message by message: each with its notes, as a list of lines."""
    found = []
    for line in output.splitlines():
        match = MESSAGE.match(line)
        if match and match[2] in ("error", "warning") or not found:
            found.append([])
        found[-1].append(line)
    return found


def files_of(message):
    """The file of the message itself, and those that its text and its notes name as well ("lambda at ...")."""
    if not MESSAGE.match(message[0]):
        return []
    return [os.path.normpath(file) for line in message for file in PLACE.findall(line)]


def judge(output, failed, sources, includes):
    """Reads what clang-tidy says of the sources: returns the messages, the clean sources, and those to check
    again without the others. A source is clean if there is no message in it or in a file that it includes;
    `includes(source, file)` says whether it does.

    An error of the compiler leaves out what is wrong and no more: sources without one are checked well.
    """
    found, touched, again, known = [], set(), set(), True
    for message in messages(output):
        files = files_of(message)
        users = {source for source in sources if files and includes(source, files[0])}
        if "[clang-diagnostic-error" in message[0] and len(sources) > 1:
            wrong = {files[0]} & set(sources) or set(files) & set(sources) or users or set(sources)
            if FATAL.search(message[0]):  # the compiler does not read on
                wrong = wrong | set(sources[min(map(sources.index, wrong)):])
            again |= wrong
        elif text := "\n".join(line for line in message if not CHATTER.match(line)):
            found.append((files[0] if files else None, text))
            touched |= users
            known = known and bool(users)
    if failed and not found and not again:
        found, known = [(None, "clang-tidy fails without a reason\n" + output)], False
    clean = [source for source in sources if known and source not in touched | again]
    return [text for file, text in found if file not in again], clean, [s for s in sources if s in again]


def check(folder, sources, flags, includes):
    """Checks the sources as one file. Returns what judge() returns and, to be stored, pairs of clean sources
    and the headers that they were checked with."""
    together = Path(folder) / "together.cpp"
    together.write_text("".join(  # each program's main() gets a name of its own
        f'#define main main_{i}\n#include "{source}"\n#undef main\n' for i, source in enumerate(sources)))
    result = run([*TIDY, together, "--", *flags, "-ferror-limit=0"])
    listed = run(["clang++", "-M", *flags, together])
    output = result.stdout if result.stdout.strip() else result.stderr
    found, clean, again = judge(output, result.returncode != 0, sources, includes)
    if len(again) == len(sources):  # not one of them was checked well
        halves = [check(folder, half, flags, includes) for half in (sources[::2], sources[1::2])]
        return [first + second for first, second in zip(*halves)]
    headers = shlex.split(listed.stdout.replace("\\\n", " ").partition(":")[2])
    return found, clean, again, [(clean, headers)] if listed.returncode == 0 else []


def arguments():
    parser = argparse.ArgumentParser(description="Checks all product and benchmark sources with clang-tidy.")
    parser.add_argument("--no-cache", action="store_true", help="neither use nor keep earlier results")
    parser.add_argument("build", metavar="BUILD_DIR", type=Path, help="folder with compile_commands.json")
    parser.add_argument("folders", metavar="FOLDER", nargs="*", default=FOLDERS,
                        help="folder of sources, relative to the checkout; default: all of the product")
    return parser.parse_args()


def main():
    args = arguments()
    for tool in ("clang-tidy", "clang++"):
        if not shutil.which(tool):
            sys.exit(f"{tool} is missing: apt install clang clang-tidy")
    build = args.build.resolve()
    flags = options(build)
    sources = Sources(ROOT, build, flags)
    cache = Cache(None if args.no_cache else Cache.default_folder())
    cache.remove_old(time.time())
    common = sources.portable("\n".join(
        [run(["clang-tidy", "--version"]).stdout, CONFIGURATION.read_text(), *TIDY, *flags]))

    every = [str(path) for folder in args.folders for path in sorted((ROOT / folder).rglob("*.cpp"))]
    keys = {source: sources.key(source, common) for source in every}
    rest = checked = [source for source in every if not cache.is_clean(keys[source])]
    unclean, printed = set(checked), set()
    with tempfile.TemporaryDirectory(dir=build, prefix="tidy_") as scratch, \
            ThreadPoolExecutor(os.cpu_count()) as pool:
        def check_some(some):
            found, clean, again, results = check(tempfile.mkdtemp(dir=scratch), some, flags, sources.includes)
            for these, headers in results:
                cache.store([keys[source] for source in these if sources.is_unchanged(source)],
                            [header for header in headers if not sources.is_project(header)])
            return found, clean, again

        while rest:
            # Neighbours have most names in common: each is checked with others.
            count = max(-(-len(rest) // AT_ONCE), min(os.cpu_count(), len(rest)))
            parts = [rest[i::count] for i in range(count)]
            rest = []
            for found, clean, again in pool.map(check_some, parts):
                for message in found:
                    if message not in printed:  # each part has the same headers
                        print(message, flush=True)
                    printed.add(message)
                unclean -= set(clean)
                rest += again
    if unclean:
        sys.exit(f"clang-tidy: findings in {len(unclean)} of {len(every)} sources, with their headers")
    print(f"clang-tidy: {len(every)} sources are clean, {len(checked)} checked now")


if __name__ == "__main__":
    main()
