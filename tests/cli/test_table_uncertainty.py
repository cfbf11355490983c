"""``table build, evaluate, plot`` about the uncertainty of each correction: text, JSON and report alike."""

from pathlib import Path
from random import Random

import pytest

from gateway.metrology.cycle import random_targets
from tests.support.table_commands import good, refused, run

TARGETS = random_targets(0.0, 300.0, 11, seed=2, spread=5.0)


ADVICE = {
    "next": "measure next at ",
    "every-gap": "measure in the middle of every gap: ",
    "stop": "stop: another reading brings less than the gauge",
}


def written(path: Path, targets: list[float], bend_um: float, *facts: str) -> Path:
    """Write three runs of an axis that bends by so much, by an instrument that scatters by 0.5 µm."""
    random = Random(5)
    rows = [
        f"{x},{way},{run},{x + 1e-3 * (bend_um * (x / 300) ** 2 + random.gauss(0, 0.5)):.6f}"
        for run in (1, 2, 3)
        for way in ("forward", "backward")
        for x in targets
    ]
    path.write_text("\n".join([*facts, "target_mm,direction,run,measured_mm", *rows]))
    return path


def test_every_point_has_an_uncertainty_and_the_instrument_makes_it_larger(tmp_path: Path) -> None:
    readings = written(tmp_path / "r.csv", TARGETS, 20.0, "# lead: 5")
    out = tmp_path / "t.csv"
    command = ("build", readings, out, "--to", "csv", "--home", "switch-positive", "--force")
    data = good(*command)
    found = data["uncertainty"]
    assert found["missing"] == [
        "the instrument (--u-instrument)", "the temperature of the screw (--u-temperature)",
    ]  # fmt: skip
    assert found["at_least_because"] is None
    assert len(found["forward_um"]) == len(found["backward_um"]) == len(found["positions"])
    # At home the correction is 0 by definition. Elsewhere 0.5 µm of six readings at each of eleven targets.
    assert found["forward_um"][0] == pytest.approx(0.0, abs=0.01)
    assert 0.1 < found["forward_um"][-1] < 2.0
    stated = good(*command, "--u-instrument", 3, "--u-temperature", 0.5)["uncertainty"]
    assert stated["missing"] == []
    # k = 2: 3 µm over the whole length, and 0.6 * 11.5 µm/m/K * 300 mm * 0.5 K = 1.035 µm.
    length = TARGETS[-1] - TARGETS[0]
    whole = (found["forward_um"][-1] ** 2 + 9.0 + (0.6 * 11.5e-3 * length * 0.5) ** 2) ** 0.5
    assert stated["forward_um"][-1] == pytest.approx(whole, rel=0.01)
    said = run(*command).stdout
    assert f"at most ±{found['largest_um']:.2f} µm ({found['largest_direction']} at" in said
    assert "not in it, because not stated: the instrument (--u-instrument) and the temperature" in said
    assert ADVICE[data["measure_next"]["do"]] in said
    judged = good("evaluate", readings, "--table", out)
    assert judged["measure_next"]["do"] == data["measure_next"]["do"]
    assert judged["measure_next"]["at"] == data["measure_next"]["at"]
    assert judged["measure_next"]["e_then_um"] == pytest.approx(data["measure_next"]["e_then_um"], rel=1e-4)
    told = judged["uncertainty"]
    assert told["forward_um"] == pytest.approx(found["forward_um"], abs=1e-6)
    assert good("evaluate", readings)["uncertainty"] is None


def test_the_instrument_may_be_stated_in_the_readings(tmp_path: Path) -> None:
    bare, stated = (
        written(tmp_path / name, TARGETS, 20.0, "# lead: 5", *facts)
        for name, facts in (("a.csv", ()), ("b.csv", ("# u_instrument: 3",)))
    )
    command = ("--to", "csv", "--force")
    by_option = good("build", bare, tmp_path / "t.csv", *command, "--u-instrument", 3)["uncertainty"]
    by_line = good("build", stated, tmp_path / "t.csv", *command)["uncertainty"]
    assert by_line == by_option
    wrong = written(tmp_path / "w.csv", TARGETS, 20.0, "# u_instrument: small")
    assert "# u_instrument: small: it must be a number, 0 or more" in refused(
        "build", wrong, tmp_path / "w.tab", "--to", "csv"
    )
    wrong.write_text(wrong.read_text().replace("small", "-2"))
    assert "# u_instrument: -2: it must be 0 or more" in refused(
        "build", wrong, tmp_path / "w.tab", "--to", "csv"
    )
    below = run("build", bare, tmp_path / "w.tab", "--to", "csv", "--u-instrument", -1)
    assert below.exit_code == 2
    assert not (tmp_path / "w.tab").exists()


def test_corrections_that_are_noise_are_named_and_left_out_where_asked(tmp_path: Path) -> None:
    """An axis without any error: what a table would correct of it is the scatter of the instrument."""
    readings = written(tmp_path / "r.csv", TARGETS, 0.0, "# lead: 5")
    command = ("build", readings, tmp_path / "t.csv", "--to", "csv", "--force")
    found = good(*command)["uncertainty"]
    named, points = found["noise"], len(found["positions"])
    # Nineteen of twenty corrections are below their uncertainty.
    assert len(named) >= 2 * points * 0.8
    said = run(*command, "--drop-noise").stdout
    assert "are noise" not in said
    rows = good("show", tmp_path / "t.csv")["rows"]
    zeros = {(row["position"], way) for row in rows for way in ("forward", "backward") if row[way] == 0.0}
    assert zeros >= {(each["position"], each["direction"]) for each in named}
    few = written(tmp_path / "few.csv", [0.0, 100.0, 200.0], 20.0)
    assert "remove --drop-noise: these readings do not tell what is noise" in refused(
        "build", few, tmp_path / "u.csv", "--to", "csv", "--drop-noise"
    )
    assert not (tmp_path / "u.csv").exists()


def test_the_band_is_in_the_picture_and_beside_the_points_of_the_report(tmp_path: Path) -> None:
    readings = written(tmp_path / "r.csv", TARGETS, 20.0, "# lead: 5")
    out, page = tmp_path / "t.csv", tmp_path / "page.html"
    found = good("build", readings, out, "--to", "csv")["uncertainty"]
    good("evaluate", readings, "--table", out, "--report", page)
    text = page.read_text()
    assert 'id="axis1-correction-uncertainty-forward"' in text
    assert "within it" in text
    assert f"<small>±\N{NO-BREAK SPACE}{found['forward_um'][3]:.2f}</small>" in text
    assert "uncertainty of a correction (k = 2, 95 %)" in text
    assert any(f"<li>{words}" in text for words in ADVICE.values())
    picture = tmp_path / "t.svg"
    good("plot", out, picture)
    assert "uncertainty-forward" not in picture.read_text()
    good("plot", out, picture, "--readings", readings, "--force")
    assert "uncertainty-backward" in picture.read_text()
