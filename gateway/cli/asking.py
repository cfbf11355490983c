"""Questions on a terminal, for what the options of a command leave open."""

from collections.abc import Callable
from typing import TypeVar

import typer

Answer = TypeVar("Answer")


class Asking:
    """Takes what the options gave and asks for the rest.

    Where nobody can be asked it notes which options are missing, so that all are named at once.
    """

    def __init__(self, *, is_on: bool) -> None:
        self.is_on = is_on
        self._missing: list[str] = []

    def answer(self, given: Answer | None, option: str, question: str, kind: Callable[..., Answer]) -> Answer:
        """Return what was given, or ask for it; the empty value of its kind where nobody can be asked."""
        if given is not None:
            return given
        if self.is_on:
            answered: Answer = typer.prompt(question, type=kind, err=True)
            return answered
        self._missing.append(option)
        return kind()

    def text(self, given: str | None, option: str, question: str) -> str:
        """Return a text that was given, or ask for it."""
        return self.answer(given, option, question, str)

    def choice(self, given: str | None, option: str, allowed: tuple[str, ...]) -> str:
        """Return one of the allowed words.

        Raises:
            typer.BadParameter: another one was given.
        """
        found = self.text(given, option, f"{option.removeprefix('--')} ({', '.join(allowed)})")
        if found and found not in allowed:
            raise typer.BadParameter(f'found "{found}"; allowed: {", ".join(allowed)}', param_hint=option)
        return found

    def optional(self, given: str | None, question: str) -> str | None:
        """Return what was given, or ask for something that may stay empty."""
        if given is not None or not self.is_on:
            return given
        return str(typer.prompt(question, default="", show_default=False, err=True)) or None

    def is_yes(self, question: str) -> bool:
        """Ask a question that has no default. Where nobody can be asked the answer is no."""
        return self.is_on and typer.confirm(question, err=True)

    def range(self, given: tuple[float, float] | None, option: str, what: str) -> tuple[float, float]:
        """Return two numbers that were given, or ask for them one after the other."""
        if given is not None or not self.is_on:
            return self.answer(given, option, what, _no_range)
        low = self.answer(None, option, f"{what}, lowest", float)
        return low, self.answer(None, option, f"{what}, highest", float)

    def refuse_if_incomplete(self) -> None:
        """Say every option that is missing, at once.

        Raises:
            typer.BadParameter: there is one.
        """
        if self._missing:
            raise typer.BadParameter(f"missing: {', '.join(self._missing)} (or run it with --ask)")


def _no_range() -> tuple[float, float]:
    return 0.0, 0.0
