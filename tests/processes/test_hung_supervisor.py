"""A file system that never answers: the supervisor can be stopped all the same."""

import fcntl
import os
import subprocess
import sys

from tests.support.commands import typed
from tests.support.gateway import Site
from tests.support.processes import ROOT, SECONDS, Running, started


def test_a_supervisor_whose_thread_hangs_ends_when_it_is_told_to(site: Site) -> None:
    assert typed("check", "--compile", str(site.config)).returncode == 0
    # Whoever writes into the state waits for this lock: a call that does not return, as of a dead server.
    lock = os.open(site.config.parent / "state" / "tables", os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = [sys.executable, "-P", "-m", "gateway.supervisor", str(site.config), "--log-format", "json"]
        with started(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
            gateway = Running(process)
            gateway.until("supervising")
            _wait_until_locked_out(process.pid)
            process.terminate()
            assert process.wait(SECONDS) == 0
    finally:
        os.close(lock)


def _wait_until_locked_out(pid: int) -> None:
    """Wait until a thread of a process waits for a lock of a file."""
    while True:
        with open("/proc/locks") as file:  # noqa: PTH123 - it has no size
            waiting = [line.split() for line in file if " -> " in line]
        if any(int(words[5]) == pid for words in waiting):
            return
