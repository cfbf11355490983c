"""Modbus/TCP Security on a controller's listener: which roles are admitted, with which rights.

It also reports refusals and certificates. ``ssl`` and ``cryptography`` are loaded when the first such
listener opens: without one they cost nothing.
"""

import asyncio
from collections.abc import Callable
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Protocol

from gateway.catalogue import starts
from gateway.catalogue.entry import EventEntry
from gateway.catalogue.line_events import CONNECTION_REFUSED
from gateway.catalogue.tls_events import (
    CERTIFICATE_REFUSED,
    CERTIFICATES_NOT_RENEWED,
    CERTIFICATES_RENEWED,
    HANDSHAKE_FAILED,
)
from gateway.exchange.plan import ControllerPlan
from gateway.relay.refusals import Refusals
from gateway.state.plan import ControllerLink, TlsPlan
from gateway.status.line import Session, TlsStatus
from gateway.transport.certificates import Endings, Identity, TlsFileError
from gateway.transport.channel import Receiver
from gateway.transport.errors import RefusedError

if TYPE_CHECKING:
    from gateway.transport.secured import Failure, TlsServer

REVOKED_MEANS = "new connections are held against them; those that are open stay"


class LogEvent(Protocol):
    """``Journal.log`` with line and controller."""

    def __call__(self, event: EventEntry, /, **fields: object) -> None:
        """Log an event."""
        ...


class TlsAdmission:
    """Admits clients whose certificate has a role of the plan; each connection gets a port of that role."""

    def __init__(
        self,
        link: ControllerLink,
        tls: TlsPlan,
        make_port: Callable[[ControllerPlan], Receiver],
        refusals: Refusals,
        log: LogEvent,
    ) -> None:
        # One plan for each role: connections of one role share what is counted by plan.
        plans = ((name, link.plan_of(name)) for name in tls.roles)
        self._plans = {name: plan for name, plan in plans if plan is not None}
        self._files = tls.files
        self._make_port = make_port
        self._refusals = refusals
        self._log = log
        self._tls_server: TlsServer | None = None
        self._failed = 0
        self._endings = Endings(lambda event, fields: log(event, **fields), "tls")
        self._is_looking = self._is_closed = False

    def open(self) -> None:
        """Read the files.

        Raises:
            RefusedError: one of them cannot be used; with the key and the remedy.
        """
        import cryptography.x509  # noqa: F401 - takes a while: not in the first handshake

        from gateway.transport.secured import TlsServer
        from gateway.transport.tls import ServerContexts

        loop = asyncio.get_running_loop()
        contexts = ServerContexts(
            self._files,
            lambda: loop.call_soon_threadsafe(self._renewed),
            lambda error: loop.call_soon_threadsafe(self._not_renewed, error),
        )
        try:
            contexts.open()
        except TlsFileError as error:
            raise RefusedError(starts.TLS_FILE.begin(problem=error)) from None
        self._endings.take(contexts.held)
        self._tls_server = TlsServer(contexts, self._receiver_for, self._report_failure, self._too_many)

    def connection(self) -> Receiver:
        """Return the receiver of an accepted connection."""
        assert self._tls_server is not None, "a listener opens after its files were read"
        return self._tls_server.connection()

    def close(self) -> None:
        """End the sessions, and begin no more."""
        self._is_closed = True
        if self._tls_server is not None:
            for session in list(self._tls_server.sessions):
                session.close()
            self._tls_server.close()

    def tick(self, now: datetime) -> None:
        """Report certificates that expire soon or have expired; to be called regularly.

        It checks the files first: a certificate that was renewed comes into force without a new connection.
        """
        if self._tls_server is None or self._is_closed or self._is_looking or not self._endings.is_due(now):
            return
        self._is_looking = True
        self._tls_server.renew(partial(self._looked, now))

    def status(self, now: datetime) -> TlsStatus:
        """Return the TLS part of the controller's status."""
        tls_server = self._tls_server
        if tls_server is None:
            return TlsStatus()
        return TlsStatus(
            handshakes=tls_server.handshakes,
            failed_handshakes=self._failed,
            running_handshakes=tls_server.limits.running,
            certificates=self._endings.status(now),
            sessions=[
                Session(
                    peer=session.peer,
                    certified=identity.role,
                    role=self._plans[identity.role].role.value,
                    subject=identity.subject,
                    serial=identity.serial,
                    valid_until=identity.ends,
                )
                for session, identity in tls_server.sessions.items()
            ],
        )

    def _receiver_for(self, identity: Identity) -> Receiver | None:
        plan = self._plans.get(identity.role)
        return None if plan is None else self._make_port(plan)

    def _report_failure(self, failure: "Failure") -> None:
        self._failed += 1
        event = CERTIFICATE_REFUSED if failure.is_certificate else HANDSHAKE_FAILED
        whose = ""
        if failure.identity is not None:
            whose = f": {failure.peer}, {failure.identity.subject}, serial {failure.identity.serial}"
        self._refusals.count(event, failure.host, failure.reason, whose)

    def _too_many(self, host: str, limit: str) -> None:
        self._failed += 1
        self._refusals.count(CONNECTION_REFUSED, host, limit)

    def _looked(self, now: datetime) -> None:
        self._is_looking = False
        if not self._is_closed:
            self._endings.report(now)

    def _renewed(self) -> None:
        if self._tls_server is not None:
            self._endings.take(self._tls_server.contexts.held)
        self._log(CERTIFICATES_RENEWED, detail=REVOKED_MEANS)

    def _not_renewed(self, error: TlsFileError) -> None:
        detail = f"tls.{error.key}: {error.found}; the previous ones stay in force"
        self._log(CERTIFICATES_NOT_RENEWED, detail=detail, remedy=error.remedy)
