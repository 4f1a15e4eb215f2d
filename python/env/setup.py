"""pip install ./python/env: without a network, with Debian's setuptools. CMake builds what is compiled, in
$TETHER_BUILD, or else in the source tree's build/release."""

import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig

from setuptools import Distribution, setup
from setuptools.command.build_py import build_py

SOURCE = pathlib.Path(__file__).resolve().parents[2]
BUILD = pathlib.Path(os.environ.get("TETHER_BUILD") or SOURCE / "build" / "release").resolve()


def built_in():
    """The source tree that the build is of."""
    cache = BUILD / "CMakeCache.txt"
    if not cache.exists():
        subprocess.run(["cmake", "--preset", "release", f"-DPython3_EXECUTABLE={sys.executable}"], cwd=SOURCE, check=True)
    return pathlib.Path(re.search(r"^CMAKE_HOME_DIRECTORY:INTERNAL=(.*)$", cache.read_text(), re.MULTILINE)[1])


class Built(build_py):
    def run(self):
        super().run()
        subprocess.run(["cmake", "--build", BUILD, "--target", "tether_env"], check=True)
        built = BUILD / "python" / "tether_env"
        core = built / f"_core{sysconfig.get_config_var('EXT_SUFFIX')}"
        if not core.exists():
            sys.exit(f"{BUILD} is for another Python: there is no {core.name}. Configure it again with: "
                     f"cmake --preset release -DPython3_EXECUTABLE={sys.executable}")
        shutil.copy(core, pathlib.Path(self.build_lib) / "tether_env")


class Compiled(Distribution):
    def has_ext_modules(self):
        return True


setup(
    name="tether-env",
    version=re.search(r"VERSION (\d+\.\d+\.\d+)", (built_in() / "CMakeLists.txt").read_text())[1],
    description="Tether's closed loop as an environment by Gymnasium's contract",
    license="BSD-3-Clause",
    python_requires=">=3.11",
    packages=["tether_env"],
    install_requires=["numpy"],
    distclass=Compiled,
    cmdclass={"build_py": Built},
    zip_safe=False,
)
