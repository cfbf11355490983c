"""Stopping a server of asyncio without leaving behind a connection that it has just accepted."""

import asyncio


def stop_serving(server: asyncio.Server) -> None:
    """Accept nothing from now on; close the listening sockets with the next turn of the loop.

    The loop makes the transport of an accepted connection in a task of its own. Where the server was closed
    before that task ran, it ends with an assertion that nobody sees, and the connection stays open, read by
    nobody (CPython, ``asyncio.Server._attach``). Every such task that there is by now runs before the server
    is closed here.
    """
    loop = asyncio.get_running_loop()
    for listening in server.sockets:
        loop.remove_reader(listening.fileno())
    loop.call_soon(server.close)


async def all_made() -> None:
    """Return when every connection that was accepted so far has reached its protocol.

    One turn of the loop makes its transport, the next one tells the protocol.
    """
    for _ in range(2):
        await asyncio.sleep(0)
