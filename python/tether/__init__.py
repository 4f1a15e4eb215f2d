"""Tether in Python: controllers of one's own, and what runs and sweeps leave behind.

    import tether

    def law(t, pose, path):
        target = path.at(t + 2.0)
        ...
        return v_mps, omega_radps

    tether.main(law)                                        # a program, simulated or live
    run = tether.simulate("scenarios/paper.toml", law)      # a run from here

docs/howto/python.md says more.
"""

from .controller import Controller
from .decision import Plan
from .lockstep import Lockstep, LockstepError
from .messages import decode, message_type, message_types
from .network import DEFAULT_URL, Network
from .path import Path, PathPoint, program
from .results import Logged, Run, Table, log_table, read_log, read_run, read_sweep
from .run import RunFailed, main, simulate

__all__ = [
    "Controller", "DEFAULT_URL", "Lockstep", "LockstepError", "Logged", "Network", "Path", "PathPoint",
    "Plan", "Run", "RunFailed", "Table", "decode", "log_table", "main", "message_type", "message_types",
    "program", "read_log", "read_run", "read_sweep", "simulate",
]
