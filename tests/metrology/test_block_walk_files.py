"""Files of a gauge block walked along an axis: read as they say, or refused with the line and the remedy."""

import json
from pathlib import Path

import pytest

from gateway.compensation.direction import Direction
from gateway.metrology.formats.load import parse_survey
from gateway.metrology.readings import Reading
from gateway.metrology.standard import Grade, Standard
from gateway.tabfile.errors import TabFileError
from tests.metrology.test_differences import walk
from tests.support.commands import typed

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
TEXT = """# axis: x
# block_grade: 1
target_mm,direction,placement,block_mm,dial_um
0,forward,1,0,12
52.5,forward,1,50,2521
52.5,backward,1,50,2503
0,backward,1,0,-6
"""


def test_a_reading_is_the_block_and_the_dial() -> None:
    survey = parse_survey(TEXT.encode(), "walk.csv")
    assert survey.standard == Standard(Grade.ONE)
    assert (survey.axis, survey.units.value) == ("x", "mm")
    expected = [
        Reading(0.0, UP, 0.012, 1),
        Reading(52.5, UP, 52.521, 1, block=50.0),
        Reading(52.5, DOWN, 52.503, 1, block=50.0),
        Reading(0.0, DOWN, -0.006, 1),
    ]
    for found, right in zip(survey.readings, expected, strict=True):
        assert (found.target, found.direction, found.run, found.block) == (
            right.target, right.direction, right.run, right.block,
        )  # fmt: skip
        assert found.measured == pytest.approx(right.measured)


def test_a_gap_that_closes_and_a_dial_that_counts_down_turn_the_signs() -> None:
    closes = TEXT.replace("# axis", "# gap: closes\n# axis").replace("52.5", "-52.5")
    assert [round(each.measured, 6) for each in parse_survey(closes.encode(), "w").readings] == [
        -0.012, -52.521, -52.503, 0.006,
    ]  # fmt: skip
    down = (
        TEXT.replace("# axis", "# dial: reversed\n# axis").replace("2521", "-2521").replace("2503", "-2503")
    )
    assert [round(each.measured, 6) for each in parse_survey(down.encode(), "w").readings] == [
        -0.012, 52.521, 52.503, 0.006,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("# block_grade: 1\n", "", r"walk.csv: the block: give either its grade .block_grade: K, 0, 1, 2"),
        ("block_grade: 1", "block_grade: 4", r"# block_grade: 4: allowed are K, 0, 1, 2, and unknown"),
        ("# axis: x", "# gap: wide", r"# gap: wide; allowed: # gap: opens, or # gap: closes"),
        ("52.5,forward,1", "52.5,forward,0", r"walk.csv:5: placement '0'; allowed: a whole number from 1"),
        (
            "52.5,forward,1,50",
            "52.5,forward,1,-50",
            r"walk.csv:5: block -50; allowed: the length of the block",
        ),
        (
            "52.5,forward,1,50",
            "52.5,forward,1,0",
            r"walk.csv:5: placement 1 at 52.5: -\d.*\(else # dial: rev",
        ),
        (
            "0,backward",
            "0,forward",
            r"walk.csv:7: a second reading of placement 1 at 0, forward; the first is",
        ),
        ("dial_um", "dial_tenth", r"mixed units"),
        (",dial_um", ",gauge", r"walk.csv:3: 'gauge' in the heading; allowed: target_mm,direction,placement"),
        ("forward,1,0,12", "forward,1,0,1,2", r"walk.csv:4: 6 cells, perhaps because of a decimal comma"),
        ("block_mm", "block_um", r"walk.csv:3: 'block_um' in the heading; allowed: block_mm"),
    ],
)
def test_what_is_wrong_is_refused_with_its_line_and_the_remedy(old: str, new: str, told: str) -> None:
    assert old in TEXT
    with pytest.raises(TabFileError, match=told):
        parse_survey(TEXT.replace(old, new, 1).encode(), "walk.csv")


def written(folder: Path, grade: str = "0") -> Path:
    """Write a walk of 14 placements: 30 µm/m, 10 µm of lost motion."""
    lines = ["# axis: x", f"# block_grade: {grade}", "# lead: 5", "# compensation: off"]
    lines.append("target_mm,direction,placement,block_mm,dial_mm")
    lines += [
        f"{each.target},{each.direction.name.lower()},{each.run},{each.block},"
        f"{each.measured - each.block:.4f}"
        for each in walk(lambda x: 30e-6 * x).readings
    ]
    path = folder / "walk.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_table_build_takes_a_walk(tmp_path: Path) -> None:
    path, out = written(tmp_path), tmp_path / "x.csv"
    found = typed("table", "build", str(path), str(out), "--to", "csv")
    assert found.returncode == 0, found.stderr
    assert "14 placements of a block, grade 0, from 0 to 300" in found.stdout
    assert "joined from differences of 14 placements over 50 mm, grade 0" in " ".join(found.stderr.split())
    again = typed("table", "explain", str(out), "--at", "300", "--json")
    assert again.returncode == 0, again.stderr


def test_an_unknown_block_makes_a_table_without_a_scale_and_says_so(tmp_path: Path) -> None:
    out = tmp_path / "x.csv"
    found = typed("table", "build", str(written(tmp_path, "unknown")), str(out), "--to", "csv", "--json")
    assert found.returncode == 0, found.stderr
    result = json.loads(found.stdout)
    assert any("the scale cannot be determined" in each for each in result["notes"])
    assert result["scale"] is None


def test_a_walk_is_evaluated_and_not_refined(tmp_path: Path) -> None:
    path, out = written(tmp_path), tmp_path / "x.csv"
    found = typed("table", "evaluate", str(path), "--json")
    assert found.returncode == 0, found.stderr
    out.write_text("position_mm,forward_mm,backward_mm\n0,0,0\n300,0,0\n")
    refused = typed("table", "refine", str(out), str(path), str(tmp_path / "y.csv"))
    assert refused.returncode == 1
    assert "walk the block without a table, and make a new one with table build" in refused.stderr


def test_a_walk_is_drawn_beside_its_table(tmp_path: Path) -> None:
    path, table, out = written(tmp_path), tmp_path / "x.csv", tmp_path / "x.html"
    table.write_text("position_mm,forward_mm,backward_mm\n0,0,0\n300,-0.009,-0.009\n")
    found = typed("table", "plot", str(table), str(out), "--readings", str(path))
    assert found.returncode == 0, found.stderr
    assert "joined from differences of 14 placements" in out.read_text()
