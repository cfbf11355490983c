"""A service that asks who looks: its token, its certificates, and somebody who shows them or others."""

import asyncio
import contextlib
import json
import ssl
from collections.abc import AsyncIterator, Callable
from datetime import datetime
from pathlib import Path
from typing import Any

from gateway.clock import now_utc
from gateway.config.http_model import HttpSection, HttpTlsSection, TokenSection
from gateway.supervisor.acknowledged import AlarmAcknowledgement
from gateway.supervisor.http.answers import TCP, Limits
from gateway.transport.listener import HandshakesAtOnce
from tests.supervisor.http.http_bench import Answer, Line, Served, model, serving, until
from tests.support.certificates import authority, signed_by

TOKEN = "people-0123456789abcdefghijklmnopqrstuv"
OTHER = "others-0123456789abcdefghijklmnopqrstuv"
WRONG = "wrong--0123456789abcdefghijklmnopqrstuv"
NO_CERTIFICATES = Path("/nonexistent")


def make_certificates(folder: Path) -> None:
    """An authority with the page's certificate and a client's, and a foreign one with a client's."""
    authority(folder, "ca")
    signed_by(folder, "ca", "page", "IP:127.0.0.1,DNS:localhost")
    signed_by(folder, "ca", "panel", "DNS:panel")
    authority(folder, "foreign")
    signed_by(folder, "foreign", "thief", "DNS:panel")
    for key in folder.glob("*.key"):
        key.chmod(0o600)


def write_token(folder: Path, token: str, name: str = "people.token") -> None:
    path = folder / name
    path.write_text(f"{token}\n")
    path.chmod(0o600)


def section(
    port: int,
    certificates: Path | None,
    *,
    tokens: bool = True,
    clients: bool = False,
    revoked: str | None = None,
    may_acknowledge: bool = False,
) -> HttpSection:
    tls = None
    if certificates is not None:
        tls = HttpTlsSection(
            certificate=str(certificates / "page.crt"),
            key=str(certificates / "page.key"),
            clients=str(certificates / "ca.crt") if clients else None,
            revoked=None if revoked is None else str(certificates / revoked),
        )
    people = TokenSection(name="people", file="people.token", acknowledge=may_acknowledge)
    names = (people,) if tokens else ()
    return HttpSection(listen=f"127.0.0.1:{port}", tokens=names, tls=tls)


def trusting(certificates: Path, client: str = "") -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=certificates / "ca.crt")
    if client:
        context.load_cert_chain(certificates / f"{client}.crt", certificates / f"{client}.key")
    return context


class Asking:
    """Somebody who asks a service that asks back."""

    def __init__(self, served: Served, folder: Path, certificates: Path | None) -> None:
        self.served = served
        self.folder = folder
        self.certificates = certificates

    async def connect(self, client: str = "", source: str = "127.0.0.1") -> Line:
        context = None if self.certificates is None else trusting(self.certificates, client)
        reader, writer = await asyncio.open_connection(
            "127.0.0.1", self.served.port, ssl=context, limit=2**24, local_addr=(source, 0)
        )
        line = Line(reader, writer)
        self.served.lines.append(line)
        return line

    async def ask(
        self,
        target: str,
        *more: str,
        method: str = "GET",
        body: str = "",
        client: str = "",
        source: str = "127.0.0.1",
    ) -> Answer:
        line = await self.connect(client, source)
        length = [f"Content-Length: {len(body)}"] if method == "POST" else []
        head = (f"{method} {target} HTTP/1.1", "Host: localhost", *length, *more, "", body)
        await line.say("\r\n".join(head))
        answer = await line.hear()
        line.close()
        return answer

    async def log_in(self, token: str = TOKEN, *more: str) -> Answer:
        return await self.ask(
            "/login",
            "Content-Type: application/json",
            *more,
            method="POST",
            body=json.dumps({"token": token}),
        )

    async def cookie(self) -> str:
        """Log in; returns the cookie as a browser would send it."""
        answer = await self.log_in()
        assert answer.status == 200, answer
        return f"Cookie: {answer.headers['set-cookie'].partition(';')[0]}"

    async def says(self, data: bytes | str, client: str = "") -> Line:
        """Return a connection on which something was said."""
        line = await self.connect(client)
        await line.say(data)
        return line

    async def configured(self, wanted: HttpSection) -> None:
        """Have the service take over a section, and wait until it serves by it."""
        before = len(self.served.said)
        self.served.service.configure(wanted, "mill-1", self.folder)
        await until(lambda: "http-ready" in [event for event, _ in self.served.said[before:]])

    async def event(self, name: str) -> dict[str, Any]:
        """Wait for the only event of a name."""
        await until(lambda: bool(self.events(name)))
        [event] = self.events(name)
        return event

    def events(self, name: str) -> list[dict[str, Any]]:
        return [fields for event, fields in self.served.said if event == name]


def bearer(token: str) -> str:
    return f"Authorization: Bearer {token}"


@contextlib.asynccontextmanager
async def asking(
    folder: Path,
    certificates: Path | None = None,
    *,
    tokens: bool = True,
    clients: bool = False,
    tcp: Limits = TCP,
    handshakes: HandshakesAtOnce = HandshakesAtOnce(),  # noqa: B008
    now: Callable[[], datetime] = now_utc,
    acknowledge: Callable[[str, str, str, str, str], AlarmAcknowledgement | None] | None = None,
) -> AsyncIterator[Asking]:
    """A service that asks, with one token, ``people``; over TLS where there are certificates."""
    write_token(folder, TOKEN)
    seen = acknowledge or (lambda *_: None)
    with_all = serving(folder, tcp=tcp, handshakes=handshakes, now=now, acknowledge=seen, newest=model())
    async with with_all as served:
        visitor = Asking(served, folder, certificates)
        may = acknowledge is not None
        wanted = section(served.port, certificates, tokens=tokens, clients=clients, may_acknowledge=may)
        await visitor.configured(wanted)
        yield visitor
