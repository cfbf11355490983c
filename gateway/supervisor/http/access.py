"""Who may look, where that is not everybody: a token, a session that one was shown for, or a certificate."""

import asyncio
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from starlette.responses import Response
from starlette.types import Scope

from gateway.catalogue.publishing_events import HTTP_REFUSED, TOKEN_REFUSED
from gateway.supervisor.http.answers import problem
from gateway.supervisor.http.refusals import Refusals
from gateway.supervisor.http.sessions import LIFE_S, Session, Sessions
from gateway.supervisor.http.tokens import Tokens
from gateway.supervisor.http.wrong_tries import WrongTries
from gateway.supervisor.page import LOGIN_FILES

LOOK_S: Final = 1.0
"""How soon somebody who stays is out when his token, or his session, is no more."""
OPEN_TO_ALL: Final = frozenset(("/", "/healthz", "/login", *(f"/page/{name}" for name in LOGIN_FILES)))
"""What strangers see: the page that asks for the token, and whether the gateway is well, without why not."""
CHALLENGE: Final = {"WWW-Authenticate": 'Bearer realm="pitch-gateway"'}
_CLOSE: Final = {"Connection": "close"}


@dataclass(frozen=True, slots=True)
class Visitor:
    """Somebody who may look."""

    name: str
    """Of his token, or in his certificate."""
    how: str
    """``token``, ``session`` or ``certificate``."""
    session: Session | None = None
    digest: bytes = b""
    """What his token is known by."""


class Access:
    """Says of each request whose it is, before anybody looks at what it asks for."""

    def __init__(
        self,
        tokens: Tokens,
        sessions: Sessions,
        refusals: Refusals,
        cookie: str,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.cookie = cookie
        """The name of the cookie; one that begins with ``__Host-`` is for TLS."""
        self._tokens = tokens
        self._sessions = sessions
        self._refusals = refusals
        self._tries = WrongTries()
        self._clock_s = clock_s

    def refusal(self, scope: Scope) -> Response | None:
        """Return why a request may not pass, else None: its ``state`` then has the ``visitor``."""
        if scope["method"] == "POST" and (why := _why_cross_site(scope)) is not None:
            self._refusals.note(HTTP_REFUSED, peer_of(scope), why, self._clock_s())
            return problem(403, why, _CLOSE)
        token = _bearer(scope)
        if token is not None:
            found = self.try_token(token, peer_of(scope))
            if isinstance(found, Response):
                return found
            scope["state"]["visitor"] = found
            return None
        visitor = self._by_certificate(scope) or self._by_session(scope)
        if visitor is None and scope["path"] not in OPEN_TO_ALL:
            self._refusals.note(HTTP_REFUSED, peer_of(scope), "no token, and no session", self._clock_s())
            return problem(401, "show a token: Authorization: Bearer …, or log in at /", CHALLENGE)
        scope["state"]["visitor"] = visitor
        return None

    def try_token(self, token: str, peer: str) -> Visitor | Response:
        """Return whose token it is, or the answer to a wrong one."""
        now_s = self._clock_s()
        if (wait_s := self._tries.shut_s(peer, now_s)) > 0.0:
            self._refusals.note(TOKEN_REFUSED, peer, "too many wrong tokens: not looked at", now_s)
            what = "too many wrong tokens came from your address; try again later"
            return problem(429, what, {"Retry-After": str(math.ceil(wait_s))})
        self._tokens.look()
        name = self._tokens.name_of(token)
        if name is None:
            self._tries.note(peer, token, now_s)
            self._refusals.note(TOKEN_REFUSED, peer, "a wrong token", now_s)
            return problem(401, "that is no token of this gateway", CHALLENGE)
        return Visitor(name, "token", digest=self._tokens.digest_of(name))

    def log_in(self, visitor: Visitor) -> str:
        """Begin a session; returns the ``Set-Cookie`` of it."""
        value = self._sessions.open(visitor.name, visitor.digest, self._clock_s())
        return self._set_cookie(value, int(LIFE_S))

    def log_out(self, scope: Scope) -> str:
        """End the session of a request; returns the ``Set-Cookie`` that takes it away."""
        for value in self._shown(scope):
            self._sessions.close(value)
        return self._set_cookie("", 0)

    def ends_in_s(self, visitor: Visitor) -> float | None:
        """Return how long a session will still be; None: it is none."""
        return None if visitor.session is None else visitor.session.ends_s - self._clock_s()

    def may_acknowledge(self, visitor: Visitor) -> bool:
        """Whether a visitor may acknowledge alarms: by a token that has the right, never by a certificate."""
        return visitor.how != "certificate" and self._tokens.may_acknowledge(visitor.name)

    def is_still_in(self, visitor: Visitor) -> bool:
        """Whether somebody who was let in would be let in again."""
        if visitor.how == "certificate":
            return True
        session = visitor.session
        if session is not None and not self._sessions.has(session, self._clock_s()):
            return False
        self._tokens.look()
        return self._tokens.digest_of(visitor.name) == visitor.digest

    async def until_out(self, visitor: Visitor) -> None:
        """Wait until a visitor would not be let in any more."""
        while self.is_still_in(visitor):  # noqa: ASYNC110 - a file tells nobody
            await asyncio.sleep(LOOK_S)

    def _by_certificate(self, scope: Scope) -> Visitor | None:
        name = scope["state"].get("certificate")
        return None if name is None else Visitor(name, "certificate")

    def _by_session(self, scope: Scope) -> Visitor | None:
        for value in self._shown(scope):
            session = self._sessions.find(value, self._clock_s())
            if session is not None:
                visitor = Visitor(session.token, "session", session, session.digest)
                if self.is_still_in(visitor):
                    return visitor
                self._sessions.close(value)
        return None

    def _shown(self, scope: Scope) -> Iterator[str]:
        for name, value in scope["headers"]:
            if name == b"cookie":
                for part in value.decode("latin-1").split(";"):
                    key, _, shown = part.strip().partition("=")
                    if key == self.cookie:
                        yield shown

    def _set_cookie(self, value: str, age_s: int) -> str:
        secure = "; Secure" if self.cookie.startswith("__Host-") else ""
        return f"{self.cookie}={value}; Path=/; Max-Age={age_s}; HttpOnly; SameSite=Strict{secure}"


def peer_of(scope: Scope) -> str:
    """Return the address that a request came from."""
    return scope["client"][0] if scope.get("client") else ""


def _header(scope: Scope, wanted: bytes) -> list[str]:
    return [value.decode("latin-1") for name, value in scope["headers"] if name == wanted]


def _bearer(scope: Scope) -> str | None:
    """Return the token that a request shows, None for none: what a proxy in front asks for is not ours."""
    tokens = [
        value[7:].strip() for value in _header(scope, b"authorization") if value[:7].lower() == "bearer "
    ]
    return " ".join(tokens) if tokens else None  # several of them are no token


def _why_cross_site(scope: Scope) -> str | None:
    """Return why a POST is not of our own page: browsers say where theirs come from, others say nothing."""
    sites = _header(scope, b"sec-fetch-site")
    if sites:
        return None if sites == ["same-origin"] else "a page from elsewhere may not ask for that"
    hosts = _header(scope, b"host")
    for origin in _header(scope, b"origin"):
        if origin.partition("://")[2].lower() not in [host.lower() for host in hosts]:
            return "a page from elsewhere may not ask for that"
    return None
