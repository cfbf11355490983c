"""The checks that every request passes first, and the headers of every response."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from email.utils import formatdate
from ipaddress import ip_address
from typing import Final

from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.supervisor.http.answers import (
    ALWAYS,
    BODY_BYTES,
    HEAD_BYTES,
    TARGET_BYTES,
    problem,
    shortened,
)
from gateway.supervisor.http.login import Authenticator, peer_of
from gateway.supervisor.http.refusals import Refused, ignore_refused

READS: Final = frozenset(("GET", "HEAD"))
HOSTLESS: Final = frozenset(("/healthz", "/metrics"))
"""Paths that HTTP/1.0 programs may request without ``Host``: load balancers, simple monitors. Browsers always
send ``Host``, so no foreign page can do this. HTTP/1.1 requires it (RFC 9112, 3.2)."""
VERSIONS: Final = frozenset(("1.0", "1.1"))
NOT_THERE: Final = 404
_NEVER: Final = frozenset((400, 405, 411, 413, 414, 415, 421, 431, 505))
_HOST: Final = re.compile(r"(?:\[(?P<v6>[0-9A-Fa-f:.]+)\]|(?P<host>[A-Za-z0-9._-]+))(?::[0-9]*)?")
_CLOSE: Final = {"Connection": "close"}


@dataclass(frozen=True, slots=True)
class Rules:
    """The rules of one listener."""

    methods: Collection[str] = READS
    loopback_host: str | None = None
    """The address of a listener that only this machine reaches: requests have to name this machine.

    A foreign page can point its own name to 127.0.0.1 (DNS rebinding). The browser then lets it read the
    responses. But the ``Host`` of its requests is still the foreign name.
    """
    there_is: Sequence[str] = ()
    """The paths to list for a client that requests another one."""


class Guard:
    """Checks requests before the application gets them."""

    def __init__(
        self,
        app: ASGIApp,
        rules: Rules,
        access: Authenticator | None = None,
        refused: Refused = ignore_refused,
    ) -> None:
        self._app = app
        self._rules = rules
        self._access = access
        self._refused = refused

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                self._report(scope, message["status"])
                message["headers"] = [
                    *message["headers"],
                    (b"date", formatdate(usegmt=True).encode("ascii")),
                    *ALWAYS,
                ]
            await send(message)

        answer = self._refusal(scope)
        if answer is None and self._access is not None:
            answer = self._access.refusal(scope)
        await (answer or self._app)(scope, receive, send_with_headers)

    def _report(self, scope: Scope, status: int) -> None:
        """Log a request that neither our page nor a program that knows this server sends."""
        path = scope["path"]
        if status in _NEVER or (status == NOT_THERE and (not path.startswith("/tables/") or is_probe(path))):
            self._refused(peer_of(scope), f"{status} for {scope['method'][:8]} {shortened(path)}")

    def _refusal(self, scope: Scope) -> Response | None:
        """Return why a request is refused; None if it may pass."""
        if scope["http_version"] not in VERSIONS:
            return problem(505, f"HTTP/{scope['http_version']} is not supported here, only HTTP/1.1", _CLOSE)
        headers: list[tuple[bytes, bytes]] = scope["headers"]
        target_bytes = len(scope["raw_path"]) + len(scope["query_string"])
        if target_bytes > TARGET_BYTES:
            what = f"the path has {target_bytes} bytes; allowed: {TARGET_BYTES}"
            return problem(414, what, _CLOSE)
        if target_bytes + sum(len(name) + len(value) + 4 for name, value in headers) > HEAD_BYTES:
            return problem(431, f"the head of a request may have at most {HEAD_BYTES} bytes", _CLOSE)
        if scope["method"] not in self._rules.methods:
            allowed = ", ".join(sorted(self._rules.methods))
            what = f"{shortened(scope['method'])} is not supported here, only {allowed}"
            return problem(405, what, {**_CLOSE, "Allow": allowed}, there_is=list(self._rules.there_is))
        return _body_refusal(headers) or self._host_refusal(scope)

    def _host_refusal(self, scope: Scope) -> Response | None:
        listen_host = self._rules.loopback_host
        if listen_host is None:
            return None
        named = [value.decode("latin-1") for name, value in scope["headers"] if name == b"host"]
        if not named and scope["path"] in HOSTLESS and scope["method"] in READS:
            return None
        if len(named) == 1 and is_this_machine(host_of(named[0]), listen_host):
            return None
        what = f"the request is for {shortened(', '.join(named)) or 'no host'}, but this is {listen_host}"
        return problem(421, what, _CLOSE)


def is_probe(path: str) -> bool:
    """Whether a path, decoded once, tries to leave the served tree.

    >>> [is_probe(path) for path in ("/tables/x", "/tables/../x", "//x", "/%2e%2e/x")]
    [False, True, True, True]
    """
    return ".." in path or path.startswith("//") or any(sign in path for sign in "\\\0%")


def _body_refusal(headers: list[tuple[bytes, bytes]]) -> Response | None:
    for name, value in headers:
        if name == b"transfer-encoding":
            return problem(411, "give the length of the body, or send none", _CLOSE)
        if name == b"content-length" and int(value) > BODY_BYTES:  # h11 admits digits only, at most 20
            return problem(413, f"a body may have at most {BODY_BYTES} bytes", _CLOSE)
    return None


def host_of(text: str) -> str:
    """Return the host of a ``Host`` field (RFC 9110, 7.2), without its port; "" for anything else.

    >>> host_of("localhost:8480"), host_of("[::1]:8480"), host_of("127.0.0.1"), host_of("localhost:1@evil")
    ('localhost', '::1', '127.0.0.1', '')
    """
    found = _HOST.fullmatch(text)
    return "" if found is None else found["v6"] or found["host"] or ""


def is_this_machine(host: str, listen_host: str) -> bool:
    """Whether a host name in a request can only mean this machine.

    >>> [is_this_machine(host, "127.0.0.1") for host in ("LOCALHOST", "127.0.0.9", "::1", "evil.example")]
    [True, True, True, False]
    """
    name = host.lower().removesuffix(".")
    if name in {"localhost", listen_host.lower()}:
        return True
    try:
        return ip_address(name).is_loopback
    except ValueError:
        return False
