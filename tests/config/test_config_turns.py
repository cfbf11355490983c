"""Tables of rotary axes from controls that say that they repeat."""

from pathlib import Path

import pytest

from tests.config.config_bench import edited, loaded, refusal

LIST = """\
kw.ssfk.unit 1
kw.ssfk.interval 900000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 5
kw.ssfk.bilateral 0
kw.ssfk.modulo 1
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 20
kw.ssfk.table[2].pos 35
kw.ssfk.table[3].pos 20
kw.ssfk.table[4].pos 0
"""
TOLD = 'table_options = { file_units = "degree" }'


def rotary(travel: str, options: str = TOLD) -> str:
    return edited(
        ('units = "mm"', 'units = "degree"'),
        ('"cnc10x.tab"', f'"c.lis"\n{options}'),
        ("travel = [-300.0, 0.0]", travel),
    )


@pytest.mark.parametrize("travel", ["travel = [-720.0, 720.0]", ""])
def test_a_table_that_repeats_on_an_axis_that_does_not_is_warned_of(tmp_path: Path, travel: str) -> None:
    warnings = loaded(tmp_path, rotary(travel), {"c.lis": LIST}).warnings
    [warning] = [warning for warning in warnings if "repeats after" in warning.found]
    assert warning.key == "axis.x.table"
    assert "after 360 degree" in warning.found
    assert "the correction of the end holds" in warning.found
    assert warning.remedy == "add to the axis: modulo = 360"


@pytest.mark.parametrize("travel", ["travel = [0.0, 360.0]", "modulo = 360.0"])
def test_an_axis_that_stays_in_one_turn_or_repeats_is_not_warned(tmp_path: Path, travel: str) -> None:
    warnings = loaded(tmp_path, rotary(travel), {"c.lis": LIST}).warnings
    assert not [warning for warning in warnings if "repeats after" in warning.found]


def test_a_list_for_an_axis_in_degree_says_what_to_tell(tmp_path: Path) -> None:
    plain = LIST.replace("kw.ssfk.modulo 1\n", "")
    problem = refusal(tmp_path, rotary("", ""), "axis.x.table", tables={"c.lis": plain})
    assert problem.remedy == "allowed: file_units = 'degree'"
