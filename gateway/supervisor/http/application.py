"""The HTTP routes."""

import contextlib
import time
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping, Sequence
from functools import partial
from typing import Final

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route

from gateway.catalogue.alarms import ALARMS
from gateway.catalogue.publishing_events import HTTP_FAILED
from gateway.ipc.address import Peer
from gateway.limits import Reports
from gateway.status.model import Model
from gateway.supervisor.http.answers import NO_STORE, json_answer, not_there, problem, raw_json, shortened
from gateway.supervisor.http.curves import Tables
from gateway.supervisor.http.documents import Frames, Histories, PageFile, Window, read_page
from gateway.supervisor.http.listener import HttpServer
from gateway.supervisor.http.login import CHALLENGE, Authenticator, LoginRoutes
from gateway.supervisor.http.metrics import Metrics
from gateway.supervisor.http.stream import MEDIA_TYPE, EndlessResponse, EventStream, Models, StreamOptions
from gateway.supervisor.verdict import Health

PATHS: Final = (
    "/",
    "/status",
    "/healthz",
    "/metrics",
    "/events",
    "/tables/NAME",
    "/history/NAME",
    "/frames/NAME",
    "/page/NAME",
    "/session",
)
LOCAL_PATHS: Final = (*PATHS, "/reload", "/journal/erase")
ASKING_PATHS: Final = (*PATHS, "/login", "/logout", "/acknowledge")
"""Paths on which a client has to authenticate."""
POSTS: Final = frozenset(("/reload", "/journal/erase", "/login", "/logout", "/acknowledge"))
NOTHING_YET: Final = "nothing is known yet: the supervisor has just started"
Answer = Callable[[Request], Awaitable[Response]]


