"""How a command shows its result: in words for people, or as JSON for programs."""

import json
from collections.abc import Iterable
from enum import Enum
from typing import Any, Final, Protocol

import typer

STOPPED_BY_SIGNAL: Final = 128
"""Added to the number of a signal, this is the exit code of a command that it stopped, as in a shell."""


class Format(Enum):
    """What is printed; of JSON the indentation, and whether it keeps to ASCII."""

    TEXT = "text"
    JSON = (None, True)
    """In one line."""
    INDENTED = (2, False)
    INDENTED_ASCII = (2, True)


class Result(Protocol):
    """What a command found: one struct, from which words and JSON come."""

    def as_data(self) -> Any:
        """Return it as plain data."""
        ...

    def lines(self) -> Iterable[str]:
        """Yield it in words, line by line."""
        ...


def show(result: Result, form: Format) -> None:
    """Print a result on standard output."""
    if form is Format.TEXT:
        print_lines(result.lines())
    else:
        print_json(result.as_data(), form)


def print_json(data: Any, form: Format = Format.INDENTED) -> None:
    """Print plain data as JSON on standard output."""
    indent, is_ascii = form.value
    typer.echo(json.dumps(data, indent=indent, ensure_ascii=is_ascii))


def print_lines(lines: Iterable[str], *, err: bool = False) -> None:
    """Print lines as they are."""
    for line in lines:
        typer.echo(line, err=err)
