"""How a command shows its result: in words for people, or as JSON for programs."""

import json
import sys
from collections.abc import Iterable, Iterator
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, Protocol, overload

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType

STOPPED_BY_SIGNAL: Final = 128
"""Added to the number of a signal, this is the exit code of a command that it stopped, as in a shell."""


class Format(Enum):
    """What is printed; of JSON the indentation, and whether it keeps to ASCII."""

    TEXT = "text"
    JSON = (None, True)
    """In one line."""
    LINE = (None, False)
    INDENTED = (2, False)
    INDENTED_ASCII = (2, True)


class StderrLine(str):
    """A line for standard error: what a person should know beside the result."""

    __slots__ = ()


def notes(said: Iterable[str]) -> Iterator[StderrLine]:
    """Yield what a person should know beside the result, each on a line."""
    yield from (StderrLine(f"note: {each}") for each in said)


class Data(Protocol):
    """What a command found: one struct, from which words and JSON come."""

    def as_data(self) -> Any:
        """Return it as plain data."""
        ...


class Result(Data, Protocol):
    """One that says itself in words too."""

    def lines(self) -> "Iterable[RenderableType]":
        """Yield it from top to bottom: a text is a line as it stands, anything else is drawn by rich."""
        ...


@overload
def show(result: Result, form: Format, *, plain_width: int | None = None) -> None: ...
@overload
def show(
    result: Data, form: Format, words: "Iterable[RenderableType]", *, plain_width: int | None = None
) -> None: ...
def show(
    result: Any,
    form: Format,
    words: "Iterable[RenderableType] | None" = None,
    *,
    plain_width: int | None = None,
) -> None:
    """Print a result on standard output: as JSON, or in its words, or in those given here.

    ``plain_width``: columns of what rich draws where standard output is no terminal.
    """
    if form is not Format.TEXT:
        print_json(result.as_data(), form)
    else:
        print_words(result.lines() if words is None else words, plain_width)


def print_words(words: "Iterable[RenderableType]", plain_width: int | None = None) -> None:
    """Print what a person reads; see :meth:`Result.lines`."""
    for part in words:
        if isinstance(part, str):
            typer.echo(part, err=isinstance(part, StderrLine))
        else:
            _draw(part, plain_width)


def _draw(part: "RenderableType", plain_width: int | None) -> None:
    from rich.console import Console

    Console(width=None if sys.stdout.isatty() else plain_width, highlight=False).print(part)


def print_json(data: Any, form: Format = Format.INDENTED) -> None:
    """Print plain data as JSON on standard output."""
    indent, is_ascii = form.value
    typer.echo(json.dumps(data, indent=indent, ensure_ascii=is_ascii))


def print_lines(lines: Iterable[str], *, err: bool = False) -> None:
    """Print lines as they are."""
    for line in lines:
        typer.echo(line, err=err)
