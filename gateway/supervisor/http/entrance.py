"""What a person with a browser asks for: ``/login``, ``/logout``, ``/session`` and ``/acknowledge``."""

import json
from collections.abc import Sequence

from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from gateway.supervisor.http.access import Access, Visitor, peer_of
from gateway.supervisor.http.answers import JSON, json_answer, problem, shortened
from gateway.supervisor.http.window import Window

NOBODY: dict[str, object] = {"by": None, "how": None, "ends_in_s": None, "may_acknowledge": False}


class Entrance:
    """Answers of one listener; ``access`` is None where everybody may look."""

    def __init__(self, access: Access | None, window: Window) -> None:
        self._access = access
        self._window = window

    async def session(self, request: Request) -> Response:
        """Say who looks, where that had to be shown."""
        visitor: Visitor | None = getattr(request.state, "visitor", None)
        if self._access is None or visitor is None:
            return json_answer(NOBODY)
        ends_in_s = self._access.ends_in_s(visitor)
        may = self._access.may_acknowledge(visitor)
        return json_answer(
            {"by": visitor.name, "how": visitor.how, "ends_in_s": ends_in_s, "may_acknowledge": may}
        )

    async def log_in(self, request: Request) -> Response:
        """Take a token, once, for a session."""
        assert self._access is not None, "only where tokens are asked for"
        asked = await _asked(request, ("token",))
        if isinstance(asked, Response):
            return asked
        found = self._access.try_token(asked["token"].strip(), peer_of(request.scope))
        if isinstance(found, Response):
            return found
        return json_answer({"by": found.name}, headers={"Set-Cookie": self._access.log_in(found)})

    async def log_out(self, request: Request) -> Response:
        """End the session."""
        assert self._access is not None, "only where tokens are asked for"
        return json_answer({}, headers={"Set-Cookie": self._access.log_out(request.scope)})

    async def acknowledge(self, request: Request) -> Response:
        """Note that somebody has seen an alarm: the one thing that can be changed over TCP."""
        assert self._access is not None, "only where tokens are asked for"
        visitor: Visitor = request.state.visitor
        if not self._access.may_acknowledge(visitor):
            what = f'"{visitor.name}" may look only; a token with acknowledge = true may acknowledge'
            return problem(403, what)
        asked = await _asked(request, ("kind", "where", "since"))
        if isinstance(asked, Response):
            return asked
        done = self._window.acknowledge(asked["kind"], asked["where"], asked["since"], visitor.name)
        if done is None:
            what = f"there is no such alarm: {shortened(asked['kind'])}, {shortened(asked['where'])}"
            return problem(404, f"{what}; it may have ended, or be another one by now")
        return json_answer(done.as_data())


async def _asked(request: Request, keys: Sequence[str]) -> dict[str, str] | Response:
    """Return the texts that a request brings as JSON, or what to answer where it brings something else."""
    example = ", ".join(f'"{key}": "…"' for key in keys)
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != JSON:
        return problem(415, f"send {JSON}: {{{example}}}")
    try:
        asked = json.loads(await request.body())
    except (ValueError, RecursionError):
        asked = None
    except ClientDisconnect:
        return problem(400, "the connection was closed before the body was whole")
    if (
        not isinstance(asked, dict)
        or asked.keys() != set(keys)
        or not all(isinstance(text, str) for text in asked.values())
    ):
        return problem(400, f"send {{{example}}}, and nothing else")
    return asked
