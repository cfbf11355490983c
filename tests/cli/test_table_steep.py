"""Screws and belts whose error is steep: the limit of the axis decides, and the reason is said as it is."""

from pathlib import Path
from random import Random

import pytest

from gateway.metrology.cycle import random_targets
from tests.metrology import screws
from tests.support.table_commands import good, refused, run

# 9 µm once in 5 mm: 2 pi * 0.009 / 5 = 0.0113.
STEEP = screws.CurveKind(
    "9 µm a turn", 300, lambda _: (screws.wave(9, 5, 1.0), screws.constant(10)), 41, 41, 0.2, lead=5.0
)
BELT = screws.CurveKind(
    "belt", 600, lambda _: (screws.wave(20, 5, 1.0), screws.constant(40)), 61, 61, 1.0, lead=100.0
)


def written(path: Path, kind: screws.CurveKind, *facts: str) -> tuple[Path, screws.Screw, list[float]]:
    screw = screws.Screw(kind, *kind.make(()))
    targets = [float(x) for x in random_targets(0.0, kind.length, kind.few, seed=1, spread=5.0)]
    rows = [
        f"{each.target},{each.direction.name.lower()},{each.run},{each.measured:.6f}"
        for each in screw.survey(targets, kind.noise_um, Random(7)).readings
    ]
    path.write_text("\n".join([*facts, "target_mm,direction,run,measured_mm", *rows]))
    return path, screw, targets


def left(path: Path, screw: screws.Screw, targets: list[float]) -> float:
    from gateway.tabfile import FileContext, read_table

    table = read_table(path, FileContext(max_slope=0.5)).table
    return screw.leaves_um(table, targets[0], targets[-1])


def test_a_steep_turn_is_taken_out_where_the_axis_allows_it(tmp_path: Path) -> None:
    readings, screw, targets = written(tmp_path / "r.csv", STEEP)
    out = tmp_path / "t.csv"
    data = good("build", readings, out, "--to", "csv", "--lead", 5, "--max-slope", 0.02)
    assert data["fit"]["follows"] == "harmonics"
    assert left(out, screw, targets) < 1.0
    assert any("set max_slope = 0.012 in the configuration of the axis" in note for note in data["notes"])
    told, *_ = written(tmp_path / "told.csv", STEEP, "# max_slope: 0.02", "# lead: 5")
    assert good("build", told, tmp_path / "told-t.csv", "--to", "csv")["fit"]["follows"] == "harmonics"


def test_the_note_says_that_it_is_the_slope_and_not_the_format(tmp_path: Path) -> None:
    readings, *_ = written(tmp_path / "r.csv", STEEP)
    notes = good("build", readings, tmp_path / "t.csv", "--to", "csv", "--lead", 5)["notes"]
    (said,) = [note for note in notes if "cannot be written" in note]
    assert "its slope is 0.011" in said
    assert "above 0.01; --max-slope 0.012, if the screw is really so bad" in said
    assert "--to csv" not in said
    assert "format" not in said


def test_a_format_of_few_points_is_named_as_that(tmp_path: Path) -> None:
    readings, *_ = written(tmp_path / "r.csv", STEEP)
    told = ("--lead", 5, "--max-slope", 0.02, "--home", "switch-positive")
    notes = good("build", readings, tmp_path / "t.comp", "--to", "linuxcnc-0", *told)["notes"]
    (said,) = [note for note in notes if "cannot be written" in note]
    assert said.endswith(
        "this format does not hold it (1199 points, allowed: at most 256: LinuxCNC drops more); --to csv does"
    )


def test_a_format_that_begins_at_home_is_named_as_that_and_the_grid_that_reaches_it_is_made(
    tmp_path: Path,
) -> None:
    """Targets begin beside home, and the points that follow the turns begin where they do."""
    readings, screw, targets = written(tmp_path / "r.csv", STEEP)
    told = ("--to", "centroid-3", "--axis", "x", "--lead", 5, "--max-slope", 0.02)
    notes = good("build", readings, tmp_path / "t.tab", *told)["notes"]
    (said,) = [note for note in notes if "cannot be written" in note]
    assert said.endswith("allowed: a range that begins or ends at home, 0); --to csv does")
    out = tmp_path / "grid.tab"
    good("build", readings, out, *told, "--step", 0.25, "--travel", 0, 300, "--home", "switch-positive")
    assert left(out, screw, targets) < 1.5


def test_telling_the_tooth_of_a_belt_makes_nothing_worse(tmp_path: Path) -> None:
    readings, screw, targets = written(tmp_path / "r.csv", BELT)
    for name, options in (
        ("untold", ()),
        ("told", ("--lead", 100, "--period", 5)),
        ("steep", ("--lead", 100, "--period", 5, "--max-slope", 0.05)),
    ):
        good("build", readings, tmp_path / f"{name}.csv", "--to", "csv", *options)
    untold, told, steep = (left(tmp_path / f"{n}.csv", screw, targets) for n in ("untold", "told", "steep"))
    assert told <= untold * 1.1
    # Points at an eighth of a turn of 20 µm leave up to 8 % of it, finer ones less.
    assert steep < 4.0


def test_a_table_that_is_too_steep_even_as_lines_is_refused_with_the_option(tmp_path: Path) -> None:
    readings = tmp_path / "r.csv"
    readings.write_text(
        "target_mm,direction,run,measured_mm\n"
        + "".join(
            f"{x},{way},1,{x + error}\n"
            for way in ("forward", "backward")
            for x, error in ((0, 0.0), (1, 0.0), (2, 0.03), (3, 0.0), (4, 0.0), (5, 0.0))
        )
    )
    said = refused("build", readings, tmp_path / "t.csv", "--to", "csv", "--keep-scale", "--fit", "lines")
    assert "its slope is 0.03" in said
    assert "--max-slope 0.0" in said


@pytest.mark.parametrize("slope", ["0", "1", "-0.1"])
def test_a_slope_that_no_axis_may_have_is_refused(tmp_path: Path, slope: str) -> None:
    readings, *_ = written(tmp_path / "r.csv", STEEP, f"# max_slope: {slope}")
    result = run("build", readings, tmp_path / "t.csv", "--to", "csv", "--max-slope", slope)
    assert result.exit_code == 2
    assert "above 0 and below 1" in result.output
    assert f"# max_slope: {slope}: it must be above 0 and below 1" in refused(
        "build", readings, tmp_path / "u.csv", "--to", "csv"
    )
