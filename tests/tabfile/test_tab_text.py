"""Bytes to lines: what old editors leave behind is tolerated, what is no text is refused."""

from contextlib import suppress
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.compensation.units import Units
from gateway.tabfile import DIALECTS, ContextError, FileContext, TabFileError, parse_table
from tests.tabfile.texts import Texts

GOOD = b"CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS MILLIMETER\nINTERVAL 10\nENTRIES 2\n0 0 0\n10 0.001 0\n"
EVERYTHING = FileContext(
    units=Units.INCH, travel=(-5.0, 5.0), file_counts_per_unit=1000.0, file_start=0.0, counts_per_unit=1000.0
)
FILE = Texts("cnc10x.tab")
parse, refused = FILE.parse, FILE.refused


@pytest.mark.parametrize(
    "data",
    [
        GOOD,
        GOOD.replace(b"\n", b"\r\n"),
        GOOD.replace(b"\n", b"\r"),
        b"\xef\xbb\xbf" + GOOD,
        GOOD + b"\x1a",
        GOOD + b"\x1a\x00\x00\r\n\x1a",
        b"\n \n" + GOOD + b"\n\t\n",
        GOOD.rstrip(),
        GOOD.replace(b"AXIS X", b"\tAXIS X  "),
    ],
)
def test_traces_of_old_editors_are_tolerated(data: bytes) -> None:
    assert list(parse(data).table.forward) == [0.0, 0.001]


@pytest.mark.parametrize("word", ["für", "mesuré"])
@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_comments_in_either_encoding_are_tolerated(word: str, encoding: str) -> None:
    text = f"2 2 0.5 20 1 0 ; {word} Z\n1\n1\n1\n; backward data\n0\n0\n0\n"
    assert parse(text.encode(encoding), file_start=0.0).format == "centroid-2"


def test_line_separators_inside_a_comment_do_not_end_the_line() -> None:
    text = "2 2 0.5 20 1 0 ; one\u2028two\x85three\n1\n1\n1\n; backward data\n0\n0\n0\n"
    assert parse(text.encode(), file_start=0.0).format == "centroid-2"


def test_lines_are_counted_from_the_top_of_the_file() -> None:
    refused(b"\r\n\r\n" + GOOD.replace(b"0.001", b"x"), line=9)


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"", "an empty file"),
        (b" \r\n\t\n", "no text"),
        (b"\xef\xbb\xbf", "no text"),
        (b"\x1a", "no text"),
        (b"\x7fELF\x02\x01\x01\x00", "binary"),
        (bytes(range(256)), "binary"),
        (GOOD + b"\x1a20 0.002 0", "text after an end-of-file mark"),
        (b"# a note\n0 0\n", "the first line of 8 characters is unknown, and belongs to no table"),
        (b"3 9 0.5 20 1 0\n", "the first line '3 9 0.5 20 1 0' is unknown;"),
        (b"24\n", "the first line '24' is unknown;"),
        (b"CNC11 TABLE\n", "the first line 'CNC11 TABLE' is unknown;"),
        (b"0123456789abcdefghijklmnopqrstuv\n", "the first line of 32 characters is unknown, and belongs"),
        (b"24 1.5\n", "the first line '24 1.5' is unknown;"),
        (b"CNC10 TAB FILE VERSION 2\n", "version 2"),
    ],
)
def test_what_is_no_table_is_refused_by_name(data: bytes, found: str) -> None:
    assert found in str(refused(data, r"cnc10x\.tab", file_start=0.0))


def test_a_secret_in_the_place_of_a_table_is_not_shown() -> None:
    """Who may save tables may make a link of one; the status and the log show why it was refused."""
    for secret in (b"s3cret-Token_0123456789", b"root:$y$j9T$abc:19000:0:::", b"correct horse battery"):
        assert secret.decode() not in str(refused(secret + b"\n"))


