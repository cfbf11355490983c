"""The status page as an attacker finds it: over TLS, with a token; and somebody who may look, and does."""

import json
import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from tests.attacks.legitimate import Ground
from tests.supervisor.http.doors import TOKEN, WRONG, bearer, make_certificates, write_token

__all__ = ["READER", "TOKEN", "WRONG", "Answer", "Page", "bearer", "guarded", "page_of"]

READER = "reader-0123456789abcdefghijklmnopqrstuv"
PATIENCE_S = 20.0


def guarded(ground: Ground, text: str) -> str:
    """The usual configuration with a page that asks who looks."""
    make_certificates(ground.folder)
    write_token(ground.folder, TOKEN)
    write_token(ground.folder, READER, "reader.token")
    page = (
        f'listen = "127.0.0.1:{ground.free("http")}"\n'
        'tokens = [{ name = "people", file = "people.token" }, { name = "reader", file = "reader.token" }]\n'
        'tls = { certificate = "page.crt", key = "page.key", clients = "ca.crt" }\n'
    )
    assert text.count('listen = ""') == 1
    return text.replace('listen = ""', page)


@dataclass(frozen=True)
class Answer:
    status: int
    headers: dict[str, str]
    body: bytes
    rest: bytes
    """What came after it until the gateway closed."""


def parsed(data: bytes) -> Answer:
    head, _, after = data.partition(b"\r\n\r\n")
    lines = head.decode("latin-1").split("\r\n")
    headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines[1:])}
    length = int(headers.get("content-length", "0"))
    return Answer(int(lines[0].split()[1]), headers, after[:length], after[length:])


class Page:
    """Opens connections to the page, as the attacker where no other source is named."""

    def __init__(self, ground: Ground) -> None:
        self._attacker = ground.attacker
        self.port = ground.others["http"]
        self._context = ssl.create_default_context(cafile=ground.folder / "ca.crt")

    def plain(self, source: str | None = None) -> socket.socket:
        return socket.create_connection(
            ("127.0.0.1", self.port), PATIENCE_S, source_address=(source or self._attacker, 0)
        )

    def connect(self, source: str | None = None) -> ssl.SSLSocket:
        return self._context.wrap_socket(self.plain(source), server_hostname="127.0.0.1")

    def say(self, data: bytes, source: str | None = None, *, to_the_end: bool = True) -> Answer:
        """Say something on a connection of its own; returns the first answer, and what came after it.

        Without ``to_the_end`` only its head is waited for.
        """
        with self.connect(source) as connection:
            got = b""
            try:
                connection.sendall(data)
                while (to_the_end or b"\r\n\r\n" not in got) and (part := connection.recv(65536)):
                    got += part
            except (ConnectionError, ssl.SSLError):
                assert got, "the gateway closed without a word"
        return parsed(got)

    def ask(
        self, target: str, *more: str, method: str = "GET", body: str = "", source: str | None = None
    ) -> Answer:
        length = [f"Content-Length: {len(body)}"] if method == "POST" else []
        lines = (
            f"{method} {target} HTTP/1.1",
            "Host: localhost",
            "Connection: close",
            *length,
            *more,
            "",
            body,
        )
        return self.say("\r\n".join(lines).encode("latin-1"), source)

    def log_in(self, token: str, *more: str, source: str | None = None) -> Answer:
        """Show a token as the page does."""
        body = json.dumps({"token": token})
        kind = "Content-Type: application/json"
        return self.ask("/login", kind, *more, method="POST", body=body, source=source)


@contextmanager
def page_of(ground: Ground) -> Iterator[Page]:
    """The page of a gateway; at the end somebody who may look must still see what happens, and be let in."""
    assert ground.gateway is not None
    while "http-ready" not in {note["event"] for note in ground.events}:
        ground.gateway.next()
    page = Page(ground)
    me = "127.0.0.1"
    with page.connect(me) as reader:
        reader.sendall(f"GET /events?status HTTP/1.1\r\nHost: localhost\r\n{bearer(READER)}\r\n\r\n".encode())
        _until(reader, b"event: status\n")
        yield page
        answer = page.ask("/status", bearer(READER), source=me)
        assert (answer.status, _gateway(answer)["relay"]) == (200, "up")
        assert page.ask("/", bearer(READER), source=me).status == 200
        reader.settimeout(0.0)
        try:
            while reader.recv(65536):
                pass  # what came meanwhile
        except ssl.SSLWantReadError:
            pass
        reader.settimeout(PATIENCE_S)
        _until(reader, b"event: status\n")


def _gateway(answer: Answer) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(answer.body)["gateway"]
    return found


def _until(reader: ssl.SSLSocket, wanted: bytes) -> None:
    ends_s, got = time.monotonic() + PATIENCE_S, b""
    while wanted not in got:
        assert time.monotonic() < ends_s, "the stream says nothing any more"
        part = reader.recv(65536)
        assert part, "the stream of somebody who may look ended"
        got = got[-len(wanted) :] + part
