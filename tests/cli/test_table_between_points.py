"""``table build, refine, evaluate`` about what lies between the targets: text, JSON and report alike."""

from pathlib import Path
from random import Random

import pytest

from tests.metrology import screws
from tests.support.table_commands import good, refused, run

ISSUE = next(each for each in screws.KINDS if "lead 5 told" in each.name)
WIDE = {"COLUMNS": "200"}


def written(path: Path, targets: list[float], screw: screws.Screw, *facts: str) -> Path:
    rows = [
        f"{each.target},{each.direction.name.lower()},{each.run},{each.measured:.6f}"
        for each in screw.survey(targets, 0.4, Random(7)).readings
    ]
    path.write_text("\n".join([*facts, "target_mm,direction,run,measured_mm", *rows]))
    return path


@pytest.fixture
def screw() -> screws.Screw:
    return screws.screw_of(ISSUE, 3)[0]


@pytest.fixture
def readings(tmp_path: Path, screw: screws.Screw) -> Path:
    return written(tmp_path / "r.csv", screws.targets_of(ISSUE, 61, 3), screw)


def test_the_lead_takes_the_turn_out_and_text_and_json_say_what_is_left(
    readings: Path, tmp_path: Path, screw: screws.Screw
) -> None:
    out = tmp_path / "t.csv"
    data = good("build", readings, out, "--to", "csv", "--lead", 5)
    assert data["fit"]["follows"] == "harmonics"
    assert [each["period"] for each in data["fit"]["harmonics"]] == [5.0, 2.5]
    assert data["fit"]["harmonics"][0]["amplitude_um"] == pytest.approx(3.0, abs=0.5)
    left_out = data["predicted"]["left_out_e_um"]
    # What is left at the targets is less than what is left between them.
    assert 0 < data["predicted"]["e_um"] < left_out < 4
    said = run("build", readings, out, "--to", "csv", "--lead", 5, "--force").stdout
    low, high = (data["predicted"][f"left_out_e_{bound}_um"] for bound in ("low", "high"))
    assert low < left_out < high
    assert (
        f"between its points the table will leave E = {left_out:.2f} µm (predicted by leaving out; " in said
    )
    assert f"{low:.2f} µm to {high:.2f} µm in nine of ten cases)" in said


def test_the_lead_may_stand_in_the_readings(tmp_path: Path, screw: screws.Screw) -> None:
    targets = screws.targets_of(ISSUE, 61, 3)
    told = written(tmp_path / "r.csv", targets, screw, "# lead: 5")
    assert good("build", told, tmp_path / "t.csv", "--to", "csv")["fit"]["follows"] == "harmonics"
    wrong = written(tmp_path / "w.csv", targets, screw, "# lead: five")
    assert "# lead: five: it must be a number" in refused("build", wrong, tmp_path / "w.tab", "--to", "csv")
    assert "lead -5: it must be a length above 0" in refused(
        "build", told, tmp_path / "w.tab", "--to", "csv", "--lead", -5
    )


def test_evaluate_and_its_report_say_the_same_of_the_table(readings: Path, tmp_path: Path) -> None:
    out, page = tmp_path / "t.csv", tmp_path / "page.html"
    data = good("build", readings, out, "--to", "csv", "--lead", 5)
    judged = good("evaluate", readings, "--table", out, "--lead", 5, "--report", page)
    left_out = data["predicted"]["left_out_e_um"]
    assert judged["after"]["left_out_e_um"] == pytest.approx(left_out, rel=1e-6)
    text = page.read_text()
    assert f"<td>{left_out:.2f}</td>" in text
    assert "With the table it is predicted to leave a systematic deviation E of" in text
    assert "in nine of ten cases between" in text
    assert judged["after"]["left_out_e_high_um"] > left_out


def test_an_even_grid_on_whole_turns_is_warned_of_with_what_to_measure(
    tmp_path: Path, screw: screws.Screw
) -> None:
    grid = written(tmp_path / "grid.csv", [10.0 * index for index in range(41)], screw)
    data = good("build", grid, tmp_path / "t.tab", "--lead", 5)
    (warning,) = data["fit"]["warnings"]
    assert "the targets are 10 mm apart, a multiple, or near one, of lead 5" in warning
    assert "--from 200 --to 210 --step 0.625" in warning
    untold = good("build", grid, tmp_path / "u.tab")
    assert any("give the lead of the screw: --lead" in note for note in untold["notes"])


