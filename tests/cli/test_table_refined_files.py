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
    assert "to be told when it is read:" in result.stdout
    assert to_tell in result.stdout
