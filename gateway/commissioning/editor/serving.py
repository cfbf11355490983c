"""The page of ``table edit``: one file, on this computer only, until its tab is closed.

The address has a random token. Requests must name this computer as their host: a foreign page could point its
own name to 127.0.0.1, but not send this ``Host``.
"""

import secrets
import socketserver
import sys
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler
from importlib.resources import files
from typing import Any, Final, Literal

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from gateway.commissioning.editor.editing import EditError, Editing, State
from gateway.supervisor.http.answers import ALWAYS, BODY_BYTES, NO_STORE

LOOPBACK: Final = "127.0.0.1"
HEARTBEAT_S: Final = 10.0
"""Between two signs of life to the open tab: a dead one is noticed when it takes none."""
RELOAD_S: Final = 3.0
"""A tab that is loaded again comes back within this time."""
IDLE_S: Final = 30.0
"""How long a connection may be silent within a request, or before one."""
_OWN: Final = "gateway.commissioning.editor"
_OF_PAGE: Final = "gateway.supervisor.page"
FILES: Final = {
    "": (_OWN, "editor.html", "text/html; charset=utf-8"),
    "editor.js": (_OWN, "editor.js", "text/javascript; charset=utf-8"),
    "editor.css": (_OWN, "editor.css", "text/css; charset=utf-8"),
    "sheet.css": ("gateway.report", "sheet.css", "text/css; charset=utf-8"),
    "chart.js": (_OF_PAGE, "chart.js", "text/javascript; charset=utf-8"),
    "dom.js": (_OF_PAGE, "dom.js", "text/javascript; charset=utf-8"),
    "figures.js": (_OF_PAGE, "figures.js", "text/javascript; charset=utf-8"),
    "icon.svg": (_OF_PAGE, "icon.svg", "image/svg+xml"),
}
"""A fixed list. No part of a request is used as a path."""


class Asked(Struct, forbid_unknown_fields=True):
    """What the page asks for. ``try`` shows a change that is not kept, of a drag that goes on."""

    do: Literal["show", "change", "try", "undo", "redo", "save", "copy"]
    index: int = 0
    way: Literal["forward", "backward"] = "forward"
    value: float = 0.0
    together: bool = False


class EditorServer(socketserver.ThreadingTCPServer):
    """Serves one file; ``say`` gets a sentence for the terminal when the tab was closed without saving."""

    daemon_threads = True

    def __init__(self, editing: Editing, say: Callable[[str], None]) -> None:
        super().__init__((LOOPBACK, 0), _Handler)
        self.host: Final = f"{LOOPBACK}:{self.server_address[1]}"
        self.token: Final = secrets.token_urlsafe(24)
        self.lock: Final = threading.Lock()
        self._editing = editing
        self._say = say
        self._tabs = 0

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{self.host}/{self.token}/"

    def do(self, asked: Asked) -> tuple[bool, State]:
        """Do what the page asks; return whether it was done, and the new state with a sentence."""
        editing, said = self._editing, ""
        with self.lock:
            try:
                if asked.do in ("change", "try"):
                    is_kept = asked.do == "change"
                    return True, editing.change(
                        asked.index, asked.way, asked.value, together=asked.together, is_kept=is_kept
                    )
                if asked.do in ("undo", "redo"):
                    editing.go(-1 if asked.do == "undo" else 1)
                elif asked.do != "show":
                    said = editing.save() if asked.do == "save" else editing.save_copy()
            except EditError as error:
                return False, replace(editing.state(), said=str(error))
            return True, replace(editing.state(), said=said)

    def tab_opened(self) -> None:
        """Count a tab of the page."""
        with self.lock:
            self._tabs += 1

    def tab_closed(self) -> None:
        """Count it no more. End if no tab comes back, unless there are changes that would be lost."""
        with self.lock:
            self._tabs -= 1
        timer = threading.Timer(RELOAD_S, self._end_if_alone)
        timer.daemon = True
        timer.start()

    def _end_if_alone(self) -> None:
        with self.lock:
            if self._tabs:
                return
            if self._editing.is_changed:
                self._say(f"not saved yet: open {self.url} again, or press Ctrl-C to drop the changes")
                return
        self.shutdown()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that closes a connection; report anything else."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: EditorServer
    protocol_version = "HTTP/1.1"
    timeout = IDLE_S

    def do_GET(self) -> None:
        """Send a file of the page, or keep its stream open."""
        name = self._name()
        if name == "events":
            self._stream()
        elif name in FILES:
            package, file, media_type = FILES[name]
            self._answer(200, files(package).joinpath(file).read_bytes(), media_type)
        elif name is not None:
            self._answer(404, b"there is no such file")

    def do_POST(self) -> None:
        """Do what the page asks."""
        length = self.headers.get("content-length", "")
        # Only a browser sets these two for a page, and not every one sends both.
        is_ours = (
            self.headers.get("sec-fetch-site") == "same-origin"
            or self.headers.get("origin") == f"http://{self.server.host}"
        )
        if not (is_ours and length.isdecimal() and int(length) <= BODY_BYTES):
            self.close_connection = True
            self._answer(400, b"only the page itself may ask for this, in few bytes")
            return
        body = self.rfile.read(int(length))
        if (name := self._name()) != "do":
            if name is not None:
                self._answer(404, b"there is nothing to do here")
            return
        try:
            asked = msgspec.json.decode(body, type=Asked)
        except msgspec.DecodeError as error:
            self._answer(400, str(error).encode())
            return
        is_done, state = self.server.do(asked)
        self._answer(200 if is_done else 409, msgspec.json.encode(state), "application/json")

    def _name(self) -> str | None:
        """Return what is asked for behind the token; None if the request was refused."""
        if self.headers.get_all("host") != [self.server.host]:
            self.close_connection = True
            self._answer(421, f"this is {self.server.host}".encode())
            return None
        token, _, name = self.path.removeprefix("/").partition("/")
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self._answer(404, b"open the address that the command printed")
            return None
        return name

    def _answer(self, status: int, body: bytes, media_type: str = "text/plain; charset=utf-8") -> None:
        self._begin(status, media_type)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _begin(self, status: int, media_type: str) -> None:
        self.send_response_only(status)
        for name, value in ALWAYS:
            self.send_header(name.decode(), value.decode())
        for each in NO_STORE.items():
            self.send_header(*each)
        self.send_header("Content-Type", media_type)
        if self.close_connection:
            self.send_header("Connection", "close")

    def _stream(self) -> None:
        """Keep the stream open until the tab closes it: its end is the end of the tab."""
        self.close_connection = True
        self.server.tab_opened()
        try:
            self._begin(200, "text/event-stream")
            self.end_headers()
            self.connection.settimeout(HEARTBEAT_S)
            while True:
                self.wfile.write(b":\n\n")
                try:
                    if not self.connection.recv(1):
                        return
                except TimeoutError:
                    continue
        finally:
            self.server.tab_closed()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - the name in http.server
        """Log nothing: the terminal belongs to the person."""
