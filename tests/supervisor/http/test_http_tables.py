"""``/tables/NAME``: the curve in force, on the controller's scale, thinned without losing its extremes."""

import math
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from gateway.compensation.settings import AxisSettings, Backlash, BacklashKind
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.state.tables import table_path
from gateway.supervisor.http.curves import thinned, ticks
from tests.supervisor.http.http_bench import Answer, keep_table, model, serving, snapshot
from tests.support.status_models import model_of

SVG = "{http://www.w3.org/2000/svg}"
SMALL = make_table([0.0, 50.0, 100.0], [0.0, 0.1, -0.2], [0.0, 0.3, 0.4], Units.MM)
SETTINGS = AxisSettings(counts_per_unit=1000.0, units=Units.MM, machine_offset=-300.0, travel=(-10.0, 110.0))


def having(digest: str | None, points: int, **axis: Any) -> dict[str, Any]:
    table = {"file": "x<&>.tab", "format": "centroid-3", "sha256": "ab", "compiled": digest, "points": points}
    return model(
        snapshot(
            axis={
                "table": {**table, "status": "active", "error": None, "loaded_at": None},
                "gain": {"forward": 1.0, "backward": 0.5},
                **axis,
            }
        )
    )


async def answered(
    state: Path, table: CorrectionTable, target: str, settings: AxisSettings = SETTINGS, **axis: Any
) -> Answer:
    digest = keep_table(state, table)
    async with serving(state, settings=settings) as served:
        served.broadcast.publish(model_of(having(digest, len(table.positions), **axis)))
        first = await served.ask(target)
        again = await served.ask(target)
        assert (again.status, again.body) == (first.status, first.body)
        return first


async def test_the_curve_has_its_gain_and_stands_where_the_controller_has_it(tmp_path: Path) -> None:
    answer = await answered(tmp_path, SMALL, "/tables/x")
    assert answer.status == 200
    data = answer.data
    assert data["digest"] == keep_table(tmp_path, SMALL)
    # nominal = machine - machine_offset: the table's 0 to 100 is 300 to 400 for the controller.
    assert data == {
        "axis": "x",
        "units": "mm",
        "file": "x<&>.tab",
        "digest": data["digest"],
        "gain": {"forward": 1.0, "backward": 0.5},
        "machine_offset": -300.0,
        "travel": [290.0, 410.0],
        "modulo": None,
        "table_points": 3,
        "is_whole": True,
        "indexes": [0, 1, 2],
        "positions": [300.0, 350.0, 400.0],
        "forward": [0.0, 0.1, -0.2],
        "backward": [0.0, 0.15, 0.2],
    }


async def test_lost_motion_from_the_configuration_is_in_the_curve(tmp_path: Path) -> None:
    one_way = make_table([0.0, 100.0], [0.0, 0.1], [0.0, 0.1], Units.MM)
    settings = AxisSettings(
        counts_per_unit=1000.0, units=Units.MM, backlash=Backlash(0.02, BacklashKind.TWO_SIDED)
    )
    answer = await answered(tmp_path, one_way, "/tables/x", settings, gain={"forward": 1.0, "backward": 1.0})
    assert (answer.data["forward"], answer.data["backward"]) == ([0.01, 0.11], [-0.01, 0.09])
    assert answer.data["travel"] is None


def long_table(count: int) -> CorrectionTable:
    """A sine with one point that sticks out of each branch."""
    positions = [float(n) for n in range(count)]
    forward = [0.1 * math.sin(n / 500.0) for n in range(count)]
    backward = [value + 0.02 for value in forward]
    forward[3217], backward[7001] = 0.3, -0.25
    return make_table(positions, forward, backward, Units.MM)


@pytest.mark.parametrize("most", [10, 100, 801])
async def test_thinning_keeps_the_ends_and_the_extremes(tmp_path: Path, most: int) -> None:
    answer = await answered(tmp_path, long_table(9000), f"/tables/x?points={most}")
    data = answer.data
    assert len(data["positions"]) <= most
    assert len(data["positions"]) >= most / 2
    assert (data["table_points"], data["is_whole"]) == (9000, False)
    assert data["indexes"] == sorted(set(data["indexes"]))
    assert (data["indexes"][0], data["indexes"][-1]) == (0, 8999)
    assert {3217, 7001} <= set(data["indexes"])
    assert (max(data["forward"]), min(data["backward"])) == (0.3, -0.125)
    at = data["indexes"].index(3217)
    assert data["positions"][at] == 3217.0 + 300.0  # a point of the table, nothing in between


