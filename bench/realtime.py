"""Real-time scheduling: whether this machine allows it, and asking for it in another process's name."""

import os
from collections.abc import Iterable


def realtime_refused(priority: int) -> str:
    """Return why SCHED_FIFO cannot be had; empty where it can."""
    pid = os.fork()
    if pid == 0:  # In a child: the bench itself must not run like that.
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as error:
            os._exit(error.errno or 1)
        os._exit(0)
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    return os.strerror(code) if code else ""


def make_fifo(pid: int, priority: int, cpus: Iterable[int]) -> None:
    """Put a process on SCHED_FIFO, on these processors (none: on all)."""
    os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(priority))
    if cpus:
        os.sched_setaffinity(pid, cpus)
