"""``/history/AXIS``, as JSON and as CSV, for a chosen span."""

import time
from collections.abc import Sequence
from pathlib import Path

import pytest

from gateway.supervisor.past import Noted
from tests.supervisor.http.http_bench import model, serving

MAY_S = 1_777_636_800.0
"""2026-05-01T12:00:00Z."""


async def of_x(axis: str, span_s: float) -> Sequence[Noted] | None:
    if axis != "x":
        return None
    now_s = time.time()
    return [Noted(now_s - span_s, -120.5, 0.0221, "active"), Noted(now_s, None, None, "unreferenced")]


@pytest.mark.parametrize(("query", "age_s"), [("", 600.0), ("?minutes=1", 60.0), ("?minutes=1440", 86_400.0)])
async def test_the_past_of_an_axis(tmp_path: Path, query: str, age_s: float) -> None:
    async with serving(tmp_path, history=of_x, newest=model()) as served:
        told = (await served.ask(f"/history/x{query}")).data
        assert told["axis"] == "x"
        assert told["ages_s"][0] == pytest.approx(age_s, abs=30.0)
        assert (told["nominal"], told["correction"]) == ([-120.5, None], [0.0221, None])


async def test_as_csv(tmp_path: Path) -> None:
    async def at_noon(_axis: str, _span_s: float) -> Sequence[Noted]:
        return [Noted(MAY_S, -120.5, 0.0221, "active"), Noted(MAY_S + 10, None, None, "unreferenced")]

    async with serving(tmp_path, history=at_noon, newest=model()) as served:
        answer = await served.ask("/history/x.csv?minutes=60")
        assert answer.status == 200
        assert answer.headers["content-type"].startswith("text/csv; charset=utf-8")
        named = answer.headers["content-disposition"]
        assert named.startswith('attachment; filename="x-20')
        assert named.endswith('Z.csv"')
        assert answer.body.decode() == (
            "time,nominal_mm,correction_mm,compensation\r\n"
            "2026-05-01T12:00:00Z,-120.500000,0.0221000,active\r\n"
            "2026-05-01T12:00:10Z,,,unreferenced\r\n"
        )


@pytest.mark.parametrize("minutes", ["0", "1441", "-1", "ten", "", "1.5", "9" * 5000])
async def test_a_span_that_is_none(tmp_path: Path, minutes: str) -> None:
    async with serving(tmp_path, history=of_x, newest=model()) as served:
        answer = await served.ask(f"/history/x?minutes={minutes}")
        assert answer.status in {400, 414}
        assert len(answer.body) < 1000


async def test_an_axis_that_there_is_not(tmp_path: Path) -> None:
    async with serving(tmp_path, history=of_x, newest=model()) as served:
        for name, there in (("y", "/history/x"), ("y.csv", "/history/x.csv"), ("..%2Fx", "/history/x")):
            answer = await served.ask(f"/history/{name}")
            assert answer.status == 404
            if "%" not in name:
                assert answer.data["there_is"] == [there]
