#!/usr/bin/env -S /usr/bin/python3 -B
"""pip install ./python/env, without a network, into an environment of its own; the example learns with it.
Usage: env_pip_test.py BUILD"""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(sys.argv[1]).resolve()


def run(*words, **options):
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"FAILED: {' '.join(map(str, words))}\n{done.stdout}{done.stderr}")
    return done.stdout


with tempfile.TemporaryDirectory() as folder:
    work = pathlib.Path(folder)
    copy = work / "source"  # for pip builds in the folder
    shutil.copytree(SOURCE / "python" / "env", copy, ignore=shutil.ignore_patterns("build", "*.egg-info"))
    run("/usr/bin/python3", "-m", "venv", "--system-site-packages", work / "venv")
    run(work / "venv/bin/pip", "install", "--no-index", "--disable-pip-version-check", copy,
        env=os.environ | {"TETHER_BUILD": str(BUILD)})
    python = work / "venv/bin/python"
    where = run(python, "-c", "import tether_env; print(tether_env.__file__)", cwd=work)
    if str(work / "venv") not in where:
        sys.exit(f"FAILED: it is not the installed one that is imported, but {where}")
    said = run(python, SOURCE / "examples" / "learn_pid.py", 1, 2, cwd=work)
    if "| PID, learned |" not in said or "384 runs of 62 s" not in said:
        sys.exit(f"FAILED: the example says\n{said}")
