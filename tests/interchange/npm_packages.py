"""The packages of package-lock.json, installed once by npm."""

import fcntl
import hashlib
import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent


def fail(what):
    sys.exit(f"FAILED: {what}")


def install(folder):
    """npm ci, unless what the lock file says is there; beside it our scripts, for Node looks for packages
    beside the script. Tests that run at the same time wait for each other."""
    for program in ("node", "npm"):
        if shutil.which(program) is None:
            fail(f"{program} is missing; on Debian: sudo apt-get install nodejs npm")
    wanted = hashlib.sha256((HERE / "package-lock.json").read_bytes()).hexdigest()
    stamp = folder / "installed"
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not stamp.exists() or stamp.read_text() != wanted:
            for name in ("package.json", "package-lock.json"):
                shutil.copy(HERE / name, folder)
            done = subprocess.run(["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"], cwd=folder,
                                  capture_output=True, text=True)
            if done.returncode != 0:
                fail(f"npm ci needs registry.npmjs.org, or its cache: {done.stdout}{done.stderr}")
            stamp.write_text(wanted)
        for script in HERE.glob("*.mjs"):
            shutil.copy(script, folder)
