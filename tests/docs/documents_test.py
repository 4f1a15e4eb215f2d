#!/usr/bin/env -S python3 -B
"""Whether README.md and docs/ are true: each command is run and what it prints compared (blocks.py says how, and
what marks exempt from it), each other one checked against the programs' helps, each block of Python run
(snippets.py), each link followed; whether each command's help has examples; and whether docs/reference is what the
programs say."""

import argparse
import concurrent.futures
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time

import blocks
import helps
import reference

ROOT = pathlib.Path(__file__).resolve().parents[2]
TIMEOUT_S = {False: 120, True: 7200}
# Folders of a checkout.
OF_THE_CHECKOUT = ["bench", "docs", "drivetrains", "examples", "experiments", "python", "scenarios", "tests", "tools"]


class Shell:
    """Runs one document's commands in a folder of their own, one after the other; cd and exports last."""

    def __init__(self, folder, bin_dir, nightly):
        self.cwd, self.nightly, self.groups = folder, nightly, []
        for name in OF_THE_CHECKOUT:
            (folder / name).symlink_to(ROOT / name)
        self.state = folder / ".state"
        self.environment = {
            "PATH": f"{bin_dir}:{os.environ['PATH']}",
            "HOME": str(folder),
            "LC_ALL": "C.UTF-8",
            "PYTHONPATH": str(ROOT / "python"),
        }

    def run(self, text):
        """Exit code and all that is printed."""
        script = f"{text}\ncode=$?\n{{ pwd; env -0; }} > {self.state}\nexit $code\n"
        process = subprocess.Popen(
            ["bash", "-c", script],
            cwd=self.cwd,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )
        self.groups.append(process.pid)
        said, _ = process.communicate(timeout=TIMEOUT_S[self.nightly])
        if self.state.exists():
            where, variables = self.state.read_bytes().decode().split("\n", 1)
            self.cwd = pathlib.Path(where)
            self.environment = dict(pair.split("=", 1) for pair in variables.split("\0") if "=" in pair)
            self.state.unlink()
        return process.returncode, said.decode()

    def close(self):
        for group in self.groups:
            try:
                os.killpg(group, signal.SIGKILL)
            except ProcessLookupError:
                pass


def check_block(shell, block):
    """Failures of a block's commands, a text each."""
    for command in block.commands:
        where = f"{block.file.relative_to(ROOT)}:{block.line}: {command.text}"
        try:
            code, said = shell.run(command.text)
        except subprocess.TimeoutExpired:
            yield f"{where}\n  does not end; a mark is missing?"
            return
        if command.printed and not blocks.agrees(block, command, said):
            yield f"{where}\n  prints:\n{said}  but the page has:\n" + "\n".join(command.printed)
        elif code != 0 and not re.search("error|refused", "".join(command.printed or [])):
            yield f"{where}\n  exit code {code}:\n{said}"


def check_python(shell, blocks_of_python, bin_dir):
    """Failures of a page's Python, a text each. What needs tether_env is left out where that is not
    built."""
    file = blocks_of_python[0].file
    for block in blocks_of_python:
        if block.name and not (ROOT / block.name).read_text().endswith("\n" + block.file_text):
            yield f"{file.relative_to(ROOT)}:{block.line}: {block.name} does not end so"
    built = bin_dir.parent / "python"
    if not (built / "tether_env").is_dir() and any("tether_env" in block.file_text for block in blocks_of_python):
        return
    debians = "/usr/bin/python3 -B"  # with numpy and pandas
    code, said = shell.run(f'PYTHONPATH="$PYTHONPATH:{built}" {debians} {ROOT}/tests/docs/snippets.py {file}')
    if code:
        yield f"{file.relative_to(ROOT)}: its Python:\n{said}"


def check_document(file, bin_dir, nightly):
    """(what is wrong, commands that were run, commands that were looked at, seconds)"""
    wrong, run, read, begin = [], 0, 0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        shell = Shell(pathlib.Path(folder), bin_dir, nightly)
        found = list(blocks.blocks_of(file))
        of_python = [block for block in found if block.mark == "python"]
        for block in found:
            if block.mark == "file":
                (shell.cwd / block.name).write_text(block.file_text)
            elif block.mark == "parse" or (block.mark == "nightly" and not nightly):
                read += len(block.commands)
                for command in block.commands:
                    fault = helps.wrong_with(bin_dir, ROOT, command.text)
                    if fault:
                        wrong.append(f"{file.relative_to(ROOT)}:{block.line}: {command.text}\n  {fault}")
            elif block.mark != "python":
                run += len(block.commands)
                wrong += check_block(shell, block)
        if of_python:
            run += len(of_python)
            wrong += check_python(shell, of_python, bin_dir)
        shell.close()
    return wrong, run, read, time.monotonic() - begin