class Served:
    """What both listeners serve; made once."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._models = Models()
        self._metrics = Metrics(window.broadcast)
        self._tables = Tables(window)
        self._frames = Frames(window)
        self._histories = Histories(window)
        self._mistakes: Reports[str] = Reports()
        self._page: Mapping[str, PageFile] = read_page()

    def close(self) -> None:
        """Start no more long work."""
        self._tables.close()

    def application(
        self, http_server: HttpServer, there_is: Sequence[str], access: Authenticator | None = None
    ) -> Starlette:
        """Return the application of one listener.

        ``http_server`` counts the readers that stay connected; ``access`` authenticates them.
        """
        login_routes = LoginRoutes(access, self._window)
        answers: dict[str, Answer] = {
            "/": self._index,
            "/status": self._status,
            "/healthz": self._healthz,
            "/metrics": self._metrics_page,
            "/events": _Events(self._window, self._models, http_server, access).answer,
            "/tables/NAME": self._tables.answer,
            "/history/NAME": self._histories.answer,
            "/frames/NAME": self._frames.answer,
            "/page/NAME": self._page_file,
            "/reload": self._reload,
            "/journal/erase": self._erase,
            "/session": login_routes.session,
            "/login": login_routes.log_in,
            "/logout": login_routes.log_out,
            "/acknowledge": login_routes.acknowledge,
        }

        async def missing(request: Request, _error: Exception) -> Response:
            return not_there(request.scope["path"], there_is)

        async def other_method(request: Request, error: Exception) -> Response:
            assert isinstance(error, HTTPException)
            allowed = ", ".join(sorted((error.headers or {}).get("Allow", "GET").split(", ")))
            what = f"{request.method} is not supported at {request.scope['path']}, only {allowed}"
            return problem(405, what, {"Allow": allowed}, there_is=list(there_is))

        app = Starlette(
            routes=[
                Route(
                    path.replace("NAME", "{name}"),
                    answers[path],
                    methods=["POST"] if path in POSTS else ["GET"],
                )
                for path in there_is
            ],
            exception_handlers={404: missing, 405: other_method, Exception: self._failed},
        )
        app.router.redirect_slashes = False
        return app

    async def _index(self, request: Request) -> Response:
        if is_stranger(request):
            login = self._page["login.html"]
            return Response(login.content, 401, {**NO_STORE, **CHALLENGE}, login.media_type)
        return self._page["index.html"].answer(request)

    async def _page_file(self, request: Request) -> Response:
        name: str = request.path_params["name"]
        if name not in self._page:
            return not_there(f"/page/{name}", [f"/page/{there}" for there in self._page])
        return self._page[name].answer(request)

    async def _status(self, request: Request) -> Response:
        model = self._window.broadcast.model
        return problem(503, NOTHING_YET) if model is None else raw_json(self._models.encoded(model))

    async def _healthz(self, request: Request) -> Response:
        """Answer 200 as long as commands reach the drives. The text is the verdict and what is wrong."""
        model = self._window.broadcast.model
        reasons = why_unhealthy(model)
        if reasons and is_stranger(request):
            return problem(503, "not well; show a token to see why")
        if reasons or model is None:
            return json_answer({"problems": reasons}, 503)
        state = model.verdict.state
        lines = ["ok" if state == Health.HEALTHY.value else state]
        if not is_stranger(request):
            lines += [f"{each.severity}: {each.where}: {each.what}" for each in model.troubles]
        return PlainTextResponse("".join(f"{line}\n" for line in lines), headers=NO_STORE)

    async def _metrics_page(self, request: Request) -> Response:
        body, media_type = self._metrics.page(request.headers.get("accept", ""))
        return Response(body, headers={**NO_STORE, "Content-Type": media_type})

    async def _reload(self, request: Request) -> Response:
        return json_answer((await self._window.reload(_process_of(request))).as_data())

    async def _erase(self, request: Request) -> Response:
        person, before = (request.query_params.get(key, "") for key in ("person", "before"))
        try:
            count = await self._window.erase(person, before, _process_of(request))
        except OSError as error:
            return problem(503, f"the journal cannot be written: {error.strerror or error}")
        return json_answer({"entries": count})

    async def _failed(self, request: Request, error: Exception) -> Response:
        """Answer a request that failed because of a bug, and log the bug."""
        what = f"{shortened(request.scope['path'])}: {type(error).__name__}: {error}"
        if sentence := self._mistakes.sentence("failed", what, time.monotonic_ns()):
            self._window.log(HTTP_FAILED, detail=sentence)
        return problem(500, "an error in the supervisor; see its log")


class _Events:
    """``/events`` of one listener."""

    def __init__(
        self, window: Window, models: Models, http_server: HttpServer, access: Authenticator | None
    ) -> None:
        self._http_server = http_server
        self._access = access
        self._stream = EventStream(window.broadcast, models, http_server.limits)

    async def answer(self, request: Request) -> Response:
        if self._http_server.event_readers >= self._http_server.limits.event_readers:
            most = self._http_server.limits.event_readers
            return problem(
                503, f"{most} clients already read the events; try again later", {"Retry-After": "10"}
            )
        if request.method == "HEAD":
            return Response(headers=NO_STORE, media_type=MEDIA_TYPE)
        asked = request.query_params
        chooses = "events" in asked or "status" in asked
        options = StreamOptions(
            wants_events="events" in asked or not chooses,
            wants_status="status" in asked or not chooses,
            last_id=request.headers.get("last-event-id", ""),
        )
        is_over = None if self._access is None else partial(self._access.until_out, request.state.visitor)
        return EndlessResponse(self._read(options), NO_STORE, MEDIA_TYPE, is_over)

    async def _read(self, options: StreamOptions) -> AsyncGenerator[bytes, None]:
        with self._http_server.event_reader() as has_room:
            if not has_room:  # another reader took the last slot
                return
            async with contextlib.aclosing(self._stream.read(options)) as parts:
                async for part in parts:
                    yield part


def _process_of(request: Request) -> Mapping[str, object]:
    """Return which process of this computer asked."""
    peer: Peer | None = getattr(request.state, "peer", None)
    return {} if peer is None else peer.as_fields()


def is_stranger(request: Request) -> bool:
    """Whether the listener requires authentication and this request has none."""
    return getattr(request.state, "visitor", ...) is None


def why_unhealthy(model: Model | None) -> list[str]:
    """Return why commands do not reach a drive, one sentence each; empty if they reach all drives."""
    if model is None or (model.gateway.relay == "up" and model.gateway.snapshot_age_s is None):
        return [NOTHING_YET]
    return [f"{each.where}: {each.what}" for each in model.troubles if ALARMS[each.kind].cuts_off]
