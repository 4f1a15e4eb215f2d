"""Hosts for tests of the link, as network namespaces."""

import ctypes
import os
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "live"))

from live_support import TYPES, LcmType, Network, check, wait_until  # noqa: E402

TYPES["LINK/REPORT"] = LcmType("peer_report")
CLONE_NEWNET = 0x40000000


def shell(text):
    done = subprocess.run(["sh", "-c", text], capture_output=True, text=True)
    check(done.returncode == 0, f"{text}: {done.stderr}")


class Host:
    """A network namespace that lives as long as a process in it."""

    def __init__(self, test):
        self._sleeper = test.start("/usr/bin/env", "unshare", "--net", "sleep", "1000")
        own = os.readlink("/proc/self/ns/net")
        pid = self._sleeper.pid
        wait_until(5, lambda: os.readlink(f"/proc/{pid}/ns/net") != own, "a namespace")
        self.enter = ["nsenter", f"--net=/proc/{pid}/ns/net"]
        self.pid = pid
        self.shell("ip link set lo up && ip route add 224.0.0.0/4 dev lo")

    def shell(self, text):
        shell(" ".join(self.enter) + f" sh -c '{text}'")

    def network(self):
        """On the LCM network of that host: a socket stays where it was opened."""
        libc = ctypes.CDLL(None, use_errno=True)
        home = os.open("/proc/self/ns/net", os.O_RDONLY)
        there = os.open(f"/proc/{self.pid}/ns/net", os.O_RDONLY)
        check(libc.setns(there, CLONE_NEWNET) == 0, os.strerror(ctypes.get_errno()))
        network = Network()
        check(libc.setns(home, CLONE_NEWNET) == 0, os.strerror(ctypes.get_errno()))
        os.close(home)
        os.close(there)
        return network


def veth(near, near_name, far, far_name, network):
    """A cable between two hosts: .1 and .2 of `network`, such as "10.77.0"."""
    shell("ip link add name v0near type veth peer name v0far")
    for there, name, host, number in (("v0near", near_name, near, 1), ("v0far", far_name, far, 2)):
        shell(f"ip link set {there} netns {host.pid} name {name}")
        host.shell(f"ip address add {network}.{number}/24 dev {name} && ip link set {name} up")
