"""Files of systems that are known by sight: each is named, with what to do."""

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import FileContext, TabFileError, parse_table


@pytest.mark.parametrize(
    ("text", "line", "found", "allowed"),
    [
        ("#1\nDEFINE BLCOMP 4,4000\n16 16 16 16\n", 2, "PMAC backlash", "negative direction only"),
        ("#1 def tcomp 4,4000\n16 16 16 16\n", 1, "PMAC torque", "not positions"),
        ("#\r\nND-280      MM    \r\nAXIS X1  = 0\r\n", 2, "Heidenhain display unit", "power of two"),
        ("*\nCOMP. NO. 001 = +0.0000\n", 2, "Heidenhain display unit", "position_mm,error_um"),
        ("%\nN3620P40\nN3621P33\n", 2, "Fanuc", "fanuc-csv"),
        ("%\nN10033Q1P-2\n", 2, "Fanuc", "3620 to 3624"),
        ("# encoder\nPREC=5\n-10 -10.1\n0 0.1\n", 2, "ecmc", "correction_mm"),
        ("STARTW\n0.0=0.0\n10.0=10.002\nEND\n", 1, "COMP.ERR", "right number minus the left"),
        ("[ScrewMap0]\nPoints=3\n", 1, "Mach3 or Mach4", "one test move"),
    ],
)
def test_a_file_of_a_system_that_is_not_read_is_named_with_what_to_do(
    text: str, line: int, found: str, allowed: str
) -> None:
    for told in (None, "csv"):
        with pytest.raises(TabFileError) as caught:
            parse_table(text.encode(), "x.tab", FileContext(format=told))
        assert found in caught.value.found
        assert caught.value.found.endswith("which is not read")
        assert allowed in caught.value.allowed
        assert caught.value.line == line


def test_a_siemens_table_without_its_equals_signs_is_told_what_is_missing() -> None:
    text = "%_N_AX_EEC_INI\n$AA_ENC_COMP[0,0,X1] 0.003\n$AA_ENC_COMP[0,1,X1] 0.01\nM17\n"
    with pytest.raises(TabFileError) as caught:
        parse_table(text.encode(), "x.ini", FileContext(file_units=Units.MM))
    assert "$AA_ENC_COMP[e,N,axis]=value" in caught.value.allowed
    assert caught.value.line == 2
