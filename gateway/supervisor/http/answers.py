"""What every answer of the page has in common, and the limits of what is served."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgspec
from starlette.responses import Response

# --- Answers: JSON, and what is said to whoever asks for something that is not there

CONTENT_SECURITY_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
JSON: Final = "application/json"
NO_STORE: Final = {"Cache-Control": "no-store"}


def json_bytes(data: Any) -> bytes:
    """Return plain data as JSON; a number that is none, as of a division by zero, is null."""
    return msgspec.json.encode(data)


def json_answer(data: Any, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Return an answer of plain data that is never kept by whoever gets it."""
    return raw_json(json_bytes(data), status, headers)


def raw_json(body: bytes, status: int = 200, headers: Mapping[str, str] | None = None) -> Response:
    """Return an answer of JSON that was encoded before."""
    return Response(body, status, {**NO_STORE, **(headers or {})}, JSON)


def problem(status: int, what: str, headers: Mapping[str, str] | None = None, **more: Any) -> Response:
    """Return an answer that says what is wrong: ``{"problem": …}``."""
    return json_answer({"problem": what, **more}, status, headers)


def not_there(path: str, there_is: Sequence[str]) -> Response:
    """Answer a path that does not exist with those that do."""
    return problem(404, f"there is no {shortened(path)}", there_is=list(there_is))


def shortened(text: str, longest: int = 80) -> str:
    """Return a text that somebody sent in one line of bounded length.

    >>> shortened("/tables/" + "b" * 100, 12)
    '/tables/bbb…'
    """
    line = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text[:longest])
    return line if len(text) <= longest and len(line) <= longest else line[: longest - 1] + "…"


# --- What whoever connects may cost; beyond it he is told so, or dropped

HEAD_BYTES: Final = 16_384
"""Of a request: its line and its header fields."""
TARGET_BYTES: Final = 4096
"""Of that the path with its query."""
BODY_BYTES: Final = 4096
"""Nothing that is asked here needs a body at all."""
WRITE_HIGH_BYTES: Final = 65_536
"""So much of an answer waits in this process for whoever does not take it; then its maker waits."""
SEND_BUFFER_BYTES: Final = 131_072
"""And so much in the system: without a limit it grows to megabytes."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Numbers and times, of one listener."""

    connections: int = 256
    """At once. The one that has asked nothing for longest makes room, else one that takes nothing of its
    answer; where all are being answered the next is refused."""
    event_readers: int = 32
    """Of ``/events``: they stay, and are never idle."""
    whole_request_s: float = 10.0
    """From the start of a connection, or the first byte of a later request, to the last one of it."""
    keep_alive_s: int = 15
    """A connection on which nothing more is asked."""
    stalled_s: float = 30.0
    """Somebody who takes nothing of his answer."""
    heartbeat_s: float = 15.0
    """Between two words to a reader of ``/events`` when nothing happens, so that a dead one is noticed."""
    status_every_s: float = 0.2
    """Between two models to one reader of ``/events``."""
    sweep_s: float = 1.0
    """How often the times above are looked at."""


TCP: Final = Limits()
LOCAL: Final = Limits(connections=32, event_readers=8)
"""The Unix socket: nobody there can be kept out by those who come over the network."""
