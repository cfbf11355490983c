"""What takes the place of ``gateway.system``: the same names, over the simulated machine.

``standins.install`` puts it there before anything of the gateway is imported.
"""

import time
from collections.abc import Callable
from functools import partial
from typing import Final, NoReturn

from tests.year.machine import BEGINS_WALL_S, HUNG_UP, Machine, S, Timer
from tests.year.machine import Epoll as SimulatedEpoll
from tests.year.machine import Selector as SimulatedSelector

MACHINE: Final = Machine()
"""The simulated process. Each seed is played by another interpreter, so there is one."""
CLOCK: Final = time.CLOCK_BOOTTIME
Wait = Callable[[int, int], list[tuple[int, int]]]
IN_C: Final = None
Epoll: Final = partial(SimulatedEpoll, MACHINE)
Selector: Final = partial(SimulatedSelector, MACHINE)
_descriptors: Final = MACHINE.descriptors


def boot_ns() -> int:
    """See ``gateway.system``."""
    return MACHINE.now_ns - MACHINE.booted_ns


monotonic_ns = boot_ns
"""The machine is never suspended."""


def wall_ns() -> int:
    """See ``gateway.system``."""
    return BEGINS_WALL_S * S + MACHINE.now_ns + MACHINE.wall_ahead_ns


def wall_s() -> float:
    """See ``gateway.system``."""
    return wall_ns() / S


def random_bytes(size: int) -> bytes:
    """See ``gateway.system``."""
    return MACHINE.random.randbytes(size)


def end_now(_code: int) -> NoReturn:
    """See ``gateway.system``."""
    MACHINE.kill()


def boot_id() -> bytes:
    """See ``gateway.system``."""
    return MACHINE.boots.to_bytes(16, "big")


def read(number: int, size: int) -> bytes:
    """See ``gateway.system``."""
    MACHINE.check()
    found = _descriptors.get(number) or MACHINE.descriptor(number)
    return found.read(size)


def write(number: int, data: bytes) -> int:
    """See ``gateway.system``; a kill is due before or after its bytes have left."""
    MACHINE.check()
    found = _descriptors.get(number) or MACHINE.descriptor(number)
    if MACHINE.writes_left:
        MACHINE.writes_left -= 1
        if not MACHINE.writes_left:
            if MACHINE.random.random() < 0.5:
                found.write(data)
            MACHINE.kill()
    return found.write(data)


def close(number: int) -> None:
    """See ``gateway.system``."""
    MACHINE.descriptor(number).close()


def waiting(epoll: SimulatedEpoll) -> Wait:
    """See ``gateway.system``."""
    return epoll.wait


def hang_ups(number: int) -> Callable[[int], list[tuple[int, int]]]:
    """See ``gateway.system``."""
    found = MACHINE.descriptor(number)

    def hung_up(_timeout: int) -> list[tuple[int, int]]:
        events = found.events & HUNG_UP
        return [(number, events)] if events else []

    return hung_up


def create_timer() -> int:
    """See ``gateway.system``."""
    return Timer(MACHINE).number


def set_at(number: int, deadline_ns: int) -> None:
    """See ``gateway.system``."""
    timer = MACHINE.descriptor(number)
    assert isinstance(timer, Timer)
    timer.set_at(deadline_ns)


def is_pty(_descriptor: int) -> bool:
    """See ``gateway.system``."""
    return False
