"""What a command found is shown once: in words, a remark among them on standard error, or as JSON."""

import json
from collections.abc import Iterator

import pytest
from rich.console import RenderableType
from rich.text import Text

from gateway.cli.output import Format, StderrLine, show


class Found:
    """A result with a remark, and with something that rich draws."""

    def as_data(self) -> dict[str, object]:
        return {"axis": "x", "name": "Fräse"}

    def lines(self) -> Iterator[RenderableType]:
        yield "axis x"
        yield StderrLine("note: odd")
        yield Text("a b " * 3)


def test_words_go_to_standard_output_and_remarks_to_standard_error(
    capsys: pytest.CaptureFixture[str],
) -> None:
    show(Found(), Format.TEXT, plain_width=8)
    said = capsys.readouterr()
    assert said.err == "note: odd\n"
    # 8 columns hold two pairs of four characters each
    assert [line.rstrip() for line in said.out.splitlines()] == ["axis x", "a b a b", "a b"]


def test_words_that_are_given_are_shown_in_place_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    show(Found(), Format.TEXT, ("other",))
    assert capsys.readouterr().out == "other\n"


@pytest.mark.parametrize(
    ("form", "lines", "is_ascii"),
    [
        (Format.JSON, 1, True),
        (Format.LINE, 1, False),
        (Format.INDENTED, 4, False),
        (Format.INDENTED_ASCII, 4, True),
    ],
)
def test_json_is_the_same_data_in_each_form(
    form: Format, lines: int, is_ascii: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    show(Found(), form)
    said = capsys.readouterr()
    assert (json.loads(said.out), said.err) == (Found().as_data(), "")
    assert (said.out.count("\n"), said.out.isascii()) == (lines, is_ascii)