def test_there_is_no_figure_of_what_no_target_showed(tmp_path: Path, screw: screws.Screw) -> None:
    """A grid of 20 mm on a lead of 5: the readings know nothing of the turn, of 3 µm, which is 6 µm of E."""
    grid = written(tmp_path / "grid.csv", [20.0 * index for index in range(21)], screw)
    out, page = tmp_path / "t.csv", tmp_path / "page.html"
    told = good("build", grid, out, "--to", "csv", "--lead", 5)["predicted"]
    assert (told["left_out_e_um"], told["left_out_e_high_um"]) == (None, None)
    assert 0 < told["left_out_e_low_um"] < 1
    assert told["left_out_unseen_periods"] == [5.0, 2.5, 20.0]
    why = (
        "not known from these readings: their targets cannot separate an error that repeats with lead 5 "
        "and half of lead 5 and the step of 20 and its whole fractions from a slower curve"
    )
    assert told["left_out_unknown"] == why
    good("evaluate", grid, "--table", out, "--lead", 5, "--report", page)
    assert page.read_text().count(why) == 2  # the sentence and the row
    assert f"<td>≥\N{NO-BREAK SPACE}{told['left_out_e_low_um']:.2f}</td>" in page.read_text()
    said = run("build", grid, out, "--to", "csv", "--lead", 5, "--force").stdout
    assert f"will leave at least E = {told['left_out_e_low_um']:.2f} µm; its full size is {why}" in said
    (row,) = [line for line in said.splitlines() if "between the targets" in line]
    assert f"≥ {told['left_out_e_low_um'] / 1000:.5f}" in row
    untold = good("build", grid, tmp_path / "u.csv", "--to", "csv")["predicted"]
    assert untold["left_out_unseen_periods"] == [20.0]
    # Targets that meet every angle leave nothing out.
    every = written(tmp_path / "every.csv", screws.targets_of(ISSUE, 41, 3), screw)
    shown = good("build", every, tmp_path / "e.csv", "--to", "csv", "--lead", 5)["predicted"]
    assert shown["left_out_unseen_periods"] == []
    assert shown["left_out_unknown"] is None
    assert shown["left_out_e_um"] > 0
    few = written(tmp_path / "few.csv", [0.0, 31.0, 60.0, 95.0], screw)
    unjudged = good("build", few, tmp_path / "f.csv", "--to", "csv")["predicted"]
    assert unjudged["left_out_e_um"] is None
    assert "too few or too many targets" in unjudged["left_out_unknown"]


def test_refine_says_when_another_round_brings_nothing(
    readings: Path, tmp_path: Path, screw: screws.Screw
) -> None:
    table = tmp_path / "t.csv"
    good("build", readings, table, "--to", "csv", "--fit", "smooth")
    again = tmp_path / "after.csv"
    random = Random(8)
    targets = screws.targets_of(ISSUE, 41, 9)
    from gateway.metrology.tables import correction_at
    from gateway.tabfile import FileContext, read_table

    used = read_table(table, FileContext()).table
    rows = []
    for run_number in (1, 2, 3):
        for way in (screws.UP, screws.DOWN):
            for x in targets:
                place = x + correction_at(used, x, way)
                measured = place + screw.deviation(place, way) + random.gauss(0, 0.0004)
                rows.append(f"{x},{way.name.lower()},{run_number},{measured:.6f}")
    again.write_text("\n".join(["target_mm,direction,run,measured_mm", *rows]))
    data = good("refine", table, again, tmp_path / "better.csv")
    assert any("another round at such targets does not help" in note for note in data["notes"])
    assert data["left_out_e_um"] > 0.8 * data["left_out_e_before_um"]
    assert data["left_out_e_low_before_um"] < data["left_out_e_before_um"] < data["left_out_e_high_before_um"]
    told = good("refine", table, again, tmp_path / "best.csv", "--lead", 5)
    # The turn of 3 µm goes: that is 6 µm of E.
    assert told["left_out_e_um"] < data["left_out_e_um"] - 4
