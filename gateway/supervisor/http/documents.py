"""The files of the page, the newest frames of a line, and the history of an axis."""

import asyncio
import hashlib
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from gateway.compensation.settings import AxisSettings
from gateway.ipc.address import SocketError, socket_path
from gateway.ipc.client import NoGatewayError
from gateway.recording import traffic
from gateway.recording.capture import Capture, NoCaptureError
from gateway.recording.readable import Reader
from gateway.state.plan import GatewayPlan
from gateway.supervisor import page
from gateway.supervisor.acknowledged import AlarmAcknowledgement
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.event_log import LogEvent
from gateway.supervisor.http.answers import NO_STORE, json_answer, not_there, problem, shortened
from gateway.supervisor.in_thread import in_thread
from gateway.supervisor.outcome import ReloadOutcome
from gateway.supervisor.past import DAY_S, Noted, time_text, values_text
from gateway.times import NS_PER_S

# --- What the HTTP service sees of the supervisor, and what it may ask of it


async def _nothing(_axis: str, _span_s: float) -> None:
    return None


async def _erase_nothing(_person: str, _before: str, _who: Mapping[str, object]) -> int:
    return 0


@dataclass(frozen=True, slots=True)
class Window:
    """The HTTP service's only access to the supervisor."""

    broadcast: Broadcast
    state: Path
    """The state folder, with the compiled tables and the socket ``supervisor.sock``."""
    settings_of: Callable[[str], AxisSettings | None]
    """The settings of an axis in the configuration in force; None if there is none yet."""
    reload: Callable[[Mapping[str, object]], Awaitable[ReloadOutcome]]
    """Read configuration and tables again, for the process that asked."""
    log: LogEvent
    history: Callable[[str, float], Awaitable[Sequence[Noted] | None]] = _nothing
    """The positions of an axis over the last so many seconds; None: no such axis."""
    plan: Callable[[], GatewayPlan | None] = lambda: None
    """The plan of the configuration in force; None if there is none yet."""
    acknowledge: Callable[[str, str, str, str, str], AlarmAcknowledgement | None] = lambda *_what: None
    """Acknowledge an alarm, by its kind, where, since when, by whom, and from which address.

    None: there is no such alarm."""
    erase: Callable[[str, str, Mapping[str, object]], Awaitable[int]] = _erase_nothing
    """Take ``who`` out of the journal of interventions: of a person, or before a time, for the process that
    asked; return the number of entries. Raises OSError."""


def settings_in(plan: GatewayPlan | None, axis: str) -> AxisSettings | None:
    """Return the settings of an axis in a plan, for :attr:`Window.settings_of`."""
    axes = () if plan is None else (one for line in plan.lines for one in line.axes)
    return next((one.settings for one in axes if one.name == axis), None)


# --- The files of the page, read once: a fixed list of names. No part of a request is used as a path

TYPES: Final = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".json": "application/json",
    ".webmanifest": "application/manifest+json",
}
FOLDER: Final = Path(page.__file__).parent


@dataclass(frozen=True, slots=True)
class PageFile:
    """One file as it is served."""

    content: bytes
    media_type: str
    etag: str

    def answer(self, request: Request) -> Response:
        """Return the file, or 304 if it has not changed.

        A browser asks each time, so an upgrade shows immediately.
        """
        headers = {"ETag": self.etag, "Cache-Control": "no-cache"}
        etags = request.headers.get("if-none-match", "")
        if any(tag.strip().removeprefix("W/") in {self.etag, "*"} for tag in etags.split(",")):
            return Response(status_code=304, headers=headers)
        return Response(self.content, headers=headers, media_type=self.media_type)


def read_page() -> dict[str, PageFile]:
    """Return the files of the page, by name."""
    return {name: _read(FOLDER / name) for name in page.FILES}


def _read(path: Path) -> PageFile:
    content = path.read_bytes()
    return PageFile(content, TYPES[path.suffix], f'"{hashlib.sha256(content).hexdigest()[:32]}"')


# --- ``/frames/LINE``: the newest frames of a line, in words; each open page polls it

SHOWN: Final = 200
SIDES: Final = {"request": "controller", "answered": "controller", "sent": "drive", "reply": "drive"}
AT_ONCE: Final = 2
"""Maximum of simultaneous reads. Further requests are told to retry."""


