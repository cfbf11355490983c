"""``/login``, ``/logout`` and ``/session``: how a person with a browser comes in, goes out, and who he is."""

import json

from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response

from gateway.supervisor.http.access import Access, Visitor, peer_of
from gateway.supervisor.http.answers import JSON, json_answer, problem

NOBODY: dict[str, object] = {"by": None, "how": None, "ends_in_s": None}


class Entrance:
    """Answers of one listener; ``access`` is None where everybody may look."""

    def __init__(self, access: Access | None) -> None:
        self._access = access

    async def session(self, request: Request) -> Response:
        """Say who looks, where that had to be shown."""
        visitor: Visitor | None = getattr(request.state, "visitor", None)
        if self._access is None or visitor is None:
            return json_answer(NOBODY)
        ends_in_s = self._access.ends_in_s(visitor)
        return json_answer({"by": visitor.name, "how": visitor.how, "ends_in_s": ends_in_s})

    async def log_in(self, request: Request) -> Response:
        """Take a token, once, for a session."""
        assert self._access is not None, "only where tokens are asked for"
        if request.headers.get("content-type", "").partition(";")[0].strip().lower() != JSON:
            return problem(415, f'send {JSON}: {{"token": "…"}}')
        try:
            asked = json.loads(await request.body())
        except (ValueError, RecursionError):
            asked = None
        except ClientDisconnect:
            return problem(400, "the connection was closed before the body was whole")
        if not isinstance(asked, dict) or asked.keys() != {"token"} or not isinstance(asked["token"], str):
            return problem(400, 'send {"token": "…"}, and nothing else')
        found = self._access.try_token(asked["token"].strip(), peer_of(request.scope))
        if isinstance(found, Response):
            return found
        return json_answer({"by": found.name}, headers={"Set-Cookie": self._access.log_in(found)})

    async def log_out(self, request: Request) -> Response:
        """End the session."""
        assert self._access is not None, "only where tokens are asked for"
        return json_answer({}, headers={"Set-Cookie": self._access.log_out(request.scope)})
