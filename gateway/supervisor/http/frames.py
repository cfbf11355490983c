"""``/frames/LINE``: the newest frames of a line, in words; asked for again and again by whoever looks.

The relay does nothing for it: its tape is looked into, in a thread.
"""

from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from gateway.ipc.client import NoGatewayError
from gateway.ipc.place import SocketError, socket_path
from gateway.recording import traffic
from gateway.recording.capture import Capture, NoCaptureError
from gateway.recording.readable import Reader
from gateway.state.plan import GatewayPlan
from gateway.supervisor.aside import aside
from gateway.supervisor.http.answers import json_answer, not_there, problem, shortened
from gateway.supervisor.http.window import Window
from gateway.times import NS_PER_S

SHOWN: Final = 200
SIDES: Final = {"request": "controller", "answered": "controller", "sent": "drive", "reply": "drive"}
AT_ONCE: Final = 2
"""So many are read at the same time; the next is asked to come again."""


class Frames:
    """Answers for all who look."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._reading = 0

    async def answer(self, request: Request) -> Response:
        """Return the frames of a line; 404 for a line that there is not, 503 where none are kept."""
        line: str = request.path_params["name"]
        plan = self._window.plan()
        names = [] if plan is None else [each.name for each in plan.lines]
        if plan is None or line not in names:
            return not_there(f"/frames/{shortened(line)}", [f"/frames/{name}" for name in names])
        if self._reading >= AT_ONCE:
            return problem(503, "others look at the frames; try again in a moment", {"Retry-After": "1"})
        self._reading += 1
        try:
            frames = await aside(partial(read_frames, self._window.state, plan, line))
        except (NoGatewayError, NoCaptureError, SocketError) as error:
            return problem(503, str(error))
        finally:
            self._reading -= 1
        return json_answer({"line": line, "frames": frames})


def read_frames(state: Path, plan: GatewayPlan, line: str) -> list[dict[str, Any]]:
    """Return the newest frames of a line, oldest first, each with its time, its side and its words.

    Raises:
        NoGatewayError, NoCaptureError, SocketError: there is nothing to look into.
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
