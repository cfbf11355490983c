"""How the system runs the relay's thread: on which CPUs, at which priority, and with locked memory.

All of it is optional. A refused setting is a problem with a remedy and never ends the relay: the correction
works without it, only less evenly. Sources: sched(7), mlockall(2), getrlimit(2).
"""

import ctypes
import errno
import os
import resource
import signal
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Final

from gateway.state.plan import RelayOptions
from gateway.status.model import Scheduling

PROC_STATUS: Final = Path("/proc/self/status")
RLIMIT_RTPRIO: Final = 14
RLIMIT_RTTIME: Final = 15
"""Python's ``resource`` does not name it; from ``asm-generic/resource.h``, the same on x86 and ARM."""
SPIN_US: Final = 200_000
"""The relay may compute this long without a wait; then it loses its real-time priority. A loop that never
waits has met a bug or a flood, and at this priority would take a whole CPU from all other programs."""
MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
CAP_IPC_LOCK: Final = 14
SPARE_FACTOR: Final = 4
"""A limit must allow this many times what is mapped at start. Beyond a limit every later mapping would
fail."""

REALTIME_REMEDY: Final = (
    "run pitch-gateway service CONFIG --systemd /etc/systemd/system; or in a unit of your own: "
    "LimitRTPRIO={priority} or AmbientCapabilities=CAP_SYS_NICE, "
    "and no RestrictRealtime=yes"
)
MEMORY_REMEDY: Final = (
    "run pitch-gateway service CONFIG --systemd /etc/systemd/system; or in a unit of your own: "
    "LimitMEMLOCK=infinity or AmbientCapabilities=CAP_IPC_LOCK"
)


@dataclass(frozen=True, slots=True)
class RefusedSetting:
    """One key of ``[relay]`` that the system did not grant."""

    key: str
    asked: object
    detail: str
    remedy: str


def schedule(options: RelayOptions, on_withdrawn: Callable[[str], None]) -> tuple[RefusedSetting, ...]:
    """Request all settings of ``options`` from the system; return those that it refused.

    Call it on the thread of the loop, when everything is loaded and open. ``on_withdrawn`` is called when the
    thread lost its real-time priority because it did not wait for ``SPIN_US``.
    """
    return tuple(_refusals(options, on_withdrawn))


def in_force() -> Scheduling:
    """Read from the kernel how the calling thread is scheduled now."""
    is_fifo = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    return Scheduling(
        fifo=os.sched_getparam(0).sched_priority if is_fifo else 0,
        cpus=sorted(os.sched_getaffinity(0)),
        memory_locked=_status_number("VmLck") > 0,
    )


def memory_problem(limit_bytes: int, mapped_bytes: int, *, is_capable: bool) -> str:
    """Return why locking could make a later mapping fail, "" if it cannot. ``limit_bytes`` -1: no limit.

    >>> memory_problem(8 << 20, 100 << 20, is_capable=False)
    'RLIMIT_MEMLOCK is 8 MiB; needed: 400 MiB, 4 times what is mapped now'
    """
    needed = SPARE_FACTOR * mapped_bytes
    if is_capable or limit_bytes == resource.RLIM_INFINITY or limit_bytes >= needed:
        return ""
    return (
        f"RLIMIT_MEMLOCK is {limit_bytes >> 20} MiB; "
        f"needed: {needed >> 20} MiB, {SPARE_FACTOR} times what is mapped now"
    )


