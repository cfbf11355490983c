"""The HTTP service: two listeners, opened again and again until they are open, and never fatal."""

import asyncio
import contextlib
import os
import socket
from typing import Any, Final

from gateway.catalogue.publishing_events import HTTP_NOT_OPEN, HTTP_READY
from gateway.config.check_lines import is_loopback
from gateway.config.gateway_model import HttpSection
from gateway.ipc.place import SUPERVISOR_SOCKET_NAME, SocketError, SocketPlace
from gateway.supervisor.http.application import LOCAL_PATHS, PATHS, Served
from gateway.supervisor.http.door import Door
from gateway.supervisor.http.guard import READS, Guard, Rules
from gateway.supervisor.http.limits import LOCAL, TCP, Limits
from gateway.supervisor.http.window import Window
from gateway.transport.endpoints import TcpEndpoint

FIRST_WAIT_S: Final = 0.5
LONGEST_WAIT_S: Final = 30.0


class HttpService:
    """Serves the status on the configured address and on ``supervisor.sock`` in the state folder.

    :meth:`run` runs until cancelled; :meth:`configure` may be called before and at any time.
    """

    def __init__(self, window: Window, tcp: Limits = TCP, local: Limits = LOCAL) -> None:
        self._window = window
        self._limits = {"tcp": tcp, "local": local}
        self._wanted: TcpEndpoint | None = None
        self._changed = asyncio.Event()
        self._address: str | None = None
        self._tcp_problem: str | None = None
        self._local_problem: str | None = None

    def configure(self, section: HttpSection) -> None:
        """Listen where a configuration says from now on; the same as before changes nothing."""
        if section.endpoint != self._wanted:
            self._wanted = section.endpoint
            self._changed.set()

    @property
    def status(self) -> dict[str, Any]:
        """Return the service's part of the status model, ``supervisor.http``."""
        problems = [text for text in (self._tcp_problem, self._local_problem) if text]
        return {
            "listen": "" if self._wanted is None else str(self._wanted),
            "address": self._address,
            "problem": "; ".join(problems) or None,
        }

    async def run(self) -> None:
        """Serve until cancelled."""
        served = Served(self._window)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._keep_local(served))
                group.create_task(self._keep_tcp(served))
        finally:
            served.close()

    async def _keep_tcp(self, served: Served) -> None:
        wait_s = FIRST_WAIT_S
        while True:
            wanted = self._wanted
            self._changed.clear()
            self._tcp_problem = None
            if wanted is None:
                await self._changed.wait()
                continue
            try:
                await self._serve_tcp(served, wanted)
                wait_s = FIRST_WAIT_S
            except OSError as error:
                self._tcp_problem = f"{wanted}: {_reason(error)}"
                if wait_s == FIRST_WAIT_S:
                    self._not_open(str(wanted), self._tcp_problem)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(wait_s):
                        await self._changed.wait()
                wait_s = FIRST_WAIT_S if self._changed.is_set() else min(2.0 * wait_s, LONGEST_WAIT_S)

    async def _serve_tcp(self, served: Served, wanted: TcpEndpoint) -> None:
        """Serve until another address is wanted.

        Raises:
            OSError: it cannot be listened there.
        """
        door = Door(self._limits["tcp"])
        rules = Rules(READS, wanted.host if is_loopback(wanted.host) else None, PATHS)
        door.serve(Guard(served.application(door, may_reload=False), rules))
        loop = asyncio.get_running_loop()
        server = await loop.create_server(door.connection, wanted.host, wanted.port)
        self._address = f"http://{wanted}"
        self._window.say(HTTP_READY, address=self._address)
        await self._until_changed(server, door)

    async def _until_changed(self, server: asyncio.Server, door: Door) -> None:
        watching = asyncio.create_task(door.watch())
        try:
            await self._changed.wait()
        finally:
            self._address = None
            await _close(server, door, watching)

    async def _keep_local(self, served: Served) -> None:
        wait_s = FIRST_WAIT_S
        while True:
            try:
                place = SocketPlace(self._window.state, SUPERVISOR_SOCKET_NAME, lock_name=None)
                listening = place.take()
            except SocketError as error:
                if self._local_problem != str(error):
                    self._local_problem = str(error)
                    self._not_open(SUPERVISOR_SOCKET_NAME, str(error))
                await asyncio.sleep(wait_s)
                wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
            else:
                self._local_problem = None
                try:
                    await self._serve_local(served, listening)
                finally:
                    place.leave()

    async def _serve_local(self, served: Served, listening: socket.socket) -> None:
        """Serve until cancelled."""
        door = Door(self._limits["local"])
        rules = Rules(READS | {"POST"}, there_is=LOCAL_PATHS)
        door.serve(Guard(served.application(door, may_reload=True), rules))
        server = await asyncio.get_running_loop().create_unix_server(door.connection, sock=listening)
        watching = asyncio.create_task(door.watch())
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            await _close(server, door, watching)

    def _not_open(self, where: str, why: str) -> None:
        self._window.say(
            HTTP_NOT_OPEN,
            listen=where,
            detail=f"{why}; it is tried again, and everything else goes on",
        )


async def _close(server: asyncio.Server, door: Door, watching: "asyncio.Task[None]") -> None:
    server.close()
    watching.cancel()
    await asyncio.gather(watching, return_exceptions=True)
    await door.close()


def _reason(error: OSError) -> str:
    """Return why it cannot be listened somewhere; asyncio wraps the system's words into its own.

    >>> import errno
    >>> _reason(OSError(errno.EADDRINUSE, "error while attempting to bind on address ('::1', 1): in use"))
    'Address already in use'
    """
    if isinstance(error, socket.gaierror) or not error.errno:
        return error.strerror or str(error)
    return os.strerror(error.errno)
