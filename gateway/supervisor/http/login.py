"""Authentication and its rights: tokens, sessions, login."""

import asyncio
import hmac
import json
import math
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import Scope

from gateway.catalogue.publishing_events import HTTP_REFUSED, TOKEN_REFUSED
from gateway.config.files import NamedFileError, path_of, read_token
from gateway.config.http_model import TokenSection
from gateway.files import mark_of
from gateway.supervisor.http.answers import JSON, json_answer, problem, shortened
from gateway.supervisor.http.documents import Window
from gateway.supervisor.http.refusals import HttpRefusals, WrongTries
from gateway.supervisor.page import LOGIN_FILES

# --- Tokens: read from their files, read again when a file changes, never shown

SETTLED_NS: Final = 2_000_000_000
"""A file written less than so long ago is read each time: two saves can have the same time."""
Seen = tuple[int, ...]


@dataclass(slots=True)
class _File:
    """One token, as last read from its file."""

    key: tuple[str | int, ...]
    section: TokenSection
    seen: Seen | None = None
    digest: bytes = b""
    """SHA-256 of the token; empty: the file has no usable token, and the token is refused."""
    problem: str | None = None


class Tokens:
    """Identifies tokens. The files are small and local, so they are read on the event loop."""

    def __init__(
        self, sections: Iterable[TokenSection], folder: Path, complain: Callable[[str], None]
    ) -> None:
        self._folder = folder
        self._complain = complain
        self._files = [
            _File(("http", "tokens", index, "file"), section) for index, section in enumerate(sections)
        ]
        self.refresh()

    @property
    def problems(self) -> list[str]:
        """Why tokens cannot be used, one sentence each."""
        return [file.problem for file in self._files if file.problem is not None]

    def refresh(self) -> None:
        """Read the files that have changed. A token that is no longer in its file is no longer valid."""
        for file in self._files:
            try:
                seen = _file_mark(path_of(file.key, file.section.file, self._folder))
                if seen is None or seen != file.seen:
                    token = read_token(file.key, file.section.file, self._folder)
                    file.digest, file.seen, file.problem = _digest(token), seen, None
            except NamedFileError as error:
                why = f'token "{file.section.name}": {error}'
                is_new = why != file.problem
                file.digest, file.seen, file.problem = b"", None, why
                if is_new:
                    self._complain(why)

    def name_of(self, token: str) -> str | None:
        """Return the name of a token. A wrong token takes as long as a valid one."""
        digest, found = _digest(token), None
        for file in self._files:
            if hmac.compare_digest(digest, file.digest):
                found = file.section.name
        return found

    def may_acknowledge(self, name: str) -> bool:
        """Whether the token of this name may acknowledge alarms."""
        return any(file.section.name == name and file.section.acknowledge for file in self._files)

    def digest_of(self, name: str) -> bytes:
        """Return the digest of the token of this name; empty if there is none."""
        return next((file.digest for file in self._files if file.section.name == name), b"")


def _digest(token: str) -> bytes:
    return sha256(token.encode("utf-8", "surrogatepass")).digest()


def _file_mark(path: Path) -> Seen | None:
    """Return the stamp that shows a change of the file; None: only reading shows it."""
    try:
        status = path.stat()
    except OSError:
        return None
    if time.time_ns() - max(status.st_mtime_ns, status.st_ctime_ns) < SETTLED_NS:
        return None
    # The change time counts too: a new mode changes it, and may let others read the file.
    return (*mark_of(status), status.st_ctime_ns)


# --- Browser sessions: a person enters the token once; then the browser sends a random number

LIFE_S: Final = 12 * 3600.0
"""A shift and the way home."""
MOST: Final = 64
"""Maximum number. One more ends the oldest."""
_BYTES: Final = 32


@dataclass(frozen=True, slots=True)
class LoginSession:
    """The session of one browser."""

    token: str
    """Name of the token that opened it."""
    digest: bytes
    """Digest of that token. The session ends when its file has another token."""
    ends_s: float
    """On the monotonic clock."""


class Sessions:
    """Sessions, in memory only: a restart ends them all.

    Stored as digests, so that timing reveals nothing.
    """

    def __init__(self) -> None:
        self._sessions: OrderedDict[bytes, LoginSession] = OrderedDict()

    def __len__(self) -> int:
        return len(self._sessions)

    def open(self, token: str, digest: bytes, now_s: float) -> str:
        """Begin a session; return the value of its cookie."""
        value = secrets.token_urlsafe(_BYTES)
        while len(self._sessions) >= MOST:
            self._sessions.popitem(last=False)
        self._sessions[_key(value)] = LoginSession(token, digest, now_s + LIFE_S)
        return value

    def find(self, value: str, now_s: float) -> LoginSession | None:
        """Return the session of a cookie value; None if there is none or it has ended."""
        session = self._sessions.get(_key(value))
        if session is not None and session.ends_s <= now_s:
            self.close(value)
            return None
        return session

    def has(self, session: LoginSession, now_s: float) -> bool:
        """Whether a session is still valid."""
        return session.ends_s > now_s and any(session is one for one in self._sessions.values())

    def close(self, value: str) -> None:
        """End a session."""
        self._sessions.pop(_key(value), None)