def test_a_table_that_is_small_enough_stays_whole() -> None:
    assert list(thinned(SMALL, 10)) == [0, 1, 2]
    assert list(thinned(long_table(9000), 9000)) == list(range(9000))


async def test_a_very_large_table_is_thinned_without_being_asked_to(tmp_path: Path) -> None:
    answer = await answered(tmp_path, long_table(50_000), "/tables/x")
    assert 5_000 <= len(answer.data["positions"]) <= 10_000
    assert answer.data["table_points"] == 50_000


async def test_the_drawing_is_a_document_of_its_own(tmp_path: Path) -> None:
    answer = await answered(tmp_path, SMALL, "/tables/x.svg")
    assert answer.headers["content-type"] == "image/svg+xml"
    root = ET.fromstring(answer.body)
    assert root.tag == f"{SVG}svg"
    texts = [text.text for text in root.iter(f"{SVG}text")]
    assert texts[0] == "Axis x: x<&>.tab"
    assert {"position, mm", "correction, µm", "forward", "backward", "300", "400", "0", "-200"} <= set(texts)
    forward, backward = root.iter(f"{SVG}polyline")
    assert len(forward.attrib["points"].split()) == 3
    # 0.1 mm above nothing, in a range of -0.2 to 0.2 with 8 % room: the middle is at (44 + 284) / 2 = 164,
    # and 240 / (1.16 * 0.4) pixels are a mm.
    assert forward.attrib["points"].split()[1] == f"{(80 + 740) / 2:.1f},{164 - 0.1 * 240 / 0.464:.1f}"
    assert backward.attrib["stroke-dasharray"]  # told apart without colours
    assert len(list(root.iter(f"{SVG}circle"))) == 6
    assert not [name for element in root.iter() for name in element.attrib if name in {"href", "style"}]


async def test_a_drawing_of_many_points_stays_small(tmp_path: Path) -> None:
    answer = await answered(tmp_path, long_table(50_000), "/tables/x.svg")
    assert len(answer.body) < 40_000


async def test_a_table_of_zeros_can_be_drawn(tmp_path: Path) -> None:
    flat = make_table([0.0, 1e-6], [0.0, 0.0], [0.0, 0.0], Units.INCH)
    settings = AxisSettings(counts_per_unit=1e9, units=Units.INCH)
    answer = await answered(tmp_path, flat, "/tables/x.svg", settings, units="inch")
    texts = [text.text for text in ET.fromstring(answer.body).iter(f"{SVG}text")]
    assert {"position, inch", "correction, 0.001 inch", "1e-06"} <= set(texts)


def test_ticks_are_round() -> None:
    assert ticks(-0.3, 0.3, 6) == [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2, 0.3]
    assert ticks(0.0, 1234.0, 8) == [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0, 1200.0]


async def test_what_has_no_curve_says_why(tmp_path: Path) -> None:
    digest = keep_table(tmp_path, SMALL)
    async with serving(tmp_path, settings=SETTINGS) as served:
        early = await served.ask("/tables/x")
        assert (early.status, early.data["there_is"]) == (404, [])
        served.broadcast.publish(model_of(having(None, 0)))
        without = await served.ask("/tables/x")
        assert (without.status, without.data) == (404, {"problem": "axis x has no table"})
        unknown = await served.ask("/tables/y.svg")
        assert (unknown.status, unknown.data["there_is"]) == (404, ["/tables/x.svg"])
        served.broadcast.publish(model_of(having("0" * 64, 3)))
        gone = await served.ask("/tables/x")
        assert gone.status == 503
        assert gone.data["problem"].startswith(f"compiled table {'0' * 64}: no such file")
        path = table_path(tmp_path, digest)
        path.write_bytes(path.read_bytes()[:-1] + b"\1")
        served.broadcast.publish(model_of(having(digest, 3)))
        damaged = await served.ask("/tables/x")
        assert (damaged.status, damaged.data["problem"]) == (
            503,
            f"compiled table {digest}: the points of the compiled table are damaged: their digest is another",
        )
    async with serving(tmp_path) as served:
        served.broadcast.publish(model_of(having(digest, 3)))
        assert (await served.ask("/tables/x")).status == 503  # no configuration yet
