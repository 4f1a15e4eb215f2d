#!/usr/bin/python3 -IS
"""The first process in the guest of with_can.sh: makes a usable system, runs the command, powers
off. All with system calls of its own: starting programs is slow in there, a machine without modules
has no insmod, and in a user namespace of the host no program is set-user-id root.

The folder $tether_job, from the kernel's command line, is the host's; it has the command with its
environment and gets its exit code."""

import ctypes
import os
import re
import select
import termios
import traceback
from subprocess import PIPE, STDOUT, Popen

MODULES = {
    "vcan": ("can", "can-raw", "can-bcm", "can-dev", "vcan", "vxcan", "slcan", "can-gw", "veth", "sch_netem", "overlay"),
    "netem": ("sch_netem", "sch_prio", "veth"),
}

FINIT_MODULE = 313  # on x86-64, the only machine that User-Mode Linux has
POWER_OFF = 0x4321FEDC  # linux/reboot.h

libc = ctypes.CDLL(None, use_errno=True)


def checked(result, what):
    if result != 0:
        raise RuntimeError(f"{what}: {os.strerror(ctypes.get_errno())}")


def mount(kind, folder, options=""):
    os.makedirs(folder, exist_ok=True)
    arguments = (kind.encode(), folder.encode(), kind.encode(), 0, options.encode())
    checked(libc.mount(*arguments), f"mounting {folder}")


def make_system():
    mount("proc", "/proc")
    mount("sysfs", "/sys")
    mount("tmpfs", "/run")
    mount("tmpfs", "/dev/shm")
    mount("devpts", "/dev/pts", "mode=620,ptmxmode=666")
    if not os.path.lexists("/dev/fd"):
        os.symlink("/proc/self/fd", "/dev/fd")
    os.mkdir("/run/home")
    os.mkdir("/run/tmp")


def load_modules():
    folder = f"/usr/lib/uml/modules/{os.uname().release}/"
    with open(folder + "modules.dep") as dependencies:
        files = {m[2]: m[1] for m in re.finditer(r"^(\S*/(\S+)\.ko):", dependencies.read(), re.M)}
    for name in MODULES[os.environ["tether_network"]]:
        with open(folder + files[name], "rb") as module:
            checked(libc.syscall(FINIT_MODULE, module.fileno(), b"", 0), f"loading {name}")


def run_command(job):
    folder = os.path.dirname(os.path.realpath(__file__))
    network = f"{folder}/{os.environ['tether_network']}_network.sh"
    script = f"""
        . {job}/environment && cd "$PWD" &&
        export HOME=/run/home TMPDIR=/run/tmp TETHER_OWN_NETWORK=yes &&
        eval "exec {network} $(cat {job}/command)"
    """
    # Through a pipe, as in a CTest: programs write differently to a terminal.
    with Popen(["/bin/bash", "-c", script], stdout=PIPE, stderr=STDOUT) as process:
        copy_output(process)
    return process.returncode if process.returncode >= 0 else 128 - process.returncode


def copy_output(process):
    """Until the process has ended, though a child that it left behind still has the pipe."""
    pipe = process.stdout.fileno()
    while True:
        ended = process.poll() is not None
        if select.select([pipe], [], [], 0 if ended else 0.05)[0]:
            if not (data := os.read(pipe, 65536)):
                return
            while data:
                data = data[os.write(1, data) :]
        elif ended:
            return


def main():
    job = os.environ["tether_job"]
    terminal = os.open("/dev/ttyS0", os.O_RDWR)
    modes = termios.tcgetattr(terminal)
    modes[1] &= ~termios.OPOST  # line ends as the command writes them
    termios.tcsetattr(terminal, termios.TCSANOW, modes)
    os.dup2(os.open("/dev/null", os.O_RDONLY), 0)
    os.dup2(terminal, 1)
    os.dup2(terminal, 2)
    try:
        make_system()
        load_modules()
        code = run_command(job)
    except Exception:
        traceback.print_exc()
        code = 1
    with open(job + "/exit_code", "w") as file:
        file.write(f"{code}\n")
    termios.tcdrain(terminal)
    os.sync()
    libc.reboot(POWER_OFF)


main()