def numbers_text(numbers: Iterable[int]) -> str:
    """Write CPU numbers as the kernel does.

    >>> numbers_text({0, 1, 2, 5})
    '0-2,5'
    """
    runs: list[list[int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1][1] = number
        else:
            runs.append([number, number])
    return ",".join(f"{first}" if first == last else f"{first}-{last}" for first, last in runs)


def _refusals(options: RelayOptions, on_withdrawn: Callable[[str], None]) -> Iterator[RefusedSetting]:
    # The priority comes last: the steps before it run at normal priority.
    if options.cpus and (refused := _pin(options.cpus)):
        yield refused
    if options.lock_memory and (refused := _lock_memory()):
        yield refused
    if options.fifo and (refused := _go_first(options.fifo, on_withdrawn)):
        yield refused


def _pin(cpus: tuple[int, ...]) -> RefusedSetting | None:
    before = os.sched_getaffinity(0)
    missing = set(cpus)
    why = ""
    try:
        os.sched_setaffinity(0, cpus)
        missing -= os.sched_getaffinity(0)
    except OSError as error:  # EINVAL: none of them exists
        why = "" if error.errno == errno.EINVAL else error.strerror or str(error)
    else:
        if not missing:
            return None
        # The kernel takes the existing ones and does not report the others.
        os.sched_setaffinity(0, before)
    return RefusedSetting(
        "relay.cpus",
        list(cpus),
        why or f"no CPU {numbers_text(missing)} for this process",
        f"name some of {numbers_text(before)}, on which the process runs; this machine has "
        f"{_online_cpus()}, and AllowedCPUs= of the systemd unit says which of them the process may have",
    )


def _online_cpus() -> str:
    try:
        return Path("/sys/devices/system/cpu/online").read_text().strip()
    except OSError:
        return f"0-{(os.cpu_count() or 1) - 1}"


def _lock_memory() -> RefusedSetting | None:
    limit_bytes, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    is_capable = bool(_status_number("CapEff", 16) >> CAP_IPC_LOCK & 1)
    why = memory_problem(limit_bytes, _status_number("VmSize") << 10, is_capable=is_capable)
    libc = ctypes.CDLL(None, use_errno=True)
    # Current pages, and later ones when they are touched. Locked whole, each thread's stack would take 8 MiB.
    if not why and libc.mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT):
        why = os.strerror(ctypes.get_errno())
    if why:
        return RefusedSetting("relay.lock_memory", True, why, MEMORY_REMEDY)
    for start, size in _mapped_files():
        libc.mlock(ctypes.c_void_p(start), ctypes.c_size_t(size))  # read code now that has not run yet
    return None


def _mapped_files() -> list[tuple[int, int]]:
    """Return where programs and libraries are mapped, in bytes: address and size (proc_pid_maps(5))."""
    try:
        lines = Path("/proc/self/maps").read_text().splitlines()
    except OSError:
        return []
    ranges = [
        parts[0].split("-")
        for line in lines
        if len(parts := line.split(maxsplit=5)) == 6 and parts[1].startswith("r") and parts[5].startswith("/")
    ]
    return [(int(first, 16), int(end, 16) - int(first, 16)) for first, end in ranges]


def _go_first(priority: int, on_withdrawn: Callable[[str], None]) -> RefusedSetting | None:
    try:
        # Threads that start later (host names, recordings) must not inherit it.
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))
    except OSError as error:
        if in_force().fifo != priority:  # else systemd has set it, and forbids the call
            return RefusedSetting(
                "relay.fifo", priority, _why_not_first(error), REALTIME_REMEDY.format(priority=priority)
            )
    _limit_spinning(on_withdrawn)
    return None


def _why_not_first(error: OSError) -> str:
    why = error.strerror or str(error)
    return f"{why}; RLIMIT_RTPRIO is {resource.getrlimit(RLIMIT_RTPRIO)[0]}"


def _limit_spinning(on_withdrawn: Callable[[str], None]) -> None:
    def withdraw(_number: int, _frame: FrameType | None) -> None:
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))
        on_withdrawn(
            f"computed for {SPIN_US // 1000} ms without waiting; "
            "goes on with an ordinary priority until it is started again"
        )

    _, hard = resource.getrlimit(RLIMIT_RTTIME)
    soft = SPIN_US if hard == resource.RLIM_INFINITY else min(SPIN_US, hard)
    signal.signal(signal.SIGXCPU, withdraw)  # by default the signal ends the process
    resource.setrlimit(RLIMIT_RTTIME, (soft, hard))


def _status_number(key: str, base: int = 10) -> int:
    """Return a number of the process's own status (proc_pid_status(5)); sizes are in KiB."""
    try:
        lines = PROC_STATUS.read_text().splitlines()
    except OSError:
        return 0
    for line in lines:
        name, _, value = line.partition(":")
        if name == key:
            return int(value.split()[0], base)
    return 0
