"""A process that another process of the gateway starts: its signals, and its end with its parent."""

import ctypes
import os
import signal
import sys
from typing import Final

PR_SET_PDEATHSIG: Final = 1
"""``prctl(2)``: the signal that a process gets when its parent has ended."""
READY: Final = signal.SIGUSR1
"""The signal of a child to its parent when it has begun its work."""
RELOADS: Final = signal.SIGHUP
"""Makes the supervisor reload the tables; a terminal that is closed sends it, too."""
HELD_BACK: Final = frozenset({signal.SIGTERM, signal.SIGINT, signal.SIGCHLD, RELOADS, READY})
"""Signals that the parent blocks and waits for; children inherit the block."""


def follow_parent(parent_pid: int, number: signal.Signals) -> None:
    """Receive all signals again, and get ``number`` when the parent ends; exit if it has ended.

    ``parent_pid`` 0: the process need not follow the one that started it. SIGHUP is ignored until the process
    handles it: a pending one would end the process here.
    """
    signal.signal(RELOADS, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, HELD_BACK)
    # A terminal with "stty tostop" would stop a process of another process group that writes a log line.
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    if not parent_pid:
        return
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, int(number), 0, 0, 0)
    if os.getppid() != parent_pid:
        sys.exit(1)


def notify_parent(parent_pid: int) -> None:
    """Signal the parent that the work has begun; nothing if ``parent_pid`` is 0."""
    if parent_pid and os.getppid() == parent_pid:
        os.kill(parent_pid, READY)
