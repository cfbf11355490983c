"""``/tables/NAME`` and ``/tables/NAME.svg``: curves, worked out beside the loop and kept for a while."""

import asyncio
from collections import OrderedDict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from gateway.compensation.settings import AxisSettings
from gateway.supervisor.http.answers import JSON, json_bytes, not_there, problem, shortened
from gateway.supervisor.http.curve import FEWEST, MOST, NoCurveError, curve_as_data, read_curve
from gateway.supervisor.http.drawing import MEDIA_TYPE, POINTS, drawing
from gateway.supervisor.http.window import Window

SVG: Final = ".svg"
KEPT_BYTES: Final = 4_000_000
AT_ONCE: Final = 1
"""Tables of millions of points take seconds and a hundred megabytes each; and a thread of their own, so that
nothing else has to wait for one."""


class Tables:
    """Answers with the curve of the table that an axis has."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._kept: OrderedDict[tuple[object, ...], bytes] = OrderedDict()
        self._threads = ThreadPoolExecutor(AT_ONCE, "curves")

    def close(self) -> None:
        """Work no more curves out."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def answer(self, request: Request) -> Response:
        """Answer ``/tables/NAME``."""
        name: str = request.path_params["name"]
        axis_name, is_drawing = name.removesuffix(SVG), name.endswith(SVG)
        model = self._window.feeds.model
        axes: Mapping[str, Any] = {} if model is None else model["axes"]
        if axis_name not in axes:
            names = [f"/tables/{axis}{SVG if is_drawing else ''}" for axis in axes]
            return not_there(f"/tables/{shortened(name)}", names)
        asked = request.query_params.get("points", str(MOST))
        if not asked.isascii() or not asked.isdigit() or not FEWEST <= int(asked[:9]) <= MOST:
            return problem(400, f"points={shortened(asked)}; allowed: {FEWEST} to {MOST}")
        axis, settings = axes[axis_name], self._window.settings_of(axis_name)
        digest = axis["table"].get("compiled")
        if not axis["table"]["points"] or not digest:
            return problem(404, f"axis {axis_name} has no table")
        if settings is None:
            return problem(503, "the configuration has not been read yet")
        points = min(int(asked), POINTS) if is_drawing else int(asked)
        try:
            body = await self._body(axis_name, axis, digest, settings, points, is_drawing=is_drawing)
        except NoCurveError as error:
            return problem(503, str(error))
        headers = {"Cache-Control": "no-cache"}
        return Response(body, headers=headers, media_type=MEDIA_TYPE if is_drawing else JSON)

    async def _body(
        self,
        name: str,
        axis: Mapping[str, Any],
        digest: str,
        settings: AxisSettings,
        points: int,
        *,
        is_drawing: bool,
    ) -> bytes:
        file, gain = axis["table"]["file"], tuple(axis["gain"].values())
        key = (name, digest, file, gain, settings, points, is_drawing)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]

        def worked_out() -> bytes:
            curve = read_curve(self._window.state, digest, axis, settings, points)
            if is_drawing:
                return drawing(name, axis, curve).encode()
            return json_bytes(curve_as_data(name, axis, digest, settings, curve))

        body = await asyncio.get_running_loop().run_in_executor(self._threads, worked_out)
        self._keep(key, body)
        return body

    def _keep(self, key: tuple[object, ...], body: bytes) -> None:
        self._kept[key] = body
        while sum(map(len, self._kept.values())) > KEPT_BYTES and len(self._kept) > 1:
            self._kept.popitem(last=False)
