"""The packages of a package-lock.json, installed once by npm."""

import fcntl
import hashlib
import shutil
import subprocess
import sys


def fail(what):
    sys.exit(f"FAILED: {what}")


def need(*programs):
    for program, package in programs:
        if shutil.which(program) is None:
            fail(f"{program} is missing; on Debian: sudo apt-get install {package} (or ./setup.sh tests)")


def install(tests, folder):
    """npm ci of the lock file in the folder `tests` into `folder`, unless it is there; and its scripts
    beside it, for Node looks for packages beside the script. Tests that run at the same time wait for each
    other."""
    need(("node", "nodejs"), ("npm", "npm"))
    wanted = hashlib.sha256((tests / "package-lock.json").read_bytes()).hexdigest()
    stamp = folder / "installed"
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not stamp.exists() or stamp.read_text() != wanted:
            for name in ("package.json", "package-lock.json"):
                shutil.copy(tests / name, folder)
            done = subprocess.run(["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"], cwd=folder,
                                  capture_output=True, text=True)
            if done.returncode != 0:
                fail(f"npm ci needs registry.npmjs.org, or its cache: {done.stdout}{done.stderr}")
            stamp.write_text(wanted)
        for script in tests.glob("*.mjs"):
            shutil.copy(script, folder)
