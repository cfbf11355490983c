"""Questions on a terminal about what the options of a command leave open."""

from collections.abc import Callable
from typing import TypeVar

import typer

Answer = TypeVar("Answer")


class Prompter:
    """Gets valid answers: from the options, then from the user, until each is accepted.

    Without a terminal a wrong option is wrong usage, and missing options are collected to be reported
    together.
    """

    def __init__(self, *, is_on: bool) -> None:
        self.is_on = is_on
        self._missing: list[str] = []

    def settle(
        self, given: Answer | None, option: str, ask: Callable[[], Answer], accept: Callable[[Answer], None]
    ) -> None:
        """Pass the answer to ``accept``; it and ``ask`` reject one with a ValueError that gives the reason.

        Raises:
            typer.BadParameter: the given answer is rejected, and there is no terminal for another.
        """
        if given is None and not self.is_on:
            self._missing.append(option)
            return None
        if given is not None:
            try:
                return accept(given)
            except ValueError as error:
                if not self.is_on:
                    raise typer.BadParameter(str(error), param_hint=option) from None
                typer.echo(f"{option}: {error}", err=True)
        while True:
            try:
                return accept(ask())
            except ValueError as error:
                typer.echo(f"  {error}", err=True)

    def optional(self, given: str | None, question: str) -> str | None:
        """Return the given answer, or ask for one that may be empty."""
        if given is not None or not self.is_on:
            return given
        return str(typer.prompt(question, default="", show_default=False, err=True)) or None

    def is_yes(self, question: str) -> bool:
        """Ask a question that has no default. Without a terminal the answer is no."""
        return self.is_on and typer.confirm(question, err=True)

    def refuse_if_incomplete(self) -> None:
        """Report all missing options together.

        Raises:
            typer.BadParameter: an option is missing.
        """
        if self._missing:
            raise typer.BadParameter(f"missing: {', '.join(self._missing)} (or run it with --ask)")


def text(question: str, default: str | None = None) -> str:
    """Ask for a text that is not empty; Enter takes the default, if any."""
    return str(typer.prompt(question, default=default, err=True)).strip()


def number(question: str) -> float:
    """Ask for a number.

    Raises:
        ValueError: the answer is not a number.
    """
    answer = text(question)
    try:
        return float(answer)
    except ValueError:
        raise ValueError(f'found "{answer}"; allowed: a number, as in 1000 or -0.5') from None


def whole_number(question: str, default: str | None = None) -> int:
    """Ask for a whole number; Enter takes the default, if any.

    Raises:
        ValueError: the answer is not a whole number.
    """
    answer = text(question, default)
    try:
        return int(answer)
    except ValueError:
        raise ValueError(f'found "{answer}"; allowed: a whole number, as in 1') from None


def two_numbers(question: str) -> tuple[float, float]:
    """Ask for the lowest and the highest; raises like :func:`number`."""
    return number(f"{question}, lowest"), number(f"{question}, highest")
