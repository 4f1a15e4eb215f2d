"""Build backend of the package for pip (PEP 517; 660 for `pip install -e`), of the standard library alone: any pip
installs it without a network. The messages' descriptions come along from lcmtypes/."""

import base64
import hashlib
import pathlib
import re
import zipfile

HERE = pathlib.Path(__file__).resolve().parent
SOURCE = HERE.parent
WHEEL = "Wheel-Version: 1.0\nGenerator: tether\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
METADATA = """Metadata-Version: 2.1
Name: tether
Version: {version}
Summary: Controllers for Tether, and readers of its runs, sweeps and logs
License: BSD-3-Clause
Requires-Python: >=3.11
Provides-Extra: numpy
Requires-Dist: numpy; extra == "numpy"
Provides-Extra: pandas
Requires-Dist: pandas; extra == "pandas"
"""


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    files = {f"tether/{file.name}": file.read_bytes() for file in HERE.glob("tether/*.py")}
    files |= {f"tether/lcmtypes/{file.name}": file.read_bytes() for file in SOURCE.glob("lcmtypes/*.lcm")}
    return _write(wheel_directory, files)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    return _write(wheel_directory, {"tether.pth": f"{HERE}\n".encode()})


def build_sdist(sdist_directory, config_settings=None):
    raise NotImplementedError("the package is built in Tether's source tree, which also has lcmtypes/")


def _write(folder, files):
    """The wheel with these files; the same bytes each time. Returns its name."""
    version = re.search(r"VERSION (\d+\.\d+\.\d+)", (SOURCE / "CMakeLists.txt").read_text())[1]
    info = f"tether-{version}.dist-info"
    files |= {f"{info}/METADATA": METADATA.format(version=version).encode(), f"{info}/WHEEL": WHEEL.encode()}
    rows = [f"{name},sha256={_digest(data)},{len(data)}\n" for name, data in sorted(files.items())]
    files[f"{info}/RECORD"] = "".join([*rows, f"{info}/RECORD,,\n"]).encode()
    name = f"tether-{version}-py3-none-any.whl"
    with zipfile.ZipFile(pathlib.Path(folder) / name, "w", zipfile.ZIP_DEFLATED) as wheel:
        for path, data in sorted(files.items()):
            entry = zipfile.ZipInfo(path)
            entry.external_attr = 0o100644 << 16
            wheel.writestr(entry, data, zipfile.ZIP_DEFLATED)
    return name


def _digest(data):
    return base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
