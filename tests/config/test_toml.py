"""What is no TOML is refused with its line and column, and keys are found on their lines."""

from pathlib import Path

import pytest

from gateway.config.load import load
from gateway.config.problems import ConfigErrors, Problem
from gateway.config.toml import KeyLines, KeyPath
from tests.config.config_bench import GOOD, loaded, written


def problem_of(path: Path, content: bytes) -> Problem:
    path.write_bytes(content)
    with pytest.raises(ConfigErrors) as caught:
        load(path)
    [problem] = caught.value.problems
    return problem


@pytest.mark.parametrize(
    ("content", "line", "column", "said"),
    [
        (b'[gateway]\nname = "a\n', 2, 10, "illegal character"),
        (b"[gateway]\nname = \n", 2, 8, "invalid value"),
        (b"[gateway]\n\nname\n", 3, 5, "expected '='"),
        (b"[gateway\n", 1, 9, "expected ']'"),
        (b"a = 1\na = 2\n", 2, 6, "cannot overwrite a value"),
    ],
)
def test_a_slip_of_syntax_is_named_with_line_and_column(
    tmp_path: Path, content: bytes, line: int, column: int, said: str
) -> None:
    problem = problem_of(tmp_path / "gateway.toml", content)
    assert (problem.line, problem.column) == (line, column)
    assert said in problem.found.lower()
    assert str(problem).startswith(f"{tmp_path / 'gateway.toml'}:{line}:{column}: not TOML")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("name = mill-1", 'text needs quotes: name = "mill-1"'),
        ("tables = ../tables", 'text needs quotes: tables = "../tables"'),
        ("tcp = 192.168.0.7:502", 'text needs quotes: tcp = "192.168.0.7:502"'),
        ("drives = { rtu = /dev/ttyUSB0, baudrate = 115200 }", 'text needs quotes: rtu = "/dev/ttyUSB0"'),
        ("compensation = on", 'text needs quotes: compensation = "on"'),
        ("parity = even;", 'text needs quotes: parity = "even"'),
        ("counts_per_unit = 1000,5", "decimal point, not comma: counts_per_unit = 1000.5"),
        ("counts_per_unit = -0,5  # half", "decimal point, not comma: counts_per_unit = -0.5"),
        ("max_speed = 1.000.000", "a number has nothing between its digits: max_speed = 1000000"),
        ("max_speed = 10 000,5", "a number has nothing between its digits: max_speed = 10000.5"),
        ("gain = .5", "write a digit on both sides of the decimal point: gain = 0.5"),
        ("gain = 1.", "write a digit on both sides of the decimal point: gain = 1.0"),
        ("unit_id = 01", 'a number does not begin with 0, and text needs quotes: unit_id = "01"'),
        ("gap_ms = 10ms", "write a number without its unit, and text in quotes: gap_ms = 10"),
        ("gap_ms = 2.5 ms", "write a number without its unit, and text in quotes: gap_ms = 2.5"),
        ("echo = True", "true and false are written small, without quotes: echo = true"),
        ("echo = no", "true and false are written small, without quotes: echo = false"),
        ("name =", "a value is missing behind name ="),
        ('name = "mill', 'a text ends with the quote that it begins with, on the same line: name = "mill"'),
        ("name = “mill”", "quotes are straight in TOML: \"text\" or 'text'"),
        ('tables = "C:\\mill"', "put a text with backslashes into single quotes, as in 'C:\\tables'"),
        ("name: mill", "write = between a key and its value: name = mill"),
        ("[axis.x", "the name of a table ends with ]: [axis.x]"),
        ("[[line.x.controllers", "the name of a table ends with ]: [[line.x.controllers]]"),
        ("// my mill", "a comment begins with #"),
        ("; my mill", "a comment begins with #"),
        ("travel = [-300.0 0.0]", "separate the items in [ ] by commas, and end the list with ]"),
        (
            'drives = { tcp = "a:502" baudrate = 1 }',
            "separate the items in { } by commas, and write } on the same line",
        ),
    ],
)
def test_what_to_do_about_a_slip_is_said_without_words_of_toml(tmp_path: Path, line: str, said: str) -> None:
    problem = problem_of(tmp_path / "gateway.toml", f"[gateway]\n{line}\n".encode())
    assert problem.line == 2
    assert problem.remedy == said


@pytest.mark.parametrize(
    ("content", "key", "first", "second"),
    [
        (b'[axis.x]\nunits = "mm"\n\nunits = "inch"\n', "axis.x.units", 2, 4),
        (b"[axis.x]\na = 1\n[axis.y]\na = 1\n[axis.x]\nb = 1\n", "axis.x", 1, 5),
        (b"[[l.c]]\na = 1\n[[l.c]]\na = 1\na = 2\n", "l.c[2].a", 4, 5),
        (b"bits.homed = { bit = 1,\tbit = 2 }\n", "bits.homed.bit", 1, 1),
        (b"a = [\n 1,\n]\nb = 1\na = [\n 2,\n]\n", "a", 1, 5),
    ],
)
def test_a_key_that_is_given_twice_is_named_with_both_lines(
    tmp_path: Path, content: bytes, key: str, first: int, second: int
) -> None:
    problem = problem_of(tmp_path / "gateway.toml", content)
    assert problem.found.endswith(f": {key} is given on line {first} and again on line {second}")
    assert problem.remedy == "give every key and every table once"


