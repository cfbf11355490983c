"""What this release cannot do is refused with what to do instead; the values that hold anyway may stand."""

from pathlib import Path

import pytest

from gateway.config.not_built import NOT_BUILT
from tests.config.config_bench import GOOD, edited, line_of, loaded, only, refused

INSIDE_AXIS = [
    ('drive = "oriental-az"', "drive", "[axis.NAME.registers]"),
    ("budget_us = 500", "budget_us", "leave it out"),
    ("deadline_ms = 10", "deadline_ms", "leave it out"),
    ('late = "forward"', "late", "leave it out"),
    ('stored_moves = "uncorrected"', "stored_moves", 'write "refuse"'),
    ('relative_unknown = "pass"', "relative_unknown", 'write "refuse"'),
    ('table_options.fagor_sense = "actual_minus_command"', "table_options.fagor_sense", "Centroid version 3"),
]
INSIDE_REGISTERS = [
    ('mode = { source = "sticky", address = 2, absolute = [1], relative = [2] }', "mode", 'source = "fixed"'),
    ("trigger = [{ address = 2, start = [1] }]", "trigger", "as soon as the position is written"),
    ("staged = true", "staged", "as soon as the position is written"),
    ("starts_on = [0x0607]", "starts_on", "in one frame"),
    ('limits = [{ address = 2, type = "int32" }]', "limits", "leave it out only if"),
    ('aliases = [{ address = 2, type = "int32" }]', "aliases", "leave it out only if"),
    ('write = "fc06"', "write", '"fc16", or a position of type int16'),
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
    ("text", "key", "remedy"), INSIDE_REGISTERS, ids=[row[1] for row in INSIDE_REGISTERS]
)
def test_a_key_of_a_register_map_that_is_not_built_is_refused(
    tmp_path: Path, text: str, key: str, remedy: str
) -> None:
    config = GOOD + text + "\n"
    problem = only(refused(tmp_path, config), f"axis.x.registers.{key}")
    assert problem.line == line_of(config, text)
    assert problem.found.endswith("is not built yet")
    assert remedy in problem.remedy


@pytest.mark.parametrize("way", ["homing", "set-position"])
def test_references_that_have_to_be_followed_are_refused(tmp_path: Path, way: str) -> None:
    problem = only(refused(tmp_path, edited(('"drive-bit"', f'"{way}"'))), "axis.x.referenced")
    assert "not built yet" in problem.found
    assert '"drive-bit"' in problem.remedy


def test_an_operator_is_refused(tmp_path: Path) -> None:
    text = edited(('"monitor"', '"operator"'))
    problem = only(refused(tmp_path, text), "line.xyz.controllers[2].role")
    assert problem.line == line_of(text, '"operator"')
    assert '"monitor"' in problem.remedy


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('[http]\nlisten = "127.0.0.1:8480"\n', "http.listen"),
        ("[http]\n", "http.listen"),
        ("[mqtt]\n", "mqtt"),
        ('[group.gantry]\naxes = ["y1", "y2"]\n', "group.gantry"),
    ],
)
def test_a_section_that_is_not_built_is_refused(tmp_path: Path, text: str, key: str) -> None:
    config = f"{GOOD}\n{text}"
    problem = only(refused(tmp_path, config), key)
    assert problem.line in {line_of(config, text), line_of(config, text) + 1}
    assert problem.found.endswith("is not built yet")


@pytest.mark.parametrize(
    "text",
    [
        edited(("max_speed = 200.0", 'unmapped = "refuse"')),
        edited(("max_speed = 200.0", 'stored_moves = "refuse"')),
        edited(("max_speed = 200.0", 'relative_unknown = "refuse"')),
        GOOD + 'mode = { source = "fixed" }\n',
        GOOD + "staged = false\ntrigger = []\nstarts_on = []\nlimits = []\n",
        GOOD + '[http]\nlisten = ""\n',
        edited(('0x0606, type = "int32"', '0x0606, type = "int16", scale = 10')) + 'write = "fc06"\n',
    ],
)
def test_what_says_the_same_as_leaving_it_out_may_stand(tmp_path: Path, text: str) -> None:
    assert loaded(tmp_path, text).warnings == ()


def test_everything_not_built_says_what_to_do() -> None:
    assert all(entry.what and entry.instead for entry in NOT_BUILT)
    assert len({(entry.place, entry.key) for entry in NOT_BUILT}) == len(NOT_BUILT)