@pytest.mark.parametrize("name", [dialect.name for dialect in DIALECTS])
@pytest.mark.parametrize("text", ["hunter2,x;y", "hunter2\n", ":hunter2", "hunter2 0 0 0"])
def test_a_text_that_is_none_of_a_told_format_is_not_quoted(name: str, text: str) -> None:
    error = refused(text.encode(), line=1, format=name, file_start=0.0, file_units=Units.MM)
    assert f"no sign of format {name!r}" in error.found
    assert "hunter2" not in str(error)


def test_long_lines_are_shortened_in_messages() -> None:
    assert len(str(refused(b"x" * 10_000))) < 300


@given(st.binary(max_size=400))
@example(b"\xa0")
def test_arbitrary_bytes_raise_nothing_but_table_errors(data: bytes) -> None:
    with suppress(TabFileError):
        parse_table(data, "x.tab", EVERYTHING)


_WORDS = (
    "2 3 0 -1 0.5 20 21 1 ; AXIS X UNITS INCH INTERVAL ENTRIES 1e300 1e-300 -1e308 999999999999999 1_0 nan ٣"
)
_TOKENS = st.sampled_from([*_WORDS.split(), "CNC10 TAB FILE VERSION 3", "\t", "\n", "\r\n", "\x1a"])


@given(st.lists(_TOKENS, max_size=60).map(" ".join))
def test_words_of_the_grammars_in_any_order_raise_nothing_but_table_errors(text: str) -> None:
    with suppress(TabFileError):
        parse_table(text.encode(), "x.tab", EVERYTHING)


@given(
    st.sampled_from(["2 2 {} 20 1 0\n{}\n{}\n{}\n;\n{}\n{}\n{}", "2 {}\n{}\n{}"]),
    st.lists(st.one_of(st.floats(), st.integers()).map(repr), min_size=7, max_size=7),
)
def test_any_numbers_in_a_sound_frame_raise_nothing_but_table_errors(frame: str, numbers: list[str]) -> None:
    with suppress(TabFileError):
        parse_table(frame.format(*numbers).encode(), "x.tab", EVERYTHING)


@pytest.mark.parametrize(
    "facts",
    [
        {"travel": (0.0, 0.0)},
        {"travel": (1.0, -1.0)},
        {"travel": (0.0, float("inf"))},
        {"file_counts_per_unit": 0.0},
        {"file_counts_per_unit": float("nan")},
        {"counts_per_unit": 0.0},
        {"file_start": float("inf")},
        {"max_slope": -0.1},
    ],
)
def test_facts_that_cannot_be_true_are_refused(facts: dict[str, Any]) -> None:
    with pytest.raises(ContextError):
        FileContext(**facts)


def table_of(points: int) -> bytes:
    rows = "".join(
        f"{index / 100:.8f} {index % 7 / 1e6:+.8f} {index % 5 / 1e6:+.8f}\n" for index in range(points)
    )
    head = f"CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS MILLIMETER\nINTERVAL 0.01\nENTRIES {points}\n"
    return (head + rows).encode()


def test_a_hundred_thousand_points_are_a_table() -> None:
    table = parse(table_of(100_000)).table
    assert len(table.positions) == 100_000
    assert (table.first, table.last) == (0.0, 999.99)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        # 16 MiB are 16 x 1024 x 1024 bytes.
        (b"1" * (16_777_216 + 1), "16777217 bytes; allowed: at most 16777216 bytes"),
        (b"\n" * 500_001, "500001 lines; allowed: at most 500000 lines"),
        (b"\r\n" * 500_001, "500001 lines; allowed: at most 500000 lines"),
    ],
    ids=["bytes", "LF", "CRLF"],
)
def test_what_is_too_large_to_be_a_table_is_refused_with_the_limit(data: bytes, said: str) -> None:
    assert str(refused(data)) == f"cnc10x.tab: {said}"


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_read_with_and_without_its_mark(encoding: str) -> None:
    assert parse(GOOD.decode().encode(encoding)).table == parse(GOOD).table
