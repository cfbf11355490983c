"""The HTTP service: two listeners. It retries until they are open; a failure is never fatal."""

import asyncio
import contextlib
import os
import socket
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Final

from gateway.backoff import Backoff
from gateway.catalogue.publishing_events import HTTP_NOT_OPEN, HTTP_READY, HTTP_REFUSED, TOKEN_UNUSABLE
from gateway.catalogue.tls_events import CERTIFICATES_RENEWED
from gateway.clock import now_utc
from gateway.config.checks.lines import is_loopback
from gateway.config.files import NamedFileError
from gateway.config.http_model import HttpSection
from gateway.ipc.address import SUPERVISOR_SOCKET_NAME, SocketError, SocketFile
from gateway.status.model import HttpStatus
from gateway.supervisor.http.answers import LOCAL, TCP, Limits
from gateway.supervisor.http.application import ASKING_PATHS, LOCAL_PATHS, PATHS, Served
from gateway.supervisor.http.documents import Window
from gateway.supervisor.http.guard import READS, Guard, Rules
from gateway.supervisor.http.listener import HttpServer, HttpSettings, http_settings_of
from gateway.supervisor.http.login import CHECK_EVERY_S, Authenticator, Sessions, Tokens
from gateway.supervisor.http.refusals import HttpRefusals, site_of
from gateway.transport.certificates import Endings
from gateway.transport.listener import HandshakesAtOnce, ProtocolListener, Tls, bound

FIRST_WAIT_S: Final = 0.5
LONGEST_WAIT_S: Final = 30.0


