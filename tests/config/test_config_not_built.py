"""What this release cannot do is refused with what to do instead; the values that hold anyway may stand."""

from pathlib import Path

import pytest

from gateway.config.not_built import NOT_BUILT
from tests.config.config_bench import edited, line_of, only, refused

INSIDE_AXIS = [
    ('table_options.fagor_sense = "actual_minus_command"', "table_options.fagor_sense", "Centroid version 3"),
]


@pytest.mark.parametrize(("text", "key", "remedy"), INSIDE_AXIS, ids=[row[1] for row in INSIDE_AXIS])
def test_a_key_of_an_axis_that_is_not_built_is_refused(
    tmp_path: Path, text: str, key: str, remedy: str
) -> None:
    config = edited(("max_speed = 200.0", text))
    problem = only(refused(tmp_path, config), f"axis.x.{key}")
    assert problem.line == line_of(config, text)
    assert problem.found.endswith("is not built yet")
    assert remedy in problem.remedy


def test_everything_not_built_says_what_to_do() -> None:
    assert all(entry.what and entry.instead for entry in NOT_BUILT)
    assert len({entry.place for entry in NOT_BUILT}) == len(NOT_BUILT)
