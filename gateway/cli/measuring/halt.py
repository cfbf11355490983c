"""The wish to stop: it comes at any time, and is obeyed between two exchanges, never inside one."""

import asyncio
from collections.abc import Coroutine
from typing import TypeVar

from gateway.cli.measuring.errors import StoppedError

Result = TypeVar("Result")


class Halt:
    """Every wait of a measuring run goes through here, and ends at once when somebody wants it to stop."""

    def __init__(self) -> None:
        self._asked = asyncio.Event()
        self._why = ""

    def ask(self, why: str) -> None:
        """Ask for the end; the first reason is the one that is told."""
        if not self._asked.is_set():
            self._why = why
            self._asked.set()

    def check(self) -> None:
        """Raise StoppedError if the end was asked for."""
        if self._asked.is_set():
            raise StoppedError(self._why)

    async def wait(self, seconds: float) -> None:
        """Wait. Raises StoppedError as soon as the end is asked for."""
        self.check()
        try:
            async with asyncio.timeout(seconds):
                await self._asked.wait()
        except TimeoutError:
            return
        self.check()

    async def during(self, work: Coroutine[object, object, Result]) -> Result:
        """Return what ``work`` brings; it is cancelled when the end is asked for first.

        Raises:
            StoppedError: it was.
        """
        if self._asked.is_set():
            work.close()
            self.check()
        task = asyncio.ensure_future(work)
        asked = asyncio.ensure_future(self._asked.wait())
        try:
            await asyncio.wait((task, asked), return_when=asyncio.FIRST_COMPLETED)
            if task.done():
                return task.result()
            raise StoppedError(self._why)
        finally:
            for each in (task, asked):
                each.cancel()
            await asyncio.gather(task, asked, return_exceptions=True)
