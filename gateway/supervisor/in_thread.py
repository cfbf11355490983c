"""Runs blocking work in a thread that nothing has to wait for.

A call into a file system whose server has gone may never return. asyncio waits for its own threads when it
closes the loop, and again when the process ends. One such call would keep the supervisor from ending.
"""

import asyncio
import concurrent.futures
import contextlib
import threading
from collections.abc import Callable
from typing import Final, TypeVar

FINISH_S: Final = 1.0
"""Running work may take so long to finish when the supervisor is stopped."""

Result = TypeVar("Result")


async def in_thread(work: Callable[[], Result]) -> Result:
    """Return the result of ``work``, or raise its exception. A cancelled caller waits at most a second."""
    done: concurrent.futures.Future[Result] = concurrent.futures.Future()

    def run() -> None:
        try:
            result = work()
        except BaseException as error:  # noqa: BLE001 - it is raised in the waiting task
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
    # No task waits any more: it was cancelled, or the loop is closed.
    with contextlib.suppress(concurrent.futures.InvalidStateError, RuntimeError):
        finish(value)
