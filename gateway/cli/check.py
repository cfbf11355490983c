"""``pitch-gateway check CONFIG``."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import compile_or_exit
from gateway.cli.output import Format, StderrLine, show
from gateway.plain import JsonObject

if TYPE_CHECKING:
    from gateway.config.load import Loaded
    from gateway.config.problems import Problem


def check(
    config: Config,
    *,
    as_json: AsJson = False,
    compiles: Annotated[
        bool, typer.Option("--compile", help="Write what `relay` starts from into the state folder.")
    ] = False,
) -> None:
    """Check a configuration and its tables; report all problems together.

    Each problem is one line on stderr: file and line, key, found value, allowed values or remedy. With
    --compile, a good configuration and its tables are written into the state folder for relay. A running
    gateway does not change.

    Exit code 0 if the gateway can run the configuration, 1 if not.

    Examples:
        pitch-gateway check gateway.toml

        pitch-gateway check --compile gateway.toml

        pitch-gateway check gateway.toml --json | jq .problems
    """
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors
    from gateway.ipc.log import take_standard_error

    take_standard_error()  # the relay's unit runs this check first
    form = Format.INDENTED if as_json else Format.TEXT
    try:
        loaded = load(config)
    except ConfigErrors as errors:
        show(_Checked(config, errors.problems, errors.warnings), form)
        raise typer.Exit(1) from None
    if compiles:
        compile_or_exit(loaded)
    show(_Checked(loaded.path, (), loaded.warnings, loaded), form)


@dataclass(frozen=True, slots=True)
class _Checked:
    """The problems of a configuration, and the plan of a good one."""

    path: Path
    problems: "Sequence[Problem]"
    warnings: "Sequence[Problem]"
    loaded: "Loaded | None" = None
    """None: it cannot be run."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        from msgspec import to_builtins

        from gateway.config.summary import summary

        found: dict[str, Any] = {
            "ok": not self.problems,
            "problems": [problem.as_dict() for problem in self.problems],
            "warnings": [warning.as_dict() for warning in self.warnings],
        }
        if self.loaded is not None:
            found["summary"] = to_builtins(summary(self.loaded.plan, self.loaded.drives))
        return found

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        from gateway.config.summary import summary_lines

        yield from (StderrLine(problem) for problem in self.problems)
        if self.loaded is not None:
            yield from summary_lines(self.loaded.plan, self.loaded.drives)
        yield from (StderrLine(f"warning: {warning}") for warning in self.warnings)
        if self.loaded is not None:
            yield f"{self.path}: good"
