#!/usr/bin/env -S python3 -B
"""build_test.py vehicle|packaging|clone BUILD: a documented build other than BUILD's is configured, built, installed and packed.

    vehicle    -DTETHER_VEHICLE_ONLY=ON, where the simulator's libraries are hidden; each program runs
    packaging  -DTETHER_TESTS=OFF; before it is built, cpack names what is missing
    clone      after packaging: by the commands of deployment.md, a clone in another folder, with another umask and
               time zone, gives the same packages. --compile: without ccache, which may have objects of the first build

The build tree is beside BUILD and has its options, so that ccache knows all objects that both have. It is emptied
first, because an old one would hide what a new one lacks."""

import argparse
import os
import pathlib
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PAGE = (SOURCE / "docs/howto/deployment.md").read_text()
VEHICLE = ["tether-vehicle", "tether-autonomy", "tether-can-bridge", "tether-can-drive", "tether-link", "tether-localiser"]
NODES = ["tether-autonomy", "tether-can-bridge", "tether-can-drive", "tether-localiser"]
PACKAGES = {
    "vehicle": ["tether-dev", "tether-doc", "tether-vehicle"],
    "packaging": ["python3-tether-env", "python3-tether", "tether-dev", "tether-doc", "tether-vehicle", "tether"],
}  # by file name
NOT_ON_A_VEHICLE = ("libode", "libsqlite3", "libmuparser", "libzstd", "libz.so")
MOST_PACKAGES = 11


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def run(*command, expect=(0,), **options):
    done = subprocess.run([str(word) for word in command], text=True, capture_output=True, **options)
    check(done.returncode in expect,
          f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr


def options_of(tree, *keys):
    """Its compiler, warnings, build type and these, for another tree."""
    cache = dict(re.findall(r"(?m)^(\w+):\w+=(.*)$", (tree / "CMakeCache.txt").read_text()))
    keys = ("CMAKE_CXX_COMPILER", "CMAKE_BUILD_TYPE", "TETHER_WERROR", *keys)
    return [f"-D{key}={cache[key]}" for key in keys if key in cache]


def configured(build, tree, *definitions, **options):
    """Configures a new build tree with BUILD's options."""
    shutil.rmtree(tree, ignore_errors=True)
    run("cmake", "-S", SOURCE, "-B", tree, "-G", "Ninja", *options_of(build), *definitions, **options)


def built(tree, *targets):
    begin = time.monotonic()
    run("nice", "-n", "12", "cmake", "--build", tree, *(["--target", *targets] if targets else []))
    print(f"built in {time.monotonic() - begin:.0f} s")


def packed(tree, names):
    made = tree / "packages"
    shutil.rmtree(made, ignore_errors=True)
    run("cpack", "-G", "DEB", "--config", tree / "CPackConfig.cmake", "-B", made)
    return packages_in(made, names)


def packages_in(made, names):
    packages = sorted(made.glob("*.deb"))
    check([package.name.split("_")[0] for package in packages] == names, packages)
    return {package.name.split("_")[0]: package for package in packages}


def each_program_runs(folder, work):
    """With nothing but what is installed, in an empty folder, on a network of its own."""
    anywhere = {"cwd": work, "env": {"PATH": "/usr/bin:/bin", "HOME": str(work)}}
    check(sorted(os.listdir(folder)) == sorted(VEHICLE), os.listdir(folder))
    for name in VEHICLE:
        check(re.match(r"\d+\.\d+\.\d+", run(folder / name, "--version", **anywhere).split()[-1]), name)
        check(f"Usage: {name} " in run(folder / name, "--help", **anywhere), name)
    said = run(folder / "tether-vehicle", "doctor", expect=(0, 1), **anywhere)
    check(re.search(r"ok +messages +heard again", said) and re.search(r"ok +programs +all are there", said), said)
    run(folder / "tether-vehicle", "echo", "--quiet", "--duration", "0.2", expect=(0, 1), **anywhere)
    key = run(folder / "tether-link", "keygen", "vehicle.key", **anywhere).strip()
    check(len(key) == 64 and run(folder / "tether-link", "show", "vehicle.key", **anywhere).strip() == key, key)
    for name in NODES:  # the installed scenarios are found, all their sections are known, and SIGTERM ends it
        log = work / f"{name}.log"
        with log.open("w") as out:
            node = subprocess.Popen([folder / name, "scenarios/factory_blocked.toml" if "can" not in name else
                                     "scenarios/hil_vcan.toml"], stdout=out, stderr=out, **anywhere)
        deadline = time.monotonic() + 30
        while "waiting for SIM/CLOCK" not in log.read_text() and node.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        node.send_signal(signal.SIGTERM)
        code = node.wait(30)
        check("waiting for SIM/CLOCK" in log.read_text() and code == 0, f"{name}: exit code {code}: {log.read_text()}")


def metrics_are_served(folder, work):
    server = subprocess.Popen([folder / "tether-vehicle", "metrics", "--port", "0"], cwd=work, stdout=subprocess.PIPE, text=True)
    with urllib.request.urlopen(server.stdout.readline().strip(), timeout=10) as answer:
        served = answer.read().decode()
    server.terminate()
    check("tether_build_info{" in served and server.wait(10) == 0, served)


class Installed:
    """Debian's packages on this machine: what each needs, without recommendations."""

    def __init__(self):
        self.needs, self.provider, self.bare = {}, {}, []
        fields = "${binary:Package}\t${Essential}\t${Priority}\t${Provides}\t${Pre-Depends}, ${Depends}\n"
        for line in run("dpkg-query", "--show", f"--showformat={fields}").splitlines():
            name, essential, priority, provides, needs = line.split("\t")
            name = name.split(":")[0]
            self.needs[name] = needs
            for provided in provides.split(","):
                self.provider.setdefault(provided.split("(")[0].strip(), name)
            if essential == "yes" or priority == "required" or name == "apt":
                self.bare.append(name)
        self.bare = self.closure(self.bare)  # mmdebstrap --variant=minbase

    def first_of(self, alternatives):
        names = [re.split(r"[\s(:]", choice.strip())[0] for choice in alternatives.split("|")]
        return next((name if name in self.needs else self.provider[name] for name in names
                     if name in self.needs or name in self.provider), None)

    def closure(self, names):
        found, waiting = set(), list(names)
        while waiting:
            name = waiting.pop()
            if name not in found:
                found.add(name)
                needed = [self.first_of(part) for part in self.needs[name].split(",") if part.strip()]
                waiting += [other for other in needed if other]
        return found


def installed_with(package):
    """Packages that apt would add to a bare Debian for this package: all that it depends on, beyond what minbase has."""
    debian = Installed()
    depends = run("dpkg-deb", "--field", package, "Depends").strip()
    names = [debian.first_of(part) for part in depends.split(",")]
    check(None not in names, f"not installed here: {depends}")
    return debian.closure(names), debian.bare


def owners_of(files):
    """The package of each file. Debian lists /lib/… of what is in /usr/lib/… for some packages."""
    paths = {path: file for file in files for real in (file, os.path.realpath(file))
             for path in (real, real.removeprefix("/usr"), f"/usr{real}")}
    found = subprocess.run(["dpkg", "--search", *sorted(paths)], text=True, capture_output=True).stdout
    owners = {}
    for line in found.splitlines():
        names, _, path = line.rpartition(": ")
        owners[paths[path]] = names.split(",")[0].split(":")[0]
    return owners


def links_little(folder, package):
    needed, bare = installed_with(package)
    libraries = {}  # file: a program that loads it
    for name in VEHICLE:
        direct = run("readelf", "--dynamic", folder / name)
        check(not any(library in direct for library in NOT_ON_A_VEHICLE), f"{name}: {direct}")
        libraries |= {file: name for file in re.findall(r"=> (/\S+)", run("ldd", folder / name))}
    owners = owners_of(libraries)
    check(len(owners) > 5, owners)
    for file, name in libraries.items():
        check(owners.get(file) in needed | bare,
              f"{name} loads {file} of {owners.get(file)}, on which {package.name} does not depend")
    added = sorted(needed - bare)
    print(f"tether-vehicle adds {len(added)} packages to a bare Debian: {' '.join(added)}")
    check(len(added) <= MOST_PACKAGES, f"more than {MOST_PACKAGES}")


def vehicle(build, tree, work):
    hidden = work / "pkgconfig"
    hidden.mkdir()
    for pc in ("ode", "libzstd", "sqlite3", "zlib", "muparser"):
        (hidden / f"{pc}.pc").write_text("none\n")
    configured(build, tree, "-DTETHER_VEHICLE_ONLY=ON",
               *[f"-DCMAKE_DISABLE_FIND_PACKAGE_{name}=ON" for name in ("Java", "SQLite3", "ZLIB", "GTest", "benchmark")],
               env=os.environ | {"PKG_CONFIG_PATH": str(hidden)})
    built(tree)
    simulator = [str(path.relative_to(tree)) for path in tree.rglob("*.a") if re.search(
        r"sim_(plant|node)|tools_(view_(?!server)|experiment|runs|nodes|margin)", path.name)]
    check(not simulator, f"built for a vehicle: {simulator}")
    prefix, away = work / "prefix", work / "away"
    away.mkdir()
    run("cmake", "--install", tree, "--prefix", prefix)
    each_program_runs(prefix / "bin", away)
    metrics_are_served(prefix / "bin", away)
    links_little(prefix / "bin", packed(tree, PACKAGES["vehicle"])["tether-vehicle"])


def packaging(build, tree, _):
    refused = subprocess.run(["cmake", "-S", SOURCE, "-B", tree, "-G", "Ninja", "-DTETHER_MAINTAINER=A. Smith"], text=True,
                             capture_output=True)
    said = " ".join(refused.stderr.split())  # CMake breaks lines
    check(refused.returncode != 0 and 'must be "Name <mail address>"' in said, said)
    maintainer = "A. Smith <smith@example.com>"
    configured(build, tree, "-DTETHER_TESTS=OFF", f"-DTETHER_MAINTAINER={maintainer}")
    # Same as after ./demo.sh, which builds no Python module: in one line, what is missing and what builds it.
    said = run("cpack", "-G", "DEB", "--config", tree / "CPackConfig.cmake", "-B", tree / "none", expect=(1,))
    wanted = rf"(?m)^cpack: not built: .*tether-vehicle, .*_core\.\S+\.so\. Run: cmake --build {tree} --target packaged$"
    check(re.search(wanted, said), said)
    built(tree, "packaged")
    check(not (tree / "tests").exists() and not (tree / "bench").exists(), "no tests and no benchmarks")
    first = packed(tree, PACKAGES["packaging"])
    bytes_of = {}
    for name, package in first.items():
        check(run("dpkg-deb", "--field", package, "Maintainer").strip() == maintainer, package)
        bytes_of[name] = package.read_bytes()
    time.sleep(2)  # no time stamp has a finer resolution
    for name, package in packed(tree, PACKAGES["packaging"]).items():
        check(package.read_bytes() == bytes_of[name], f"{name}: packed again, other bytes")


def copy_of_the_source(folder):
    """A clone with this checkout's changes."""
    run("git", "clone", "--quiet", SOURCE, folder)
    names = run("git", "-C", SOURCE, "ls-files", "-z", "--cached", "--others", "--exclude-standard").split("\0")
    for name in filter(None, names):
        (folder / name).unlink(missing_ok=True)
        if (SOURCE / name).is_symlink() or (SOURCE / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(SOURCE / name, folder / name, follow_symlinks=False)


def listing(package, folder):
    """Modes, owners, sizes and times of its files, and their sums."""
    shutil.rmtree(folder, ignore_errors=True)
    run("dpkg-deb", "--raw-extract", package, folder)
    sums = run("find", ".", "-type", "f", "-exec", "sha256sum", "{}", "+", cwd=folder)
    return set(run("dpkg-deb", "--contents", package).splitlines() + sums.splitlines())


def clone(build, compiles, work):
    first = build.parent / f"{build.name}-packaging"
    folder = work / "a_folder_that_is_named_otherwise" / "tether"
    copy_of_the_source(folder)
    env = os.environ | {"TZ": "Asia/Tokyo", "HOME": str(work)} | ({"CCACHE_DISABLE": "1"} if compiles else {})
    if shutil.which("ccache"):
        env.setdefault("CCACHE_DIR", run("ccache", "--get-config", "cache_dir").strip())  # HOME is another
    block = re.search(r"(?m)^    cmake --preset release -DTETHER_TESTS=OFF\n(?:    .*\n)+", PAGE)
    check(block, "deployment.md says how packages are built")
    for command in block[0].splitlines():
        if "--preset release -D" in command:
            command = shlex.join([*command.split(), *options_of(first, "TETHER_MAINTAINER")])
        begin = time.monotonic()
        run("nice", "-n", "12", "bash", "-c", command, cwd=folder, env=env, umask=0o077)
        print(f"{time.monotonic() - begin:.0f} s: {command.split('#')[0].strip()}", flush=True)
    check(re.match(r"\d+\.\d+\.\d+", run(work / "tether/bin/tether", "--version").split()[-1]), "installed")
    for name, package in packages_in(folder / "build/packages", PACKAGES["packaging"]).items():
        (before,) = (first / "packages").glob(f"{name}_*.deb")
        check(package.name == before.name, f"{package.name}, but {before.name}")
        if package.read_bytes() != before.read_bytes():
            differs = sorted(listing(before, work / "a") ^ listing(package, work / "b"))
            check(False, f"{name}: other bytes\n" + "\n".join(differs))
    print(f"{len(PACKAGES['packaging'])} packages have the same bytes")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=[*PACKAGES, "clone"])
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--compile", action="store_true")
    given = parser.parse_args()
    build = given.build.resolve()
    with tempfile.TemporaryDirectory() as folder:
        work, tree = pathlib.Path(folder), build.parent / f"{build.name}-{given.kind}"
        if given.kind == "clone":
            clone(build, given.compile, work)
        else:
            {"vehicle": vehicle, "packaging": packaging}[given.kind](build, tree, work)


main()