class Frames:
    """Answers all clients."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._reading = 0

    async def answer(self, request: Request) -> Response:
        """Return the frames of a line; 404 for an unknown line, 503 if no frames are kept."""
        line: str = request.path_params["name"]
        plan = self._window.plan()
        names = [] if plan is None else [each.name for each in plan.lines]
        if plan is None or line not in names:
            return not_there(f"/frames/{shortened(line)}", [f"/frames/{name}" for name in names])
        if self._reading >= AT_ONCE:
            return problem(503, "other clients read the frames; try again in a moment", {"Retry-After": "1"})
        self._reading += 1
        try:
            frames = await in_thread(partial(read_frames, self._window.state, plan, line))
        except (NoGatewayError, NoCaptureError, SocketError) as error:
            return problem(503, str(error))
        finally:
            self._reading -= 1
        return json_answer({"line": line, "frames": frames})


def read_frames(state: Path, plan: GatewayPlan, line: str) -> list[dict[str, Any]]:
    """Return the newest frames of a line, oldest first, each with its time, its side and its description.

    Raises:
        NoGatewayError, NoCaptureError, SocketError: there are no trace buffers to read.
    """
    capture = Capture(socket_path(state), line)
    try:
        reader, frames = Reader(plan), []
        for t_ns, entry in capture.newest(SHOWN):
            if isinstance(entry, traffic.Header | traffic.End | traffic.Port | traffic.Beginning):
                continue
            kind = traffic.kind_of(entry)
            time_s = capture.wall_ns(t_ns) / NS_PER_S
            frames.append(
                {
                    "time": datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds"),
                    "kind": kind,
                    "side": SIDES.get(kind, ""),
                    "words": reader.text(entry).lstrip(),
                }
            )
        return frames
    finally:
        capture.close()


# --- ``/history/AXIS`` and ``/history/AXIS.csv``: the positions of an axis, read in a thread

MINUTES: Final = 10
"""Default length of the history."""
MOST_MINUTES: Final = DAY_S // 60
CSV: Final = ".csv"
MEDIA_TYPE: Final = "text/csv; charset=utf-8; header=present"
FILES_AT_ONCE: Final = 2
"""Maximum of simultaneous reads. Further requests wait."""


class Histories:
    """Answers all clients."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._semaphore = asyncio.Semaphore(FILES_AT_ONCE)

    async def answer(self, request: Request) -> Response:
        """Return the history of an axis; 404 for an unknown axis."""
        name: str = request.path_params["name"]
        axis, is_csv = name.removesuffix(CSV), name.endswith(CSV)
        asked = request.query_params.get("minutes", str(MINUTES))
        if not asked.isascii() or not asked.isdigit() or not 1 <= int(asked[:9]) <= MOST_MINUTES:
            return problem(400, f"minutes={shortened(asked)}; allowed: 1 to {MOST_MINUTES}")
        async with self._semaphore:
            found = await self._window.history(axis, 60.0 * int(asked))
        model = self._window.broadcast.model
        axes = model.axes if model else {}
        if found is None or axis not in axes:
            names = [f"/history/{there}{CSV if is_csv else ''}" for there in axes]
            return not_there(f"/history/{shortened(name)}", names)
        if is_csv:
            file = f"{axis}-{time_text(time.time()).replace(':', '')}{CSV}"
            headers = {**NO_STORE, "Content-Disposition": f'attachment; filename="{file}"'}
            return Response(_csv(found, axes[axis].units), headers=headers, media_type=MEDIA_TYPE)
        now_s = time.time()
        return json_answer(
            {
                "axis": axis,
                "ages_s": [round(now_s - noted.wall_s, 1) for noted in found],
                "nominal": [noted.nominal for noted in found],
                "correction": [_rounded(noted.correction) for noted in found],
            }
        )


def _csv(found: Sequence[Noted], units: str) -> str:
    head = f"time,nominal_{units},correction_{units},compensation\r\n"
    return head + "".join(f"{time_text(noted.wall_s)},{values_text(noted)}\r\n" for noted in found)


def _rounded(correction: float | None) -> float | None:
    return None if correction is None else round(correction, 7)
