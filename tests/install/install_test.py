#!/usr/bin/env python3
"""install_test.py BUILD: what `cmake --install` puts somewhere works there, in any folder, without the
source; another project builds with it; the vehicle's part needs no ODE and its like; and Debian's tools
take the packages."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
import time

BUILD = pathlib.Path(sys.argv[1])
SOURCE = pathlib.Path(__file__).resolve().parents[2]
VEHICLE = ["tether-vehicle", "tether-autonomy", "tether-can-bridge", "tether-can-drive", "tether-link", "tether-localiser"]
PACKAGES = ["python3-tether-env", "python3-tether", "tether-dev", "tether-doc", "tether-vehicle", "tether"]  # by file name
NOT_ON_A_VEHICLE = ["libode", "libsqlite3", "libmuparser", "libzstd"]


def check(condition, what):
    if not condition:
        sys.exit(f"FAILED: {what}")


def run(*command, expect=0, **options):
    done = subprocess.run([str(word) for word in command], text=True, capture_output=True, **options)
    check(done.returncode == expect,
          f"{' '.join(map(str, command))}: exit code {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr


def works_in_any_folder(work):
    prefix, away = work / "prefix", work / "away"
    away.mkdir()
    run("cmake", "--install", BUILD, "--prefix", prefix)
    anywhere = {"cwd": away, "env": {"PATH": f"{prefix}/bin:/usr/bin:/bin", "HOME": str(away)}}

    # The files that the README names, and those that they name.
    for scenario in ("paper", "warehouse_lap", "hil_vcan", "factory"):
        said = run("tether", "run", f"scenarios/{scenario}.toml", "--set", "run.duration_s=1", **anywhere)
        check("simulated in" in said, said)
    said = run("tether", "run", "--processes", "scenarios/paper.toml", "--set", "run.duration_s=1", **anywhere)
    check("simulated in" in said, said)
    run("tether", "sweep", "experiments/f2_prr.toml", "--quick", "--set", "run.duration_s=1", "--set",
        "vehicle.plant=kinematic", "--out", "out/f2", "--report", **anywhere)
    check((away / "out/f2/f2_prr.png").exists(), f"no figure in {sorted((away / 'out/f2').iterdir())}")
    # A file of one's own comes first; what is nowhere is named as it was given.
    (away / "scenarios").mkdir()
    (away / "scenarios/paper.toml").write_text("nonsense = 1\n")
    said = run("tether", "run", "scenarios/paper.toml", expect=2, **anywhere)
    check("scenarios/paper.toml" in said and str(prefix) not in said, said)
    said = run("tether", "run", "scenarios/none.toml", expect=2, **anywhere)
    check('"scenarios/none.toml": No such file' in said, said)

    run("tether", "run", prefix / "share/tether/scenarios/paper.toml", "--set", "run.duration_s=1", "--out", "run",
        **anywhere)
    read = "import tether; print(len(tether.read_run('run').table('SIM/TRUTH')['t_s']) > 20, tether.__file__)"
    anywhere["env"]["PYTHONPATH"] = str(prefix / "lib/python3/dist-packages")
    said = run("/usr/bin/python3", "-B", "-c", read, **anywhere)
    check("True" in said and str(prefix) in said, said)
    run("tether", "log", "page", "run/run.lcmlog", "--out", "page.html", **anywhere)
    check((away / "page.html").stat().st_size > 100_000, "the page is there")
    for page in ["tether", *VEHICLE]:
        said = run("man", "-l", prefix / f"share/man/man1/{page}.1.gz", **anywhere) if (
            pathlib.Path("/usr/bin/man").exists()) else run("gzip", "-dc", prefix / f"share/man/man1/{page}.1.gz")
        check(page in said, said[:200])
        run("bash", "-n", prefix / "share/bash-completion/completions" / page)
        check((prefix / f"share/zsh/vendor-completions/_{page}").exists(), page)
    names_the_source = [str(file.relative_to(prefix)) for file in prefix.rglob("*") if file.is_file() and
                        file.parent.name != "bin" and file.suffix != ".so" and str(SOURCE).encode() in file.read_bytes()]
    check(not names_the_source, f"{SOURCE} stands in {names_the_source}")
    return prefix


def another_project_builds_with_it(work, prefix):
    run("cmake", "-S", SOURCE / "tests/install/foreign", "-B", work / "foreign", "-G", "Ninja",
        f"-DCMAKE_PREFIX_PATH={prefix}", f"-DCONTROLLER={prefix}/share/doc/tether/examples/controller.cpp",
        "-DCMAKE_CXX_FLAGS=-Wall -Wextra -Werror")
    run("cmake", "--build", work / "foreign")
    # And without CMake.
    flags = run("pkg-config", "--cflags", "--libs", "tether", env=os.environ | {"PKG_CONFIG_PATH": f"{prefix}/share/pkgconfig"})
    page = (SOURCE / "docs/howto/deployment.md").read_text().partition("### A controller of your own")[2]
    blocks = [textwrap.dedent(block) for block in re.findall(r"(?m)(?:^    .*\n)+", page)]
    check([block.split("(")[0].split(" ")[0] for block in blocks] == ["find_package", "#include"], f"blocks of the page: {blocks}")
    mine = work / "mine"
    mine.mkdir()
    (mine / "mine.cpp").write_text(blocks[1])
    run("c++", "-std=c++17", mine / "mine.cpp", *flags.split(), "-o", work / "without_cmake")
    find, link = blocks[0].splitlines()
    (mine / "CMakeLists.txt").write_text(f"cmake_minimum_required(VERSION 3.25)\nproject(mine LANGUAGES CXX)\n{find}\n"
                                         f"add_executable(mine mine.cpp)\n{link}\n")
    run("cmake", "-S", mine, "-B", mine / "build", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={prefix}")
    run("cmake", "--build", mine / "build")
    for program in (work / "without_cmake", mine / "build/mine"):
        check("--lcm-url" in run(program, "--help", expect=2), "the page's controller runs")
    includes = run("ninja", "-C", work / "foreign", "-t", "deps")
    check(f"{prefix}/include/tether/tether/pose_t.hpp" in includes and str(SOURCE) not in includes, includes)


def the_vehicles_part_needs_no_simulator():
    for program in VEHICLE:
        libraries = run("readelf", "--dynamic", BUILD / "bin" / program)
        check(not any(name in libraries for name in NOT_ON_A_VEHICLE), f"{program}: {libraries}")


def debian_takes_the_packages():
    """Its output stays, for can_packages_test and can_deployed_test; and so does the vehicle's part as of a later version."""
    made = BUILD / "packages"
    shutil.rmtree(made, ignore_errors=True)
    cpack = ("cpack", "-G", "DEB", "--config", BUILD / "CPackConfig.cmake")
    run(*cpack, "-B", made)
    run(*cpack, "-B", made / "later", "-D", "CPACK_PACKAGE_VERSION=99.1", "-D", "CPACK_COMPONENTS_ALL=vehicle")
    packages = sorted(made.glob("*.deb"))
    time.sleep(1.1)
    run(*cpack, "-B", made / "again")
    other = [p.name for p in packages if p.read_bytes() != (made / "again" / p.name).read_bytes()]
    check(not other, f"made twice, these differ: {other}")
    shutil.rmtree(made / "again")
    check(all("+" in p.name for p in packages) or not (SOURCE / ".git").exists(), f"no build in the version: {packages}")
    check([p.name.split("_")[0] for p in packages] == PACKAGES, packages)
    print(run("lintian", "--allow-root", "--fail-on", "error", *packages).strip())
    files = [line.split()[5] for p in packages for line in run("dpkg", "-c", p).splitlines() if not line.endswith("/")]
    check(len(files) == len(set(files)), f"in two packages: {sorted({f for f in files if files.count(f) > 1})}")
    # Without recommendations: of lcm-spy and figures, tether-vehicle has nothing, and neither needs Java.
    said = run("dpkg-deb", "--field", packages[-1], "Recommends", "Suggests")
    check("jre" in said.partition("Suggests:")[2] and "jre" not in said.partition("Suggests:")[0], said)
    print(run("apt-get", "--simulate", "--no-install-recommends", "install", *packages).strip().splitlines()[-1])


with tempfile.TemporaryDirectory() as folder:
    where = pathlib.Path(folder)
    another_project_builds_with_it(where, works_in_any_folder(where))
    the_vehicles_part_needs_no_simulator()
    debian_takes_the_packages()
