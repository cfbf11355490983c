"""A gateway as the page sees one: its files, a stream that a test writes, and curves."""

import contextlib
import json
import socket
import threading
from collections.abc import Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from gateway.supervisor import page

FOLDER: Final = Path(page.__file__).parent
POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
TYPES: Final = {
    ".html": "text/html",
    ".css": "text/css",
    ".js": "text/javascript",
    ".svg": "image/svg+xml",
    ".json": "application/json",
}
WAIT_S: Final = 0.1


class Stage:
    """Serves the page; what it shows is what :meth:`show` and :meth:`publish_event` gave last."""

    def __init__(self) -> None:
        self.tables: dict[str, Mapping[str, Any]] = {}
        """Curves by axis, as ``/tables/AXIS`` answers them."""
        self.past: dict[str, Mapping[str, Any]] = {}
        """The last ten minutes by axis, as ``/history/AXIS`` answers them."""
        self.asked: list[str] = []
        """Paths of all requests."""
        self.spans: list[str] = []
        """Queries of those for the past of an axis."""
        self.may_acknowledge = False
        self.acknowledged: list[Any] = []
        """What came as ``POST /acknowledge``."""
        self.refusal = HTTPStatus.OK
        """How that is answered."""
        self.is_mute = False
        """Streams stay open and say nothing."""
        self.is_full = False
        """No stream is to be had."""
        self._model: Mapping[str, Any] | None = None
        self._version = 0
        self._events: list[Mapping[str, Any]] = []
        self._changed = threading.Condition()
        self._connections: set[socket.socket] = set()
        self._server: ThreadingHTTPServer | None = None
        self._port = 0

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://127.0.0.1:{self._port}/"

    def open(self) -> None:
        """Listen; on the same port as before where it was open already."""
        stage = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"

            def setup(self) -> None:
                super().setup()
                stage._connections.add(self.connection)

            def finish(self) -> None:
                stage._connections.discard(self.connection)
                super().finish()

            def handle(self) -> None:
                with contextlib.suppress(OSError, ValueError):  # the browser, or this stage, went away
                    super().handle()

            def do_GET(self) -> None:
                stage._answer(self)

            def do_POST(self) -> None:
                stage._take(self)

            def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
                pass

        class Server(ThreadingHTTPServer):
            daemon_threads = True
            block_on_close = False

            def handle_error(self, request: Any, client_address: Any) -> None:
                pass  # the browser, or this stage, went away

        self._server = Server(("127.0.0.1", self._port), Handler)
        self._port = self._server.server_address[1]
        threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True
        ).start()

    def close(self) -> None:
        """Go away as a process that was killed does."""
        server, self._server = self._server, None
        if server is None:
            return
        server.shutdown()
        server.server_close()
        for connection in list(self._connections):
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def show(self, model: Mapping[str, Any]) -> None:
        """Have every page show another model."""
        with self._changed:
            self._model = json.loads(json.dumps(model))
            self._version += 1
            self._changed.notify_all()

    def publish_event(self, event: Mapping[str, Any]) -> None:
        """Tell every page of an event."""
        with self._changed:
            self._events.append(event)
            self._changed.notify_all()

    def _answer(self, request: BaseHTTPRequestHandler) -> None:
        path = unquote(urlsplit(request.path).path)
        self.asked.append(path)
        if path == "/events" and self.is_full:
            self._send(request, b"{}", "application/json", HTTPStatus.SERVICE_UNAVAILABLE)
        elif path == "/events":
            self._stream(request)
        elif path == "/session":
            session = {"by": None, "how": None, "ends_in_s": None, "may_acknowledge": self.may_acknowledge}
            self._send(request, json.dumps(session).encode(), "application/json")
        elif path == "/status":
            self._send(request, json.dumps(self._model).encode(), "application/json")
        elif path.startswith("/tables/") and path[8:] in self.tables:
            self._send(request, json.dumps(self.tables[path[8:]]).encode(), "application/json")
        elif path.startswith("/history/"):
            self.spans.append(urlsplit(request.path).query)
            past = self.past.get(path[9:], {"ages_s": [], "nominal": [], "correction": []})
            self._send(request, json.dumps(past).encode(), "application/json")
        elif path == "/" or (path.startswith("/page/") and path[6:] in page.FILES):
            file = FOLDER / (path[6:] or "index.html")
            self._send(request, file.read_bytes(), TYPES[file.suffix])
        else:
            self._send(request, b"{}", "application/json", HTTPStatus.NOT_FOUND)

    def _take(self, request: BaseHTTPRequestHandler) -> None:
        body = request.rfile.read(int(request.headers["Content-Length"]))
        self.acknowledged.append((request.path, request.headers["Content-Type"], json.loads(body)))
        self._send(request, b"{}", "application/json", self.refusal)

    def _send(
        self, request: BaseHTTPRequestHandler, content: bytes, media_type: str, status: int = HTTPStatus.OK
    ) -> None:
        request.send_response(status)
        request.send_header("Content-Type", f"{media_type}; charset=utf-8")
        request.send_header("Content-Length", str(len(content)))
        request.send_header("Content-Security-Policy", POLICY)
        request.end_headers()
        request.wfile.write(content)

    def _stream(self, request: BaseHTTPRequestHandler) -> None:
        request.send_response(HTTPStatus.OK)
        request.send_header("Content-Type", "text/event-stream")
        request.send_header("Cache-Control", "no-store")
        request.end_headers()
        server, version, told = self._server, 0, 0
        while self._server is server:
            with self._changed:
                if self._version == version and len(self._events) == told:
                    self._changed.wait(WAIT_S)
                parts = [_message("event", event) for event in self._events[told:]]
                told = len(self._events)
                if self._version != version and self._model is not None:
                    parts.append(_message("status", self._model))
                    version = self._version
            request.wfile.write(b": \n\n" if self.is_mute else b"".join(parts) or b": \n\n")


def _message(name: str, data: Mapping[str, Any]) -> bytes:
    return f"event: {name}\ndata: {json.dumps(data)}\n\n".encode()
