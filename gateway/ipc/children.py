"""One process that is started by another of ours: which signals it hears, and that it never outlives it."""

import ctypes
import os
import signal
import sys
from typing import Final

PR_SET_PDEATHSIG: Final = 1
"""``prctl(2)``: the signal that a process gets when its parent has ended."""
READY: Final = signal.SIGUSR1
"""What a child sends to its parent when it has begun its work."""
RELOADS: Final = signal.SIGHUP
"""Has the supervisor read the tables anew; a terminal that is closed sends it, too."""
HELD_BACK: Final = frozenset({signal.SIGTERM, signal.SIGINT, signal.SIGCHLD, RELOADS, READY})
"""Signals that the parent waits for instead of being interrupted by them; children inherit that."""


def follow_parent(parent_pid: int, number: signal.Signals) -> None:
    """Hear all signals again, and get ``number`` when the parent ends; ends at once where it has already.

    ``parent_pid`` 0: started by somebody else, whom it need not follow. A hangup means nothing before the
    process says what it means: one that has waited meanwhile would end it here.
    """
    signal.signal(RELOADS, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, HELD_BACK)
    # In a process group of its own, a terminal with "stty tostop" would stop whoever writes a log line.
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    if not parent_pid:
        return
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, int(number), 0, 0, 0)
    if os.getppid() != parent_pid:
        sys.exit(1)


def notify_parent(parent_pid: int) -> None:
    """Tell the parent that the work has begun; nobody where ``parent_pid`` is 0."""
    if parent_pid and os.getppid() == parent_pid:
        os.kill(parent_pid, READY)
