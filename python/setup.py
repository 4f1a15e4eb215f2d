"""pip install ./python: without a network, with Debian's setuptools. The messages' descriptions come
along from lcmtypes/."""

import pathlib
import re
import shutil

from setuptools import setup
from setuptools.command.build_py import build_py

SOURCE = pathlib.Path(__file__).resolve().parents[1]


class WithMessages(build_py):
    def run(self):
        super().run()
        folder = pathlib.Path(self.build_lib) / "tether" / "lcmtypes"
        folder.mkdir(parents=True, exist_ok=True)
        for file in (SOURCE / "lcmtypes").glob("*.lcm"):
            shutil.copy(file, folder)


setup(
    name="tether",
    version=re.search(r"VERSION (\d+\.\d+\.\d+)", (SOURCE / "CMakeLists.txt").read_text())[1],
    description="Controllers for Tether, and readers of its runs, sweeps and logs",
    license="BSD-3-Clause",
    python_requires=">=3.11",
    packages=["tether"],
    extras_require={"numpy": ["numpy"], "pandas": ["pandas"]},
    cmdclass={"build_py": WithMessages},
    zip_safe=False,
)