class HttpService:
    """Serves the status on the configured address and on ``supervisor.sock`` in the state folder.

    :meth:`run` runs until cancelled. :meth:`configure` may be called at any time, also before it. ``now`` is
    the clock for certificates.
    """

    def __init__(
        self,
        window: Window,
        tcp: Limits = TCP,
        local: Limits = LOCAL,
        handshakes: HandshakesAtOnce = HandshakesAtOnce(),  # noqa: B008 - frozen
        *,
        now: Callable[[], datetime] = now_utc,
    ) -> None:
        self._window = window
        self._limits = {"tcp": tcp, "local": local}
        self._handshakes = handshakes
        self._section: HttpSection | None = None
        self._http_settings: HttpSettings | None = None
        self._changed = asyncio.Event()
        self._address: str | None = None
        self._tcp_problem: str | None = None
        self._local_problem: str | None = None
        self._tokens: Tokens | None = None
        self._sessions = Sessions()
        self._refusals = HttpRefusals(window.log)
        self._now = now
        self._endings = Endings(lambda event, fields: window.log(event, None, **fields), "http.tls")

    def configure(self, section: HttpSection, gateway: str, folder: Path) -> None:
        """Serve with the settings of a gateway's configuration. Unchanged settings change nothing.

        Call it with a newly read section to have the files that it names read again.
        """
        if section is self._section:
            return
        self._section = section
        http_settings = http_settings_of(section, gateway, folder)
        if http_settings != self._http_settings:
            self._http_settings = http_settings
            self._changed.set()

    @property
    def status(self) -> HttpStatus:
        """Return the service's part of the status model, ``supervisor.http``."""
        of_tokens = [] if self._tokens is None else self._tokens.problems
        problems = [text for text in (self._tcp_problem, self._local_problem, *of_tokens) if text]
        return HttpStatus(
            listen="" if self._http_settings is None else str(self._http_settings.endpoint),
            address=self._address,
            problem="; ".join(problems) or None,
            certificates=self._endings.status(self._now()),
        )

    async def run(self) -> None:
        """Serve until cancelled."""
        served = Served(self._window)
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._run_local(served))
                group.create_task(self._run_tcp(served))
        finally:
            served.close()

    async def _run_tcp(self, served: Served) -> None:
        backoff = Backoff(FIRST_WAIT_S, LONGEST_WAIT_S)
        while True:
            http_settings = self._http_settings
            self._changed.clear()
            if http_settings is None:
                self._tcp_problem = None
                self._endings.take(())
                await self._changed.wait()
                continue
            try:
                await self._serve_tcp(served, http_settings)
                backoff.reset()
            except (OSError, NamedFileError) as error:
                why = _reason(error) if isinstance(error, OSError) else str(error)
                self._tcp_problem = f"{http_settings.endpoint}: {why}"
                if not backoff.failures:
                    self._not_open(str(http_settings.endpoint), self._tcp_problem)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(backoff.next_s()):
                        await self._changed.wait()
                if self._changed.is_set():
                    backoff.reset()

    async def _serve_tcp(self, served: Served, http_settings: HttpSettings) -> None:
        """Serve until the settings change.

        Raises:
            OSError: the address cannot be opened.
            NamedFileError: a certificate, or its key, cannot be used.
        """
        host = http_settings.endpoint.host
        context = await asyncio.to_thread(http_settings.context)
        held = await asyncio.to_thread(http_settings.held)
        http_server = HttpServer(self._limits["tcp"], self._refused)
        access = self._access(http_settings)
        methods = READS if access is None else READS | {"POST"}
        there_is = PATHS if access is None else ASKING_PATHS
        rules = Rules(methods, host if is_loopback(host) else None, there_is)
        http_server.serve(
            Guard(served.application(http_server, there_is, access), rules, access, self._refused)
        )
        tls = None if context is None else Tls(context, self._handshakes, self._refused, site_of)
        listener = ProtocolListener(http_server.connection, tls)
        listener.open(await bound(host, http_settings.endpoint.port))
        self._tcp_problem = None
        if self._endings.is_other(held):
            self._window.log(CERTIFICATES_RENEWED, detail="http.tls: the page is served with them")
        self._endings.take(held)
        watching = [asyncio.create_task(http_server.watch())]
        watching.append(asyncio.create_task(self._watch()))
        try:
            self._address = http_settings.address
            self._window.log(HTTP_READY, address=self._address)
            await self._changed.wait()
        finally:
            await _close(listener, http_server, *watching)
            self._address = self._tokens = None

    def _access(self, http_settings: HttpSettings) -> Authenticator | None:
        """Return the authenticator; None: no authentication."""
        if not http_settings.asks_who:
            return None
        self._tokens = Tokens(http_settings.tokens, http_settings.folder, self._token_unusable)
        return Authenticator(self._tokens, self._sessions, self._refusals, http_settings.cookie)

    def _refused(self, peer: str, why: str) -> None:
        self._refusals.add(HTTP_REFUSED, peer, why, time.monotonic())

    async def _watch(self) -> None:
        """Report tokens and certificates that expire soon, and the counts of refusals."""
        while True:
            if self._endings.is_due(now := self._now()):
                self._endings.report(now)
            await asyncio.sleep(CHECK_EVERY_S)
            if self._tokens is not None:
                self._tokens.refresh()
            self._refusals.sweep(time.monotonic())

    def _token_unusable(self, why: str) -> None:
        self._window.log(TOKEN_UNUSABLE, detail=f"{why}; it is refused")

    async def _run_local(self, served: Served) -> None:
        backoff = Backoff(FIRST_WAIT_S, LONGEST_WAIT_S)
        while True:
            try:
                socket_file = SocketFile(self._window.state, SUPERVISOR_SOCKET_NAME, lock_name=None)
                listening = socket_file.take()
            except SocketError as error:
                if self._local_problem != str(error):
                    self._local_problem = str(error)
                    self._not_open(SUPERVISOR_SOCKET_NAME, str(error))
                await asyncio.sleep(backoff.next_s())
            else:
                self._local_problem = None
                try:
                    await self._serve_local(served, listening)
                finally:
                    socket_file.leave()

    async def _serve_local(self, served: Served, listening: socket.socket) -> None:
        """Serve until cancelled."""
        http_server = HttpServer(self._limits["local"])
        rules = Rules(READS | {"POST"}, there_is=LOCAL_PATHS)
        http_server.serve(Guard(served.application(http_server, LOCAL_PATHS), rules))
        listener = ProtocolListener(http_server.connection)
        listener.open([listening])
        watching = asyncio.create_task(http_server.watch())
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            await _close(listener, http_server, watching)

    def _not_open(self, where: str, why: str) -> None:
        self._window.log(
            HTTP_NOT_OPEN,
            listen=where,
            detail=f"{why}; the gateway tries again, and everything else continues",
        )


async def _close(
    listener: ProtocolListener, http_server: HttpServer, *watching: "asyncio.Task[None]"
) -> None:
    await listener.close()
    for task in watching:
        task.cancel()
    await asyncio.gather(*watching, return_exceptions=True)
    await http_server.close()


def _reason(error: OSError) -> str:
    """Return why an address cannot be opened: the system's message without asyncio's wrapper.

    >>> import errno
    >>> _reason(OSError(errno.EADDRINUSE, "error while attempting to bind on address ('::1', 1): in use"))
    'Address already in use'
    """
    if isinstance(error, socket.gaierror) or not error.errno:
        return error.strerror or str(error)
    return os.strerror(error.errno)
