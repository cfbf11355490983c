"""``pitch-gateway signtest`` with numbers and with questions."""

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from gateway.cli.app import app
from tests.support.config import axis, gateway_toml, line, tab, written


def configured(folder: Path, **keys: Any) -> Path:
    """Write a configuration with axis x, and an axis y without a table.

    Home is at the minus end: away from home is forward. At 200 mm the table of x adds 20 µm forward and takes
    away 10 µm.
    """
    table = tab(0.0, 0.0, (0.02, -0.01), interval=100.0)
    text = gateway_toml(
        line(5020, {"cnc": 1502}),
        axis(machine_offset=100.0, travel=[0.0, 200.0], compensation="on", **{"table": "x.tab", **keys}),
        axis("y", unit_id=2, travel=[0.0, 200.0], compensation="on"),
    )
    return written(folder, text, {"x.tab": table})


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return configured(tmp_path)


def typed(config: Path, *arguments: str, typed_in: str | None = None) -> Result:
    return CliRunner().invoke(app, ["signtest", str(config), *arguments], input=typed_in)


def numbers(at: float, forward: float, backward: float) -> list[str]:
    return ["--at", str(at), "--forward-reading", str(forward), "--backward-reading", str(backward)]


@pytest.mark.parametrize(
    ("forward", "backward", "verdict", "code"),
    [
        (99.98, 100.01, "right", 0),
        (100.02, 99.99, "sense inverted", 1),
        (100.01, 99.98, "columns swapped", 1),
        (99.99, 100.02, "sense inverted and columns swapped", 1),
        (-100.0, -100.0, "axis direction inverted", 1),
        (-300.0, -300.0, "axis direction inverted", 1),  # about machine zero, which is at -100
        (100.2, 99.9, "nothing fits", 1),
    ],
)
def test_each_verdict_has_its_code(
    config: Path, forward: float, backward: float, verdict: str, code: int
) -> None:
    # The controller's 100 is machine position 200.
    result = typed(config, "--axis", "x", *numbers(100.0, forward, backward), "--json")
    assert result.exit_code == code
    report = json.loads(result.stdout)
    assert report["verdict"] == verdict
    # Travel ends at 100: 1 mm and the hysteresis of 0.002 mm are left to approach it from above.
    assert report["best"]["position"] == pytest.approx(98.998)
    assert (report["table"]["forward"], report["table"]["backward"]) == (0.02, -0.01)


def test_the_remedy_names_the_file_and_what_to_change(config: Path) -> None:
    inverted = typed(config, "--axis", "x", *numbers(100.0, 100.02, 99.99))
    assert "verdict: sense inverted\n  change the sign of every correction in x.tab" in inverted.stdout
    swapped = typed(config, "--axis", "x", *numbers(100.0, 100.01, 99.98))
    assert "in x.tab exchange its second and third column: away from home, towards home" in swapped.stdout
    mirrored = typed(config, "--axis", "x", *numbers(100.0, -100.02, -99.99))
    assert "change the sign of counts_per_unit" in mirrored.stdout
    shifted = typed(config, "--axis", "x", *numbers(100.0, 100.28, 100.31))
    assert "approached in that direction: both readings are off by the same -0.3 mm" in shifted.stdout
    scaled = typed(config, "--axis", "x", *numbers(100.0, 99.8, 100.1))
    assert (
        "check the units of the table and file_counts_per_unit: the readings are about 10 times its values"
        in scaled.stdout
    )


@pytest.mark.parametrize(
    ("readings", "verdict", "said"),
    [
        ((100.0, 100.2), "right", "axis x at 100 mm, backlash alone"),
        ((99.8, 100.0), "sense inverted and columns swapped", 'write kind = "homed-backward"'),
        ((100.0, 99.8), "sense inverted", "a lost motion below 0"),
        ((100.2, 100.0), "columns swapped", "a lost motion below 0"),
    ],
)
def test_a_backlash_without_a_table_is_tested_too(
    config: Path, readings: tuple[float, float], verdict: str, said: str
) -> None:
    configured(config.parent, table=None, backlash={"width": 0.2, "kind": "homed-forward"})
    result = typed(config, "--axis", "x", *numbers(100.0, *readings))
    assert f"verdict: {verdict}\n" in result.stdout
    assert said in result.stdout


