"""What all HTTP responses share, and the limits of the server."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
from starlette.responses import Response

# --- Responses: JSON, and the answer to an unknown path

CONTENT_SECURITY_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
ALWAYS: Final = (
    (b"content-security-policy", CONTENT_SECURITY_POLICY.encode("ascii")),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
"""Headers of every response."""
JSON: Final = "application/json"
NO_STORE: Final = {"Cache-Control": "no-store"}


def json_bytes(data: Any) -> bytes:
    """Return plain data as JSON. NaN and infinity, as of a division by zero, become null."""
    return msgspec.json.encode(data)


def json_answer(data: Any, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Return a response with plain data, marked as not cacheable."""
    return raw_json(json_bytes(data), status, headers)


def raw_json(body: bytes, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Return a response with JSON that is already encoded."""
    return Response(body, status, {**NO_STORE, **(headers or {})}, JSON)


def problem(status: int, what: str, headers: Mapping[str, str] | None = None, **more: Any) -> Response:
    """Return a response with an error message: ``{"problem": …}``."""
    return json_answer({"problem": what, **more}, status, headers)


def not_there(path: str, there_is: Sequence[str]) -> Response:
    """Answer an unknown path with the list of paths."""
    return problem(404, f"there is no {shortened(path)}", there_is=list(there_is))


def shortened(text: str, longest: int = 80) -> str:
    """Return a received text on one line of limited length.

    >>> shortened("/tables/" + "b" * 100, 12)
    '/tables/bbb…'
    """
    line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[:longest])
    return line if len(text) <= longest and len(line) <= longest else line[: longest - 1] + "…"


# --- Limits for a client; beyond them it is refused or disconnected

HEAD_BYTES: Final = 16_384
"""Of a request line with its header fields."""
TARGET_BYTES: Final = 4096
"""Of the path with its query, within the head."""
BODY_BYTES: Final = 4096
"""No request here needs a body."""
WRITE_HIGH_BYTES: Final = 65_536
"""Of a response that the client does not take: so much waits in this process, then its producer waits."""
SEND_BUFFER_BYTES: Final = 131_072
"""The same in the system's send buffer, which otherwise grows to megabytes."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Numbers and times of one listener."""

    connections: int = 256
    """Maximum number. A new connection replaces the one that has been idle for longest, else the one that
    has taken nothing of its response for longest. If the server is answering all of them, it refuses the new
    one."""
    event_readers: int = 32
    """Readers of ``/events``: they stay connected and are never idle."""
    whole_request_s: float = 10.0
    """From the start of a connection, or from the first byte of a later request, to the last byte of the
    request."""
    keep_alive_s: int = 15
    """How long a connection without a new request stays open."""
    stalled_s: float = 30.0
    """How long a client may take nothing of its response."""
    heartbeat_s: float = 15.0
    """Between two messages to a reader of ``/events`` when nothing happens, so that a dead one is noticed."""
    status_every_s: float = 0.2
    """Between two models to one reader of ``/events``."""
    sweep_s: float = 1.0
    """Interval between checks of these times."""


TCP: Final = Limits()
LOCAL: Final = Limits(connections=32, event_readers=8)
"""For the Unix socket: network clients cannot use up its connections."""
