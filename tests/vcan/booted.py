"""A booted system for the tests of the project's units: systemd as the first process of a process and
mount namespace of its own, whose root has this machine's /usr and the build folder as /tether, read-only, and an /etc of its
own. Its /usr can be one that packages are installed into. Only in a guest, which may be spoilt
(uml/with_can.sh --guest)."""

import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import textwrap

sys.path.insert(1, str(pathlib.Path(__file__).resolve().parents[1] / "live"))
from live_support import SOURCE, check, wait_until

UNITS = SOURCE / "systemd"
# Additions to a unit's own file: here as in /usr/lib/systemd/system.
HARDENING = "tether-.service.d/hardening.conf"

READ_ONLY = "mount --bind --read-only /usr usr"
# Writes to it stay in the guest's memory. dpkg knows what this machine has.
FOR_PACKAGES = """
    mkdir -p var/lib/dpkg/info var/lib/dpkg/updates var/lib/dpkg/triggers written worked
    cp /var/lib/dpkg/status var/lib/dpkg
    mount -t overlay -o lowerdir=/usr,upperdir=$PWD/written,workdir=$PWD/worked overlay usr
"""
BOOT = """
    set -e
    mount -t tmpfs tmpfs {root}
    cd {root}
    mkdir usr etc var proc sys dev run tmp root tether
    {usr}
    for folder in bin sbin lib lib64; do ln -s usr/$folder; done
    mount --bind --read-only {build} tether
    mount --rbind /dev dev
    mount -t sysfs sysfs sys
    mount -t cgroup2 cgroup2 sys/fs/cgroup
    mount -t tmpfs tmpfs run
    cp -a /etc/passwd /etc/group /etc/ld.so.cache /etc/nsswitch.conf etc
    echo 0123456789abcdef0123456789abcdef > etc/machine-id
    mkdir -p etc/systemd/system/tether-.service.d etc/tether
"""


class Booted:
    def __init__(self, test, bin_dir, for_packages=False):
        check(os.environ.get("TETHER_CAN_KERNEL") == "uml", "only under uml/with_can.sh --guest")
        self.root = pathlib.Path(tempfile.mkdtemp(dir="/run"))
        script = textwrap.dedent(BOOT).format(root=self.root, build=pathlib.Path(bin_dir).parent,
                                              usr=FOR_PACKAGES if for_packages else READ_ONLY)
        subprocess.run(["bash", "-c", script], check=True)
        # There is no journal.
        (self.units / HARDENING).with_name("said.conf").write_text("[Service]\nStandardOutput=append:/var/%N.said\n")
        (self.units / "test.target").write_text("[Unit]\nDefaultDependencies=no\n")
        if for_packages:
            self._take_packages(pathlib.Path(bin_dir).parent / "packages")
        else:
            self._give_units()

    def _take_packages(self, folder):
        self.packages = {}
        for which, files in (("now", folder.glob("tether-vehicle_*")), ("later", folder.glob("later/tether-vehicle_*"))):
            (file,) = files
            target = self.root / "root" / f"{which}.deb"
            target.write_bytes(file.read_bytes())
            self.packages[which] = (f"/root/{which}.deb", file.name.split("_")[1])

    def install(self, which, *options):
        """The vehicle's package: "now" or, of a later version, "later"."""
        file, version = self.packages[which]
        self.run("env", "DEBIAN_FRONTEND=noninteractive", "dpkg", *options, "--install", file)
        status = self.run("dpkg-query", "--show", "--showformat=${db:Status-Status} ${Version}", "tether-vehicle")
        check(status == f"installed {version}", status)

    def _give_units(self):
        shutil.copy(UNITS / "hardening.conf", self.units / HARDENING)
        for unit in UNITS.glob("*.service"):
            # From the build tree instead of the package.
            text = unit.read_text().replace("ExecStart=/usr/bin/tether", "ExecStart=/tether/bin/tether")
            (self.units / unit.name).write_text(text)
        user = subprocess.run(["systemd-sysusers", f"--root={self.root}", UNITS / "sysusers.conf"],
                              capture_output=True, text=True, check=False)
        check(user.returncode == 0 and "tether" in (self.root / "etc/passwd").read_text(), user.stderr)

    def start(self, test):
        """Until systemd takes orders."""
        boot = "mount -t proc proc /proc; exec /lib/systemd/systemd --system --unit=test.target --log-target=null"
        self.init = test.start("/usr/bin/unshare", "--kill-child", "--pid", "--fork", "--mount", "chroot", self.root, "/bin/sh", "-c", boot,
                               env={"container": "uml", "PATH": "/usr/bin:/usr/sbin"})
        self.pid = wait_until(20, self._first_process, "systemd's process")
        wait_until(90, lambda: self.ctl("is-system-running", check_it=False) in ("running", "degraded"), "systemd is up")

    def _first_process(self):
        # By its parent: a system that was started before may still be there, dead and not waited for.
        found = subprocess.run(["pgrep", "--parent", str(self.init.pid), "--exact", "systemd"],
                               capture_output=True, text=True, check=False).stdout.split()
        return found[0] if found else None

    @property
    def units(self):
        return self.root / "etc/systemd/system"

    def configure(self, **settings):
        text = "".join(f"{key}={value}\n" for key, value in settings.items())
        (self.root / "etc/tether/tether.env").write_text(text)

    def inside(self, *command):
        """The command that runs it there."""
        return ["/usr/bin/nsenter", "--target", self.pid, "--mount", "--pid", "--root", *map(str, command)]

    def run(self, *command, check_it=True):
        done = subprocess.run(self.inside(*command), capture_output=True, text=True, check=False)
        check(not check_it or done.returncode == 0, f"{command}: {done.stdout}{done.stderr}{self.said()}")
        return done.stdout.strip()

    def said(self):
        return "".join(f"--- {file.stem}\n{file.read_text()}" for file in self.root.glob("var/*.said"))

    def ctl(self, *words, check_it=True):
        return self.run("systemctl", *words, check_it=check_it)

    def show(self, unit, key):
        return self.ctl("show", unit, "--property", key, "--value")
