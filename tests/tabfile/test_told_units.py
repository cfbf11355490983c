"""What an option is told in, where the file has other units than the axis: a remedy taken literally helps."""

import re
from typing import Any

import pytest

from gateway.compensation.units import Units
from tests.tabfile.texts import Texts

FANUC = "3620,1\n3621,1\n3622,2\n3623,1\n3624,1\npoint,value\n1,2\n2,5\n"
REN = (
    "Compensation start 0\nCompensation end 2\nCompensation spacing 1\nNo. Axis position Combined\n"
    "1 0 0\n2 1 5\n3 2 3\n"
)
CSV = "position_inch,correction_inch\n-2,0\n-1,0.0005\n0,0\n"
V2 = "2 2 1.0 20 50000 -2.0\n0\n5\n0\n; backward\n0\n5\n0\n"
V2_INFERRED = "2 4 1.0 20 1 0\n0\n5\n0\n5\n0\n; backward\n0\n5\n0\n5\n0\n"
V2_OTHER_SIDE = V2.replace("-2.0", "0.0")
MINT = "DIM f(2) = 1.001, 2\nPRECISIONTABLE(0, f)\nPRECISIONINCREMENT = 1\nPRECISIONOFFSET = -2\n"
FILE = Texts("x", {"units": Units.MM})
parse, refused = FILE.parse, FILE.refused


@pytest.mark.parametrize("text", [FANUC, REN])
def test_a_scale_is_asked_for_per_unit_of_the_axis(text: str) -> None:
    error = refused(text, file_units=Units.INCH)
    assert re.search(r"\bper mm\b|\bin one mm\b", error.allowed)
    # 10 000 to the inch; the largest number is 5, in a sum of Fanuc's and as it stands in the other
    loaded = parse(text, file_units=Units.INCH, file_counts_per_unit=10_000 / 25.4)
    assert max(loaded.table.forward) == pytest.approx(0.0005, rel=1e-12)


def test_what_a_scale_per_unit_of_the_axis_makes_is_said() -> None:
    loaded = parse(FANUC, file_units=Units.INCH, file_counts_per_unit=1000.0)
    assert (
        "25400 counts per inch: file_counts_per_unit is given per mm, the unit of the axis"
        in loaded.source.decisions
    )
    same = parse(FANUC, file_units=Units.MM, file_counts_per_unit=1000.0)
    assert not any("counts per" in decision for decision in same.source.decisions)


@pytest.mark.parametrize(
    ("text", "facts"),
    [(CSV, {}), (MINT, {"file_units": Units.INCH}), (V2_OTHER_SIDE, {"travel": (-50.8, 0.0)})],
)
def test_a_start_that_a_message_names_is_one_that_is_taken(text: str, facts: dict[str, Any]) -> None:
    wrong: dict[str, Any] = {} if "travel" in facts else {"file_start": 10.0}
    error = refused(text, **facts, **wrong)
    named = re.search(r"file_start = (-?[0-9.]+)", error.allowed)
    assert named is not None
    # -2 inch
    assert float(named[1]) == pytest.approx(-50.8, rel=1e-9)
    assert parse(text, **facts, file_start=float(named[1])).table.first == pytest.approx(-2.0, rel=1e-9)


def test_an_inferred_start_is_confirmed_in_units_of_the_axis() -> None:
    (remark,) = (lint for lint in parse(V2_INFERRED, travel=(-50.8, 50.8)).lints if lint.code == "R2")
    assert "file_start = -50.8" in remark.message
    confirmed = parse(V2_INFERRED, travel=(-50.8, 50.8), file_start=-50.8)
    assert confirmed.table.first == pytest.approx(-2.0)
    assert "R2" not in {lint.code for lint in confirmed.lints}
