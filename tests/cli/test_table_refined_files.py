"""A refined table in the format it had: whoever read the old file reads the new one in the same way."""

from pathlib import Path
from typing import Final

import pytest
from typer.testing import CliRunner

from gateway.cli.table import app

READ_UNDER_IT: Final = """target_mm,direction,run,measured_mm
0,forward,1,0
10,forward,1,10.001
20,forward,1,20.002
20,backward,1,20.002
10,backward,1,10.001
0,backward,1,0
"""
ISG_LIST: Final = """kw.ssfk.unit 1
kw.ssfk.interval 100000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 3
kw.ssfk.bilateral 0
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 100
kw.ssfk.table[2].pos 200
"""
SIEMENS: Final = """%_N_AX_EEC_INI
CHANDATA(1)
$AA_ENC_COMP[1,0,AX1]=0
$AA_ENC_COMP[1,1,AX1]=-0.010
$AA_ENC_COMP[1,2,AX1]=-0.020
$AA_ENC_COMP_STEP[1,AX1]=10
$AA_ENC_COMP_MIN[1,AX1]=0
$AA_ENC_COMP_MAX[1,AX1]=20
$AA_ENC_COMP_IS_MODULO[1,AX1]=0
M17
"""


@pytest.mark.parametrize(
    ("text", "told", "expected", "to_tell"),
    [
        # read as 10 and 20 µm to add; 1 and 2 µm too far under it leave 9 and 18, in the sense of the file
        (
            ISG_LIST,
            ("--isg-sense", "command_minus_actual"),
            "kw.ssfk.table[2].pos 180",
            "command_minus_actual",
        ),
        (
            ISG_LIST,
            ("--error-sense", "command_minus_actual"),
            "kw.ssfk.table[2].pos 180",
            "command_minus_actual",
        ),
        # read as -10 and -20 µm to add: 11 and 22 are too far
        (ISG_LIST, (), "kw.ssfk.table[2].pos 220", "actual_minus_command"),
        (SIEMENS, (), "$AA_ENC_COMP[1,2,AX1]=-0.01800000", "--file-axis AX1"),
    ],
)
def test_a_refined_file_is_read_as_the_one_before(
    tmp_path: Path, text: str, told: tuple[str, ...], expected: str, to_tell: str
) -> None:
    (tmp_path / "old").write_text(text)
    (tmp_path / "readings.csv").write_text(READ_UNDER_IT)
    old, readings, new = (str(tmp_path / name) for name in ("old", "readings.csv", "new"))
    result = CliRunner().invoke(app, ["refine", old, readings, new, "--units", "mm", *told])
    assert result.exit_code == 0, result.stderr
    lines = [" ".join(line.split()) for line in (tmp_path / "new").read_text().splitlines()]
    assert expected in lines
    assert "to read it, give:" in result.stdout
    assert to_tell in result.stdout


TURN: Final = """kw.ssfk.unit 1
kw.ssfk.interval 900000
kw.ssfk.kw_startpos 0
kw.ssfk.kw_nr_max 5
kw.ssfk.bilateral 0
kw.ssfk.modulo 1
kw.ssfk.table[0].pos 0
kw.ssfk.table[1].pos 20
kw.ssfk.table[2].pos 40
kw.ssfk.table[3].pos 20
kw.ssfk.table[4].pos 0
"""
AGAIN: Final = "not in the file: the table repeats every 360 degree"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("isg",), "kw.ssfk.modulo 1"),
        (("siemens-eec", "--to-axis", "c"), "$AA_ENC_COMP_IS_MODULO[0,C1]=1"),
        (("siemens-eec", "--to-axis", "c", "--resample", "45"), "$AA_ENC_COMP_IS_MODULO[0,C1]=1"),
        (("fagor-8055", "--to-axis", "c", "--to-sense", "actual_minus_command"), None),
        # 0.0001 degree to the pulse
        (("fanuc-csv", "--to-counts-per-unit", "10000"), None),
        (("mitsubishi-csv", "--to-counts-per-unit", "10000"), None),
    ],
)
def test_a_turn_stays_a_turn_where_the_format_knows_turns(
    tmp_path: Path, options: tuple[str, ...], expected: str | None
) -> None:
    (tmp_path / "old.lis").write_text(TURN)
    old, new = str(tmp_path / "old.lis"), str(tmp_path / "new")
    result = CliRunner().invoke(app, ["convert", old, new, "--units", "degree", "--to", *options])
    assert result.exit_code == 0, result.stderr
    assert "repeats every" not in result.stdout
    told = {"fagor-8055": ["--error-sense", "actual_minus_command"], "isg": [], "siemens-eec": []}
    facts = told.get(options[0], ["--file-counts-per-unit", "10000"])
    shown = CliRunner().invoke(app, ["show", new, "--units", "degree", *facts])
    assert "modulo = 360" in shown.stdout
    assert expected is None or expected in [
        " ".join(line.split()) for line in Path(new).read_text().split("\n")
    ]


@pytest.mark.parametrize(
    "options",
    [
        ("csv",),
        ("linuxcnc-1",),
        # 0, 70 ... 420 is no turn any more
        ("siemens-eec", "--to-axis", "c", "--resample", "70"),
    ],
)
def test_a_turn_that_is_lost_is_said(tmp_path: Path, options: tuple[str, ...]) -> None:
    (tmp_path / "old.lis").write_text(TURN)
    old, new = str(tmp_path / "old.lis"), str(tmp_path / "new")
    result = CliRunner().invoke(app, ["convert", old, new, "--units", "degree", "--to", *options])
    assert result.exit_code == 0, result.stderr
    assert AGAIN in result.stdout


def test_a_refined_turn_stays_one_and_one_that_no_longer_closes_is_said(tmp_path: Path) -> None:
    (tmp_path / "old.lis").write_text(TURN)
    old, new = str(tmp_path / "old.lis"), str(tmp_path / "new")
    for last, is_turn in (("360", True), ("360.001", False)):
        rows = [
            f"{target},{way},1,{target}" for way in ("forward", "backward") for target in (0, 90, 180, 270)
        ]
        rows += [f"360,{way},1,{last}" for way in ("forward", "backward")]
        readings = tmp_path / "readings.csv"
        readings.write_text("\n".join(["target_degree,direction,run,measured_degree", *rows]))
        result = CliRunner().invoke(app, ["refine", old, str(readings), new, "--units", "degree", "--force"])
        assert result.exit_code == 0, result.stderr
        assert ("kw.ssfk.modulo" in Path(new).read_text()) is is_turn
        assert (AGAIN in result.stdout) is not is_turn
