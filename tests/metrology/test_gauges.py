"""Lines of serial gauges: numbers, errors of the gauge, and everything that is neither."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.metrology.gauge_kinds import GaugeKind
from gateway.metrology.gauges import GaugeError, GaugeLines, pattern_of, reading_of

MITUTOYO, SYLVAC, MILLIMAR = GaugeKind.MITUTOYO, GaugeKind.SYLVAC, GaugeKind.MILLIMAR


@pytest.mark.parametrize(
    ("kind", "line", "value"),
    [
        (MITUTOYO, b"01A+0012.345", 12.345),
        (MITUTOYO, b"01A-00000.01", -0.01),
        (MITUTOYO, b"02A+0.47244", 0.47244),
        (MITUTOYO, b"01A+000012.", 12.0),
        (SYLVAC, b"+12.345", 12.345),
        (SYLVAC, b"-0.0205", -0.0205),
        (SYLVAC, b" 1.000", 1.0),
        (SYLVAC, b"+1.000=", 1.0),
        (MILLIMAR, b"1 -000.25 mm", -0.25),
        (MILLIMAR, b"1 +012.345 mm =", 12.345),
        (MILLIMAR, b"1 +012.345 mm > <", 12.345),
    ],
)
def test_a_reading_is_the_number_that_the_gauge_shows(kind: GaugeKind, line: bytes, value: float) -> None:
    assert reading_of(kind, line) == value


@pytest.mark.parametrize(
    ("kind", "line", "told"),
    [
        (MITUTOYO, b"911", "no reading from the gauge"),
        (MITUTOYO, b"91", "no reading from the gauge"),
        (MITUTOYO, b"+12.345", "as in 01A"),
        (MITUTOYO, b"01A+12,345", "as in 01A"),
        (MITUTOYO, b"01A12.345", "as in 01A"),
        (MITUTOYO, b"01A+12.34501A+12.345", "as in 01A"),
        (MILLIMAR, b"1 ERR6", "check that feature 1 is on"),
        (MILLIMAR, b"1 +000.25 um", "is in um, but the reading units are mm: give --reading-units um"),
        (MILLIMAR, b"2 +000.25 mm", "as in 1"),
        (MILLIMAR, b"1 000.25 mm", "as in 1"),
        (MILLIMAR, b"1 +000.25 mm;2 +000.25 mm", "as in 1"),
        (MILLIMAR, b"1 +000:25:10 dms", "as in 1"),
        (SYLVAC, b"ERR1", "look at its display"),
        (SYLVAC, b"01A+0012.345", r"as in \+12.345"),
        (SYLVAC, b"+12,345", r"as in \+12.345"),
        (SYLVAC, b"+12", r"as in \+12.345"),
        (SYLVAC, b"12.345", r"as in \+12.345"),  # -12.345 that lost its first byte
        (SYLVAC, b"+1e5", r"as in \+12.345"),
        (SYLVAC, b"+-1.0", r"as in \+12.345"),
        (SYLVAC, b"\xb1\xb2.\xb3", "check baud rate, parity"),
        (SYLVAC, b"", r"as in \+12.345"),
        (SYLVAC, b"nan", r"as in \+12.345"),
        (SYLVAC, b"+999999999999.000", r"as in \+12.345"),
    ],
)
def test_what_is_no_reading_is_refused_and_shown(kind: GaugeKind, line: bytes, told: str) -> None:
    with pytest.raises(GaugeError, match=told):
        reading_of(kind, line)


def test_a_unit_in_the_line_is_held_against_that_of_the_readings() -> None:
    assert reading_of(MILLIMAR, b"1 +012.5 um =", unit="um") == 12.5
    own = pattern_of(r"X=(?P<value>[+-]\d+\.\d+)(?P<unit>mm|in)")
    assert reading_of(GaugeKind.PATTERN, b"X=+1.5in", own, "inch") == 1.5
    with pytest.raises(GaugeError, match="is in in, but the reading units are mm: give --reading-units inch"):
        reading_of(GaugeKind.PATTERN, b"X=+1.5in", own, "mm")


DRO = pattern_of(r"[XY]\s*(?P<value>[+-]?\s*\d+[.,]\d+)\s*mm")


@pytest.mark.parametrize(
    ("line", "value"), [(b"X  +12.345 mm", 12.345), (b"X - 0.020 mm", -0.02), (b"Y 1,5mm", 1.5)]
)
def test_a_pattern_of_ones_own_says_where_the_number_is(line: bytes, value: float) -> None:
    assert reading_of(GaugeKind.PATTERN, line, DRO) == value


@pytest.mark.parametrize("line", [b"X +12.345", b"12.345 mm", b"X 12 mm", b"", b"X 1.0 mmX 2.0 mm"])
def test_a_line_that_does_not_match_as_a_whole_is_refused_and_shown(line: bytes) -> None:
    with pytest.raises(GaugeError, match="does not match --gauge-pattern"):
        reading_of(GaugeKind.PATTERN, line, DRO)


@pytest.mark.parametrize(
    ("pattern", "words"), [("X(", "not a regular expression"), (r"X(\d+)", "a group with the name value")]
)
def test_a_pattern_that_names_no_number_is_refused(pattern: str, words: str) -> None:
    with pytest.raises(GaugeError, match=words):
        pattern_of(pattern)


def test_a_value_that_is_no_number_is_refused() -> None:
    with pytest.raises(GaugeError, match="--gauge-pattern finds 'on', which is not a number: correct it"):
        reading_of(GaugeKind.PATTERN, b"on", pattern_of("(?P<value>.*)"))


@given(value=st.integers(-99_999_999, 99_999_999), kind=st.sampled_from([MITUTOYO, SYLVAC]))
def test_every_number_comes_back(value: int, kind: GaugeKind) -> None:
    text = f"{value / 1000:+.3f}"
    line = text if kind is SYLVAC else f"01A{text[0]}{text[1:].zfill(9)}"
    assert reading_of(kind, line.encode()) == value / 1000


@pytest.mark.parametrize(("kind", "line"), [(SYLVAC, b"+12.345"), (MITUTOYO, b"01A+0012.345")])
def test_a_line_with_one_byte_changed_is_refused_or_differs_in_just_that_digit(
    kind: GaugeKind, line: bytes
) -> None:
    for place, was in enumerate(line):
        # A digit for a digit, a sign for a sign; Sylvac marks a tolerance where the last digit stood.
        like = b"0123456789" if chr(was).isdigit() else b"+- " if was == ord("+") else bytes((was,))
        marks = b"<=>" if kind is SYLVAC and place == len(line) - 1 else b""
        for byte in range(256):
            mutant = line[:place] + bytes((byte,)) + line[place + 1 :]
            try:
                value = reading_of(kind, mutant)
            except GaugeError:
                continue
            assert byte in like + marks, mutant
            # Of Mitutoyo's channel any two digits are one.
            assert value == float(mutant[3 if kind is MITUTOYO else 0 :].rstrip(marks))


@given(
    lines=st.lists(st.sampled_from([b"+1.5", b"-0.020", b"ERR1"]), max_size=5),
    end=st.sampled_from([b"\r", b"\n", b"\r\n"]),
    cuts=st.lists(st.integers(0, 40), max_size=6),
)
def test_lines_are_the_same_however_the_bytes_come(lines: list[bytes], end: bytes, cuts: list[int]) -> None:
    data = b"".join(line + end for line in lines)
    gauge, found, at = GaugeLines(), [], 0
    for cut in [*sorted(cut for cut in cuts if cut <= len(data)), len(data)]:
        found += gauge.feed(data[at:cut])
        at = cut
    assert found == lines
    assert gauge.rest == b""


def test_what_never_ends_is_no_line() -> None:
    with pytest.raises(GaugeError, match="no end of the line"):
        GaugeLines().feed(b"x" * 65)