def _key(value: str) -> bytes:
    return sha256(value.encode("utf-8", "surrogatepass")).digest()


# --- Access, where it is limited: by a token, by a session, or by a client certificate

CHECK_EVERY_S: Final = 1.0
"""How often a lasting connection is checked for a revoked token or an ended session."""
OPEN_TO_ALL: Final = frozenset(("/", "/healthz", "/login", *(f"/page/{name}" for name in LOGIN_FILES)))
"""Paths without authentication: the login page, and whether the gateway is healthy, without the reasons."""
CHALLENGE: Final = {"WWW-Authenticate": 'Bearer realm="pitch-gateway"'}
_CLOSE: Final = {"Connection": "close"}


@dataclass(frozen=True, slots=True)
class Visitor:
    """An authenticated client."""

    name: str
    """Name of the token, or subject of the certificate."""
    how: str
    """``token``, ``session`` or ``certificate``."""
    session: LoginSession | None = None
    digest: bytes = b""
    """Digest of the token."""


class Authenticator:
    """Authenticates each request before anything else uses it."""

    def __init__(
        self,
        tokens: Tokens,
        sessions: Sessions,
        refusals: HttpRefusals,
        cookie: str,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self.cookie = cookie
        """Name of the cookie. A name that begins with ``__Host-`` is for TLS."""
        self._tokens = tokens
        self._sessions = sessions
        self._refusals = refusals
        self._tries = WrongTries()
        self._clock_s = clock_s

    def refusal(self, scope: Scope) -> Response | None:
        """Return why a request may not pass; None: it may, and its ``state`` has the ``visitor``."""
        if scope["method"] == "POST" and (why := _why_cross_site(scope)) is not None:
            self._refusals.add(HTTP_REFUSED, peer_of(scope), why, self._clock_s())
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
            self._refusals.add(HTTP_REFUSED, peer_of(scope), "no token and no session", self._clock_s())
            return problem(401, "send a token: Authorization: Bearer …, or log in at /", CHALLENGE)
        scope["state"]["visitor"] = visitor
        return None

    def try_token(self, token: str, peer: str) -> Visitor | Response:
        """Return the visitor of a token, or the response to a wrong token."""
        now_s = self._clock_s()
        if (wait_s := self._tries.shut_s(peer, now_s)) > 0.0:
            self._refusals.add(TOKEN_REFUSED, peer, "too many wrong tokens: not checked", now_s)
            what = "too many wrong tokens came from your address; try again later"
            return problem(429, what, {"Retry-After": str(math.ceil(wait_s))})
        self._tokens.refresh()
        name = self._tokens.name_of(token)
        if name is None:
            self._tries.add(peer, token, now_s)
            self._refusals.add(TOKEN_REFUSED, peer, "a wrong token", now_s)
            return problem(401, "not a token of this gateway", CHALLENGE)
        return Visitor(name, "token", digest=self._tokens.digest_of(name))

    def log_in(self, visitor: Visitor) -> str:
        """Begin a session; return its ``Set-Cookie``."""
        value = self._sessions.open(visitor.name, visitor.digest, self._clock_s())
        return self._set_cookie(value, int(LIFE_S))

    def log_out(self, scope: Scope) -> str:
        """End the session of a request; return the ``Set-Cookie`` that deletes the cookie."""
        for value in self._shown(scope):
            self._sessions.close(value)
        return self._set_cookie("", 0)

    def ends_in_s(self, visitor: Visitor) -> float | None:
        """Return the rest of a session in seconds; None if the visitor has no session."""
        return None if visitor.session is None else visitor.session.ends_s - self._clock_s()

    def may_acknowledge(self, visitor: Visitor) -> bool:
        """Whether a visitor may acknowledge alarms.

        It needs a token with that right; a certificate has none.
        """
        return visitor.how != "certificate" and self._tokens.may_acknowledge(visitor.name)

    def is_still_in(self, visitor: Visitor) -> bool:
        """Whether the visitor would still be admitted."""
        if visitor.how == "certificate":
            return True
        session = visitor.session
        if session is not None and not self._sessions.has(session, self._clock_s()):
            return False
        self._tokens.refresh()
        return self._tokens.digest_of(visitor.name) == visitor.digest

    async def until_out(self, visitor: Visitor) -> None:
        """Wait until the visitor would no longer be admitted."""
        while self.is_still_in(visitor):  # noqa: ASYNC110 - a file sends no notification
            await asyncio.sleep(CHECK_EVERY_S)

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
    """Return the client address of a request."""
    return scope["client"][0] if scope.get("client") else ""


def _header(scope: Scope, header: bytes) -> list[str]:
    return [value.decode("latin-1") for name, value in scope["headers"] if name == header]


def _bearer(scope: Scope) -> str | None:
    """Return the token in a request, None if there is none.

    Credentials for a proxy in front are not tokens.
    """
    tokens = [
        value[7:].strip() for value in _header(scope, b"authorization") if value[:7].lower() == "bearer "
    ]
    return " ".join(tokens) if tokens else None  # several tokens count as none


def _why_cross_site(scope: Scope) -> str | None:
    """Return why a POST is not from our own page.

    Browsers name the origin of a POST, other programs do not.
    """
    sites = _header(scope, b"sec-fetch-site")
    if sites:
        return None if sites == ["same-origin"] else "a page of another site may not request this"
    hosts = _header(scope, b"host")
    for origin in _header(scope, b"origin"):
        if origin.partition("://")[2].lower() not in [host.lower() for host in hosts]:
            return "a page of another site may not request this"
    return None


# --- Requests of a browser user: ``/login``, ``/logout``, ``/session`` and ``/acknowledge``

NOBODY: dict[str, object] = {"by": None, "how": None, "ends_in_s": None, "may_acknowledge": False}


class LoginRoutes:
    """Answers of one listener; ``access`` is None if authentication is not required."""

    def __init__(self, access: Authenticator | None, window: Window) -> None:
        self._access = access
        self._window = window

    async def session(self, request: Request) -> Response:
        """Return the visitor, if authentication is required."""
        visitor: Visitor | None = getattr(request.state, "visitor", None)
        if self._access is None or visitor is None:
            return json_answer(NOBODY)
        ends_in_s = self._access.ends_in_s(visitor)
        may = self._access.may_acknowledge(visitor)
        return json_answer(
            {"by": visitor.name, "how": visitor.how, "ends_in_s": ends_in_s, "may_acknowledge": may}
        )

    async def log_in(self, request: Request) -> Response:
        """Exchange a token for a session."""
        assert self._access is not None, "only if tokens are configured"
        asked = await _asked(request, ("token",))
        if isinstance(asked, Response):
            return asked
        found = self._access.try_token(asked["token"].strip(), peer_of(request.scope))
        if isinstance(found, Response):
            return found
        return json_answer({"by": found.name}, headers={"Set-Cookie": self._access.log_in(found)})

    async def log_out(self, request: Request) -> Response:
        """End the session."""
        assert self._access is not None, "only if tokens are configured"
        return json_answer({}, headers={"Set-Cookie": self._access.log_out(request.scope)})

    async def acknowledge(self, request: Request) -> Response:
        """Acknowledge an alarm: the only change that is possible over TCP."""
        assert self._access is not None, "only if tokens are configured"
        visitor: Visitor = request.state.visitor
        if not self._access.may_acknowledge(visitor):
            what = f'"{visitor.name}" may only read; a token with acknowledge = true may acknowledge'
            return problem(403, what)
        asked = await _asked(request, ("kind", "where", "since"))
        if isinstance(asked, Response):
            return asked
        done = self._window.acknowledge(
            asked["kind"], asked["where"], asked["since"], visitor.name, peer_of(request.scope)
        )
        if done is None:
            what = f"there is no such alarm: {shortened(asked['kind'])}, {shortened(asked['where'])}"
            return problem(404, f"{what}; it may have ended, or another one has begun")
        return json_answer(done.as_data())


async def _asked(request: Request, keys: Sequence[str]) -> dict[str, str] | Response:
    """Return the texts of the JSON in a request, or the response to malformed content."""
    example = ", ".join(f'"{key}": "…"' for key in keys)
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != JSON:
        return problem(415, f"send {JSON}: {{{example}}}")
    try:
        asked = json.loads(await request.body())
    except (ValueError, RecursionError):
        asked = None
    except ClientDisconnect:
        return problem(400, "the connection was closed before the body was complete")
    if (
        not isinstance(asked, dict)
        or asked.keys() != set(keys)
        or not all(isinstance(text, str) for text in asked.values())
    ):
        return problem(400, f"send {{{example}}}, and nothing else")
    return asked
