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
    from rich.console import RenderableType

    from gateway.config.findings import Place
    from gateway.config.load import Loaded
    from gateway.config.problems import Problem
    from gateway.config.resolved import Setting


def check(
    config: Config,
    *,
    as_json: AsJson = False,
    compiles: Annotated[
        bool, typer.Option("--compile", help="Write what `relay` starts from into the state folder.")
    ] = False,
    resolved: Annotated[
        bool,
        typer.Option("--resolved", help="Show each key that is set, with the file and line it comes from."),
    ] = False,
) -> None:
    """Check a configuration and its tables; report all problems together.

    Each problem is one line on stderr: file and line, key, found value, allowed values or remedy. With
    --compile, a good configuration and its tables are written into the state folder for relay. A running
    gateway does not change.

    --resolved shows the keys of all files of include, and below each the values that it replaces. Keys that
    no file sets have their defaults. What may be a secret is not shown.

    Exit code 0 if the gateway can run the configuration, 1 if not.

    Examples:
        pitch-gateway check gateway.toml

        pitch-gateway check --compile gateway.toml

        pitch-gateway check --resolved gateway.toml

        pitch-gateway check gateway.toml --json | jq .problems
    """
    from gateway.config.included import read_configuration
    from gateway.config.load import load_document
    from gateway.config.problems import ConfigErrors
    from gateway.config.resolved import settings_in
    from gateway.ipc.log import take_standard_error

    take_standard_error()  # the relay's unit runs this check first
    form = Format.INDENTED if as_json else Format.TEXT
    settings: list[Setting] | None = None
    try:
        document = read_configuration(config)
        settings = settings_in(document) if resolved else None
        loaded = load_document(document)
    except ConfigErrors as errors:
        show(_Checked(config, errors.problems, errors.warnings, None, settings), form)
        raise typer.Exit(1) from None
    if compiles:
        compile_or_exit(loaded)
    show(_Checked(loaded.path, (), loaded.warnings, loaded, settings), form)


@dataclass(frozen=True, slots=True)
class _Checked:
    """The problems of a configuration, and the plan of a good one."""

    path: Path
    problems: "Sequence[Problem]"
    warnings: "Sequence[Problem]"
    loaded: "Loaded | None" = None
    """None: it cannot be run."""
    settings: "Sequence[Setting] | None" = None
    """What each file sets, in place of the summary."""

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
            if signers := self._signers():
                found["signed_by"] = signers
        if self.settings is not None:
            found["resolved"] = [setting.as_data() for setting in self.settings]
        return found

    def lines(self) -> "Iterator[RenderableType]":
        """Yield it in words."""
        from gateway.config.summary import summary_lines

        yield from (StderrLine(problem) for problem in self.problems)
        if self.settings is not None:
            yield from _resolved(self.settings)
        elif self.loaded is not None:
            yield from summary_lines(self.loaded.plan, self.loaded.drives)
            for axis, signer in self._signers().items():
                yield f"axis {axis}: its table is signed by {signer}"
        yield from (StderrLine(f"warning: {warning}") for warning in self.warnings)
        if self.loaded is not None:
            yield f"{self.path}: good"

    def _signers(self) -> dict[str, str]:
        """Return who signed the table of each axis, as far as signatures are asked for."""
        tables = {} if self.loaded is None else self.loaded.tables
        return {axis: table.signer for axis, table in tables.items() if table.signer}


def _resolved(settings: "Sequence[Setting]") -> "Iterator[RenderableType]":
    """Yield a line for each value, with its place; colours on a terminal."""
    from rich.text import Text

    from gateway.config.problems import key_text

    key: object = None
    for setting in settings:
        name, by = key_text(setting.key), setting.replaced_by
        place = _place(setting.place)
        if by is None:
            key = setting.key
            shown = Text.assemble((name, "bold"), " = ", (setting.shown, "green"), "  # ", (place, "cyan"))
        elif setting.key == key:
            shown = Text(f"    in place of {setting.shown}  # {place}", "dim")
        else:
            shown = Text(f"# {place}: {name} = {setting.shown}: replaced by {_place(by)}", "dim")
        shown.no_wrap = True
        yield shown


def _place(place: "Place") -> str:
    return f"{place.file}:{place.line}" if place.line else str(place.file)
