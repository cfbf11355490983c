"""Work that blocks, in a thread of its own which nobody has to wait for.

A call into a file system whose server has gone may never return. Threads of asyncio's own are waited for when
the loop is closed and again when the process ends, so that one such call would keep a supervisor from ending.
"""

import asyncio
import concurrent.futures
import contextlib
import threading
from collections.abc import Callable
from typing import Final, TypeVar

FINISH_S: Final = 1.0
"""What is being done when the supervisor is stopped may finish for so long."""

Result = TypeVar("Result")


async def in_thread(work: Callable[[], Result]) -> Result:
    """Return what comes of ``work``, or raise what it raises. Who is cancelled waits a second at most."""
    done: concurrent.futures.Future[Result] = concurrent.futures.Future()

    def run() -> None:
        try:
            result = work()
        except BaseException as error:  # noqa: BLE001 - it is raised where it is waited for
            _end(done.set_exception, error)
        else:
            _end(done.set_result, result)

    threading.Thread(target=run, name="aside", daemon=True).start()
    waiting = asyncio.wrap_future(done)
    try:
        return await asyncio.shield(waiting)
    except asyncio.CancelledError:
        await asyncio.wait((waiting,), timeout=FINISH_S)
        raise


Value = TypeVar("Value")


def _end(finish: Callable[[Value], None], value: Value) -> None:
    # Nobody waits any more: it was cancelled, or the loop is closed.
    with contextlib.suppress(concurrent.futures.InvalidStateError, RuntimeError):
        finish(value)
