"""Answers: JSON, and what is said to whoever asks for something that is not there."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import msgspec
from starlette.responses import Response

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
