"""Lines as long as a file may be are gone through once: with every place tried against every other one, these
would take hours, in which the gateway that reloads a table could not answer."""

import pytest

from gateway.compensation.units import Units
from gateway.tabfile import ErrorSense, FileContext, TabFileError, parse_table

LONG = 1_000_000
FAGOR = f"P001 X-20 EX 0.1\nP002 X{'1' * LONG} Q\nP003 X1 EX 1\n"
COMMENTS = f"kw.ssfk.unit 1{' /**/' * LONG}\n"
COLUMNS = f"BEGIN X .COM MM\nNR AXISPOS {'X ' * LONG}\n[END]\n"
AXES = "".join(f"$AA_ENC_COMP[0,0,A{index}]=1\n" for index in range(100_000)) + "M17\n"


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (FAGOR, "P002 X111"),
        (COMMENTS, "no kw.ssfk.interval"),
        (COLUMNS, "column 'X'"),
        (AXES, "tables of A0"),
    ],
    ids=["digits", "comments", "columns", "axes"],
)
def test_a_very_long_line_is_an_error_like_a_short_one(text: str, found: str) -> None:
    context = FileContext(units=Units.MM, file_units=Units.MM, error_sense=ErrorSense.ACTUAL_MINUS_COMMAND)
    with pytest.raises(TabFileError, match=found) as caught:
        parse_table(text.encode(), "x", context)
    assert len(str(caught.value)) < 1000


@pytest.mark.parametrize("position", ["1e9", "-1e300", "1.7e308"])
def test_a_position_that_no_machine_has_is_refused(position: str) -> None:
    ends = sorted(("0", position), key=float)
    text = "position_mm,correction_mm\n" + "".join(f"{end},0\n" for end in ends)
    with pytest.raises(TabFileError, match="a position of "):
        parse_table(text.encode(), "x.csv", FileContext(units=Units.MM))
