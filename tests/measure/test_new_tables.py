"""A table that ``measure`` writes means for its configuration what it was built as."""

import json
from html import escape
from math import sin
from pathlib import Path
from random import Random

import pytest

from gateway.commissioning.measure.outcome import outcome_of, write_report, write_table
from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.config.load import Loaded, load
from gateway.config.tables import context_of
from gateway.exchange.plan import AxisPlan
from gateway.metrology.lead import periods_of
from gateway.metrology.readings import Reading, Survey
from gateway.tabfile import parse_table
from tests.support.config import axis, gateway_toml, line

READINGS = Survey(
    tuple(
        Reading(target, way, target + error, run)
        for run in (1, 2)
        for way, errors in (
            (Direction.FORWARD, (0.0, 0.01, 0.02)),
            (Direction.BACKWARD, (0.005, 0.015, 0.025)),
        )
        for target, error in zip((0.0, 50.0, 100.0), errors, strict=True)
    ),
    Units.MM,
    "x",
)


def configured(folder: Path, options: str) -> tuple[Loaded, AxisPlan]:
    (folder / "x.csv").write_text("position_mm,correction_mm\n0,0\n100,0.01\n")
    (folder / "gateway.toml").write_text(
        gateway_toml(
            line(5020, {"cnc": 1502}),
            axis(
                more=f"table_options = {{ {options} }}\n",
                counts_per_unit=10000.0,
                travel=None,
                compensation="on",
                table="x.csv",
            ),
            tables=".",
        )
    )
    loaded = load(folder / "gateway.toml")
    return loaded, loaded.plan.lines[0].axes[0]


@pytest.mark.parametrize(
    ("options", "form"),
    [
        ('error_sense = "command_minus_actual", file_units = "mm"', "isg"),
        ('error_sense = "actual_minus_command", file_units = "mm"', "isg"),
        ('error_sense = "command_minus_actual", file_units = "mm", file_axis = "Q"', "fagor-8055"),
        ('error_sense = "actual_minus_command", file_units = "mm"', "fagor-8055"),
        # An old name counts for its own formats; a list of ISG means actual less command where none is told.
        ('isg_sense = "command_minus_actual", file_units = "mm"', "isg"),
        ('fagor_sense = "command_minus_actual", file_units = "mm"', "isg"),
        ('fagor_sense = "command_minus_actual", file_units = "mm"', "fagor-8055"),
        ("", "csv"),
    ],
)
def test_a_new_table_is_read_by_its_configuration_as_it_was_built(
    tmp_path: Path, options: str, form: str
) -> None:
    loaded, axis = configured(tmp_path, options)
    section = loaded.sections.axes["x"]
    outcome = outcome_of(READINGS, axis, is_active=False)
    notes = write_table(outcome, tmp_path / "new", form, axis, section, force=False)
    assert not [note for note in notes if "change table_options" in note]
    data = (tmp_path / "new").read_bytes()
    table = parse_table(data, "new", context_of(section, "x")).table
    # What was measured too far is taken back: -0.01 at 50 forward, less what there is at home.
    difference = table.forward[2] - table.forward[0], table.backward[2] - table.backward[0]
    assert difference == pytest.approx((-0.02, -0.02), abs=1e-4)
    assert table.forward[1] - table.backward[1] == pytest.approx(0.005, abs=1e-4)


def test_what_the_grid_does_not_cover_is_said_with_an_option_that_measure_has(tmp_path: Path) -> None:
    _, axis = configured(tmp_path, "")
    outcome = outcome_of(READINGS, axis, is_active=False, step=40.0)  # to 80 of 100 mm
    [note] = [note for note in outcome.notes if note.startswith("measured from 80 to 100 mm")]
    assert note.endswith("no multiple of the step is there: give a --table-step that divides both ends")


def test_options_with_which_it_would_be_another_table_are_said(tmp_path: Path) -> None:
    loaded, axis = configured(tmp_path, "")
    outcome = outcome_of(READINGS, axis, is_active=False)
    section = loaded.sections.axes["x"]
    notes = write_table(outcome, tmp_path / "new", "linuxcnc-1", axis, section, force=False)
    [note] = [note for note in notes if "change table_options" in note]
    assert "linuxcnc-0" in note


@pytest.mark.parametrize("is_active", [False, True])
def test_each_run_tells_how_sure_the_new_table_is_and_where_to_measure_next(
    tmp_path: Path, is_active: bool
) -> None:
    """A wave of 8 µm, read twice at eleven irregular targets; with a table in use it is what is left."""
    _, axis = configured(tmp_path, "")
    random = Random(3)
    targets = [0.0, 11.0, 19.0, 32.0, 40.0, 49.0, 61.0, 68.0, 81.0, 90.0, 100.0]
    survey = Survey(
        tuple(
            Reading(x, way, x + 0.008 * sin(x / 12) - way.value * 0.003 + random.gauss(0, 0.0005), run)
            for run in (1, 2, 3)
            for way in (Direction.FORWARD, Direction.BACKWARD)
            for x in targets
        ),
        Units.MM,
        "x",
        facts={"u_instrument": "1.5", "compensation": "active" if is_active else "off"},
    )
    outcome = outcome_of(survey, axis, is_active=is_active, periods=periods_of(5.0))
    data = json.loads(json.dumps(outcome.as_data()))
    assert data["uncertainty"]["missing"] == ["the temperature of the screw (--u-temperature)"]
    assert len(data["uncertainty"]["forward_um"]) == len(outcome.table.positions)
    assert 0.3 < data["uncertainty"]["largest_um"] < 8.0
    assert data["measure_next"]["do"] in ("next", "every-gap", "stop")
    assert 0.0 <= data["measure_next"]["at"] <= 100.0
    # The mean of three readings of 0.5 µm: 0.29 µm, as far as so few runs tell.
    assert data["measure_next"]["noise_um"] == pytest.approx(0.29, rel=0.4)
    assert outcome.advice is not None
    said = list(outcome.lines())
    assert outcome.advice.describe() in said
    assert any(each.startswith("uncertainty of a correction (k = 2, 95 %)") for each in said)
    assert not any("table build" in each for each in said) or not is_active
    write_report(outcome, tmp_path / "r.html", "x", None, force=False)
    page = (tmp_path / "r.html").read_text()
    assert escape(outcome.advice.describe()) in page
    assert ("correction-uncertainty-forward" in page) is not is_active
