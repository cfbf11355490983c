"""What this release cannot do is refused with what to do instead; the values that hold anyway may stand."""

from pathlib import Path

import pytest

from gateway.config.not_built import NOT_BUILT
from tests.config.config_bench import GOOD, edited, line_of, loaded, only, refused

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


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('[http]\nlisten = "127.0.0.1:8480"\n', "http.listen"),
        ("[http]\n", "http.listen"),
    ],
)
def test_a_section_that_is_not_built_is_refused(tmp_path: Path, text: str, key: str) -> None:
    config = f"{GOOD}\n{text}"
    problem = only(refused(tmp_path, config), key)
    assert problem.line in {line_of(config, text), line_of(config, text) + 1}
    assert problem.found.endswith("is not built yet")


def test_a_status_page_that_listens_nowhere_may_stand(tmp_path: Path) -> None:
    assert loaded(tmp_path, GOOD + '[http]\nlisten = ""\n').warnings == ()


def test_everything_not_built_says_what_to_do() -> None:
    assert all(entry.what and entry.instead for entry in NOT_BUILT)
    assert len({(entry.place, entry.key) for entry in NOT_BUILT}) == len(NOT_BUILT)