def test_where_it_cannot_be_told_a_better_place_is_named(config: Path) -> None:
    result = typed(config, "--axis", "x", *numbers(0.0, 0.0, 0.0))
    assert result.exit_code == 1
    assert "verdict: cannot tell: right or sense inverted or columns swapped" in result.stdout
    # At the controller's 100, where travel ends: 0.04, 0.03 and 0.01; the smallest is 1 % less at 98.998.
    assert "measure at 98.998 mm, where right and wrong use differ by 0.0099 mm" in result.stdout
    rough = typed(config, "--axis", "x", *numbers(0.0, 0.0, 0.0), "--uncertainty", "0.005")
    assert "the readings must be better than ±0.00495 mm" in rough.stdout


def test_without_numbers_it_asks_and_says_where_to_measure(config: Path) -> None:
    result = typed(config, "--axis", "x", typed_in="\n98.9782\n99.0079\n")
    assert result.exit_code == 0
    assert "The best position for this test is 98.998 mm. Go to 97.996, then up to 98.998, " in result.stderr
    assert "Go to 100, then down to 98.998, and read again." in result.stderr
    assert "verdict: right" in result.stdout


@pytest.mark.parametrize("typed_in", ["", "\n99.98\n"])
def test_where_the_answers_end_the_missing_numbers_are_named(config: Path, typed_in: str) -> None:
    arguments = ["signtest", str(config), "--axis", "x"]
    result = CliRunner().invoke(app, arguments, input=typed_in, env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert "give --at, --forward-reading and --backward-reading" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["--axis", "x", "--at", "1"], 2, "together: --at, --forward-reading and"),
        (["--axis", "q"], 1, "there is no axis q; there are x, y"),
        (["--axis", "y", *numbers(0, 0, 0)], 1, "axis.y.table: missing; name the table"),
        (["--axis", "x", *numbers(150, 0, 0)], 1, "150 is outside its table, -100 to 100"),
        (["--axis", "x", *numbers(float("nan"), 0, 0)], 1, "is nan: it must be a finite number"),
        (["--axis", "x", *numbers(0, 0, 0), "--uncertainty", "0"], 1, "must be a number above 0"),
        ([], 2, "Missing option '--axis'"),
        (
            ["--axis", "x", "--moved", "1", *numbers(0, 0, 0)],
            2,
            "a move checks counts_per_unit, the readings check a table",
        ),
        (["--axis", "x", "--moved", "nan"], 1, "--moved nan: it must be a finite number"),
    ],
)
def test_what_cannot_be_tested_is_said(config: Path, arguments: list[str], code: int, said: str) -> None:
    result = CliRunner().invoke(app, ["signtest", str(config), *arguments], env={"COLUMNS": "200"})
    assert result.exit_code == code
    assert said in result.stderr


@pytest.mark.parametrize(
    ("moved", "fault"),
    [
        ("0.97", ""),
        ("10", "it moved by 10 mm, not by 1 mm: counts_per_unit should be about 100, not 1000"),
        ("0.1", "it moved by 0.1 mm, not by 1 mm: counts_per_unit should be about 10000, not 1000"),
        ("-1", "it moved by -1 mm, not by 1 mm: change the sign of counts_per_unit: -1000"),
        (
            "0",
            (
                "it moved by 0 mm, not by 1 mm: check that the drive is enabled, and that counts_per_unit, "
                "1000, is large enough"
            ),
        ),
    ],
)
def test_a_move_of_a_millimetre_tells_a_wrong_scale_of_an_axis_without_a_table(
    config: Path, moved: str, fault: str
) -> None:
    result = typed(config, "--axis", "y", "--moved", moved, "--json")
    assert json.loads(result.stdout) == {
        "axis": "y",
        "units": "mm",
        "commanded": 1.0,
        "moved": float(moved),
        "fault": fault,
    }
    assert result.exit_code == (1 if fault else 0)
