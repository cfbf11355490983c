"""Keys are found on the lines on which they stand."""

import pytest

from gateway.config.toml import KeyLines, KeyPath

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