def slug(heading):
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading.strip())
    return re.sub(r"[^\w\- ]", "", text.lower()).replace(" ", "-")


def anchors(file):
    text = re.sub(r"(?ms)^```.*?^```", "", file.read_text())
    return {slug(heading) for heading in re.findall(r"(?m)^#+ (.*)$", text)}


def broken_links(file):
    """Targets of a document's links and pictures that do not exist."""
    text = file.read_text()
    for link in re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (file.parent / path).resolve() if path else file
        if not target.exists():
            yield f"{file.relative_to(ROOT)}: {link}: there is no such file"
        elif anchor and target.suffix == ".md" and anchor not in anchors(target):
            yield f"{file.relative_to(ROOT)}: {link}: there is no such heading"


def wrong_inline(file, bin_dir):
    """Commands in the midst of sentences."""
    text = re.sub(r"(?ms)^\s*```.*?^\s*```", "", file.read_text())
    for span in re.findall(r"`(tether(?:-[a-z-]+)? [^`]+)`", text):
        fault = helps.wrong_with(bin_dir, ROOT, span.replace("\n", " ").replace("…", "").replace("|", " "))
        if fault:
            yield f"{file.relative_to(ROOT)}: `{span}`: {fault}"


def wrong_demo(bin_dir):
    """Lines that README shows at the end of demo.sh, and demo.sh does not print."""
    demo = (ROOT / "demo.sh").read_text()
    told = re.search(r"(?m)^    Try next:\n((?:      .*\n)+)", (ROOT / "README.md").read_text())
    for line in told[1].splitlines():
        fault = helps.wrong_with(bin_dir, ROOT, line)
        if fault or f"\n{line[4:]}\n" not in demo:
            yield f"README.md: {line.strip()}: {fault or 'demo.sh does not print it'}"


def wrong_examples(bin_dir):
    """Commands whose help ends without examples, or with ones that are not right."""
    programs = [p for p in sorted(bin_dir.glob("tether*")) if p.suffix == "" and os.access(p, os.X_OK)]
    for program in programs:
        for words in helps.all_commands(program):
            name = " ".join((program.name, *words))
            parts = helps.help_of(program, words).split("\nExamples:\n")
            lines = [line for line in parts[-1].splitlines() if line.strip()] if len(parts) == 2 else []
            if not 1 <= len(lines) <= 3:
                yield f"{name} --help: {len(lines)} lines of examples, must be 1 to 3"
            for line in lines:
                fault = helps.wrong_with(bin_dir, ROOT, line)
                if fault:
                    yield f"{name} --help: {line.strip()}\n  {fault}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bin_dir", type=pathlib.Path, help="folder of the programs: build/release/bin")
    parser.add_argument("--nightly", action="store_true", help="what takes long, too")
    parser.add_argument("--only", metavar="NAME", default="", help="only pages whose path has this, such as howto/tools")
    given = parser.parse_args()
    bin_dir, nightly, only = given.bin_dir.resolve(), given.nightly, given.only
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    files = [f for f in pages if only in str(f.relative_to(ROOT))]
    if not files:
        parser.error(f"--only: no page has {only} in {', '.join(str(f.relative_to(ROOT)) for f in pages)}")
    wrong = [] if only else [*wrong_examples(bin_dir), *wrong_demo(bin_dir), *reference.out_of_date(bin_dir)]
    for file in files:
        wrong += [*broken_links(file), *wrong_inline(file, bin_dir)]
    with concurrent.futures.ThreadPoolExecutor(max_workers=2) as pool:
        for file, result in zip(files, pool.map(lambda f: check_document(f, bin_dir, nightly), files)):
            faults, run, read, seconds = result
            print(f"{file.relative_to(ROOT)}: {run} commands run, {read} read, {seconds:.1f} s", flush=True)
            wrong += faults
    for fault in wrong:
        print(f"\nWRONG {fault}", file=sys.stderr)
    if wrong:
        print(f"\n{len(wrong)} faults", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
