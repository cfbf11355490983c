"""``/history/AXIS`` and ``/history/AXIS.csv``: where an axis was, read beside the loop."""

import asyncio
import time
from collections.abc import Sequence
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

from gateway.supervisor.http.answers import NO_STORE, json_answer, not_there, problem, shortened
from gateway.supervisor.http.window import Window
from gateway.supervisor.past import DAY_S, Noted, time_text, values_text

MINUTES: Final = 10
"""Where nothing else is asked for."""
MOST_MINUTES: Final = DAY_S // 60
CSV: Final = ".csv"
MEDIA_TYPE: Final = "text/csv; charset=utf-8; header=present"
AT_ONCE: Final = 2
"""So many are read at the same time; the next one waits."""


class Histories:
    """Answers for all who look."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._turn = asyncio.Semaphore(AT_ONCE)

    async def answer(self, request: Request) -> Response:
        """Return the past of an axis; 404 for an axis that there is not."""
        name: str = request.path_params["name"]
        axis, is_csv = name.removesuffix(CSV), name.endswith(CSV)
        asked = request.query_params.get("minutes", str(MINUTES))
        if not asked.isascii() or not asked.isdigit() or not 1 <= int(asked[:9]) <= MOST_MINUTES:
            return problem(400, f"minutes={shortened(asked)}; allowed: 1 to {MOST_MINUTES}")
        async with self._turn:
            found = await self._window.history(axis, 60.0 * int(asked))
        model = self._window.feeds.model
        axes = model["axes"] if model else {}
        if found is None or axis not in axes:
            names = [f"/history/{there}{CSV if is_csv else ''}" for there in axes]
            return not_there(f"/history/{shortened(name)}", names)
        if is_csv:
            file = f"{axis}-{time_text(time.time()).replace(':', '')}{CSV}"
            headers = {**NO_STORE, "Content-Disposition": f'attachment; filename="{file}"'}
            return Response(_csv(found, axes[axis]["units"]), headers=headers, media_type=MEDIA_TYPE)
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
