"""An answer without an end."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing

from starlette.responses import Response
from starlette.types import Receive, Scope, Send


class EndlessResponse(Response):
    """Sends parts until whoever asked has gone, ``is_over`` returns, or the task that sends is cancelled.

    Starlette's own leaves cancelling to anyio, which lets a task be as long as there is something new for it
    in every turn of the loop.
    """

    def __init__(
        self,
        parts: AsyncGenerator[bytes, None],
        headers: dict[str, str],
        media_type: str,
        is_over: Callable[[], Awaitable[None]] | None = None,
    ) -> None:
        super().__init__(headers=headers, media_type=media_type)
        self._is_over = is_over
        del self.headers["content-length"]
        self._parts = parts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        start = {"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers}
        await send(start)
        tasks = [asyncio.create_task(self._send(send)), asyncio.create_task(_until_gone(receive))]
        if self._is_over is not None:
            tasks.append(asyncio.ensure_future(self._is_over()))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            ended, *_ = await asyncio.gather(*tasks, return_exceptions=True)
        if isinstance(ended, Exception):
            raise ended
        if isinstance(ended, asyncio.CancelledError):  # not its own end
            await send({"type": "http.response.body"})

    async def _send(self, send: Send) -> None:
        async with aclosing(self._parts) as parts:
            async for part in parts:
                await send({"type": "http.response.body", "body": part, "more_body": True})
        await send({"type": "http.response.body"})


async def _until_gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
