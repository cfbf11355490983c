"""Tasks that end when they are told to.

``asyncio.wait_for`` of Python 3.11, with which the MQTT library waits for everything, returns its result
where a cancellation comes at the same moment, and the cancellation is lost. So whoever has to hear one does
not wait for the library himself: a task does, and is told again until it has ended.
"""

import asyncio
from collections.abc import Coroutine, Iterable
from typing import Any, Final, TypeVar

AGAIN_S: Final = 0.1

Result = TypeVar("Result")


async def apart(work: Coroutine[Any, Any, Result]) -> Result:
    """Return what comes of ``work``; a cancellation ends both, whatever ``work`` makes of it."""
    task = asyncio.create_task(work)
    try:
        await asyncio.wait((task,))
    except asyncio.CancelledError:
        await end((task,))
        raise
    return task.result()


async def end(tasks: Iterable[asyncio.Task[Any]]) -> None:
    """Cancel tasks until all of them have ended."""
    running = {task for task in tasks if not task.done()}
    while running:
        for task in running:
            task.cancel()
        _, running = await asyncio.wait(running, timeout=AGAIN_S)
