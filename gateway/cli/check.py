"""``pitch-gateway check CONFIG``."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import compile_or_exit
from gateway.cli.output import print_json

if TYPE_CHECKING:
    from gateway.config.load import Loaded
    from gateway.config.problems import ConfigErrors, Problem


def check(
    config: Config,
    *,
    as_json: AsJson = False,
    compiles: Annotated[
        bool, typer.Option("--compile", help="Write what `relay` starts from into the state folder.")
    ] = False,
) -> None:
    """Find everything that is wrong with a configuration and its tables, at once.

    Each problem is one line on stderr: file and line, key, what was found, what is allowed or what to do.
    With --compile a good one is written into its state folder, with its tables, in the form that
    relay starts from; a gateway that runs keeps what it has.

    Exit code 0 when the configuration can be run, 1 when it cannot.

    Examples:
        pitch-gateway check gateway.toml

        pitch-gateway check --compile gateway.toml

        pitch-gateway check gateway.toml --json | jq .problems
    """
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors
    from gateway.ipc.notes import take_standard_error

    take_standard_error()  # the unit of the relay checks first
    try:
        loaded = load(config)
    except ConfigErrors as errors:
        _say_bad(errors, as_json=as_json)
        raise typer.Exit(1) from None
    if compiles:
        compile_or_exit(loaded)
    _say_good(loaded, as_json=as_json)


def _say_bad(errors: "ConfigErrors", *, as_json: bool) -> None:
    if as_json:
        _say_json(errors.problems, errors.warnings)
        return
    for problem in errors.problems:
        typer.echo(problem, err=True)
    for warning in errors.warnings:
        typer.echo(f"warning: {warning}", err=True)


def _say_good(loaded: "Loaded", *, as_json: bool) -> None:
    from msgspec import to_builtins

    from gateway.config.summary import summary, summary_lines

    if as_json:
        _say_json((), loaded.warnings, to_builtins(summary(loaded.plan, loaded.drives)))
        return
    for line in summary_lines(loaded.plan, loaded.drives):
        typer.echo(line)
    for warning in loaded.warnings:
        typer.echo(f"warning: {warning}", err=True)
    typer.echo(f"{loaded.path}: good")


def _say_json(
    problems: Sequence["Problem"], warnings: Sequence["Problem"], amounts_to: dict[str, Any] | None = None
) -> None:
    result: dict[str, Any] = {
        "ok": not problems,
        "problems": [problem.as_dict() for problem in problems],
        "warnings": [warning.as_dict() for warning in warnings],
    }
    if amounts_to is not None:
        result["summary"] = amounts_to
    print_json(result)
