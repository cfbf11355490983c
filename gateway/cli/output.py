"""Output of a command's result: in words for people, or as JSON for programs."""

import json
import sys
from collections.abc import Iterable, Iterator
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, Protocol, overload

import typer

if TYPE_CHECKING:
    from rich.console import RenderableType

STOPPED_BY_SIGNAL: Final = 128
"""Exit code of a command stopped by a signal, less the number of the signal, as in a shell."""


class Format(Enum):
    """Output format; for JSON the indentation, and whether it is ASCII only."""

    TEXT = "text"
    JSON = (None, True)
    """On one line."""
    LINE = (None, False)
    INDENTED = (2, False)
    INDENTED_ASCII = (2, True)


class StderrLine(str):
    """A line for standard error: information for the user beside the result."""

    __slots__ = ()


def notes(said: Iterable[str]) -> Iterator[StderrLine]:
    """Yield information for the user beside the result, a line each."""
    yield from (StderrLine(f"note: {each}") for each in said)


class Data(Protocol):
    """The result of a command: one struct for both words and JSON."""

    def as_data(self) -> Any:
        """Return it as plain data."""
        ...


class Result(Data, Protocol):
    """A result that also has words."""

    def lines(self) -> "Iterable[RenderableType]":
        """Yield it from top to bottom: a string is printed unchanged, anything else is drawn by rich."""
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
    """Print a result on standard output: as JSON, or in words, its own or the given ones.

    ``plain_width``: columns of rich's output if standard output is not a terminal.
    """
    if form is not Format.TEXT:
        print_json(result.as_data(), form)
    else:
        print_words(result.lines() if words is None else words, plain_width)


def print_words(words: "Iterable[RenderableType]", plain_width: int | None = None) -> None:
    """Print words for a person; see :meth:`Result.lines`."""
    for part in words:
        if isinstance(part, str):
            typer.echo(part, err=isinstance(part, StderrLine))
        else:
            _draw(part, plain_width)


def _draw(part: "RenderableType", plain_width: int | None) -> None:
    from rich.console import Console
    from rich.text import Text

    is_whole = isinstance(part, Text) and bool(part.no_wrap)  # Rich alone would wrap it, or cut it off
    console = Console(width=None if sys.stdout.isatty() else plain_width, highlight=False)
    console.print(part, soft_wrap=is_whole)


def print_json(data: Any, form: Format = Format.INDENTED) -> None:
    """Print plain data as JSON on standard output."""
    indent, is_ascii = form.value
    typer.echo(json.dumps(data, indent=indent, ensure_ascii=is_ascii))


def print_lines(lines: Iterable[str], *, err: bool = False) -> None:
    """Print lines unchanged."""
    for line in lines:
        typer.echo(line, err=err)