def test_a_text_that_ends_too_early_is_named_with_its_last_line(tmp_path: Path) -> None:
    assert problem_of(tmp_path / "gateway.toml", b'[gateway]\nname = """\nabc').line == 3


def test_a_table_in_place_of_a_configuration_is_told_that_first(tmp_path: Path) -> None:
    problem = problem_of(tmp_path / "cnc10x.tab", b"CNC10 TAB FILE VERSION 3\nAXIS X\n")
    assert problem.remedy.startswith("give the path of a configuration file; or, if this is one: write =")


def test_what_is_not_utf8_is_named_with_its_line(tmp_path: Path) -> None:
    problem = problem_of(tmp_path / "gateway.toml", b'[gateway]\nname = "M\xfcller"\n')
    assert (problem.line, problem.found) == (2, "byte 0xfc is not UTF-8")
    assert "UTF-8" in problem.remedy


def test_a_number_without_end_is_refused(tmp_path: Path) -> None:
    assert "not TOML" in problem_of(tmp_path / "gateway.toml", b"a = " + b"1" * 5000).found


def test_nesting_beyond_reason_is_refused(tmp_path: Path) -> None:
    assert "nested" in problem_of(tmp_path / "gateway.toml", b"a = " + b"[" * 20_000).found
    dotted = b"[axis.x]\n" + b".".join([b"a"] * 30_000) + b" = 1\n"
    found = problem_of(tmp_path / "gateway.toml", dotted)
    assert ("nested" in found.found, found.line) == (True, 2)


def test_a_file_too_large_to_be_a_configuration_is_refused(tmp_path: Path) -> None:
    assert "more than 4000000 bytes" in problem_of(tmp_path / "gateway.toml", b"#" * 4_000_001).found


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("none.toml", "no such file"),
        (".", "a folder"),
        ("none\0.toml", "cannot be read"),
        ("a" * 300, "cannot be read"),
    ],
)
def test_a_file_that_is_none_is_named(tmp_path: Path, path: str, said: str) -> None:
    with pytest.raises(ConfigErrors, match=said):
        load(tmp_path / path)


def test_a_byte_order_mark_and_crlf_are_no_fault(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert load(path).plan == loaded(tmp_path).plan


# Keys are found on the lines on which they stand.


TEXT = '''\
# a comment with [brackets] and key = 1
top = "a # b"
[line.xyz]
drives = { tcp = "h:1", more = { deep = [1, { x = 2 }] } }   # { not = "this" }
[[line.xyz.controllers]]
name = "one"
[[line.xyz.controllers]]
name = 'two ]'
nets = [
  "a",   # , "b"
  "]",
]
[line.xyz.controllers.extra]
here = true
[axis."x y"]
text = """
units = "no key"
[neither]
"""
units = \'\'\'it's
two lines\'\'\'
bits.homed.bit = 3
"quo\\u0074ed" . inner = 1979-05-27 07:32:00
last = -1.5e3'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("top",), 2),
        (("line",), 3),
        (("line", "xyz"), 3),
        (("line", "xyz", "drives", "tcp"), 4),
        (("line", "xyz", "drives", "more", "deep", 1, "x"), 4),
        (("line", "xyz", "controllers"), 5),
        (("line", "xyz", "controllers", 0, "name"), 6),
        (("line", "xyz", "controllers", 1), 7),
        (("line", "xyz", "controllers", 1, "name"), 8),
        (("line", "xyz", "controllers", 1, "nets", 1), 11),
        (("line", "xyz", "controllers", 1, "extra", "here"), 14),
        (("axis", "x y"), 15),
        (("axis", "x y", "text"), 16),
        (("axis", "x y", "units"), 20),
        (("axis", "x y", "bits", "homed", "bit"), 22),
        (("axis", "x y", "bits", "homed"), 22),
        (("axis", "x y", "quoted", "inner"), 23),
        (("axis", "x y", "last"), 24),
    ],
)
def test_a_key_is_on_its_line(path: KeyPath, line: int) -> None:
    assert KeyLines(TEXT).of(path) == line


def test_a_key_that_is_missing_is_looked_for_at_its_table() -> None:
    assert KeyLines(TEXT).of(("axis", "x y", "counts_per_unit")) == 15
    assert KeyLines(TEXT).of(("line", "xyz", "controllers", 1, "role")) == 7
    assert KeyLines(TEXT).of(("mqtt", "host")) is None


@pytest.mark.parametrize("text", ["", "\n\n", "[", "a", "a = ", "a = [", '"', "[a", "= 1", "a = {", "]"])
def test_what_is_no_toml_does_no_harm(text: str) -> None:
    assert KeyLines(text).of(("b",)) is None
