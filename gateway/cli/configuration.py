"""A configuration for commands: loaded and checked, or only the state folder of its gateway."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from gateway.config.load import Loaded
    from gateway.state.plan import GatewayPlan


def load_or_exit(config: Path, *, checks_times: bool = True, is_start: bool = False) -> "Loaded":
    """Load a configuration; report its problems on stderr and end the command with exit code 1.

    ``is_start``: this user is about to run it, as in ``config.load.load_document``.
    """
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors

    try:
        loaded = load(config, checks_times=checks_times, is_start=is_start)
    except ConfigErrors as errors:
        for problem in errors.problems:
            typer.echo(problem, err=True)
        raise typer.Exit(1) from None
    for warning in loaded.warnings:
        typer.echo(f"warning: {warning}", err=True)
    return loaded


def compile_for_start_or_exit(config: Path) -> tuple[str, Path, list[str]]:
    """Write the relay's compiled configuration into the state folder, or report why not and exit with 1.

    Return the name of the gateway, that folder, and the warnings.

    If the file of a table is bad, an earlier good one of that name is used, and this is reported.
    """
    from gateway.config.last_good import TableSource, settle
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors
    from gateway.state.last_good import last_plan

    try:
        loaded = load(config, forgives_tables=True, is_start=True)
    except ConfigErrors:
        load_or_exit(config, is_start=True)  # also reports problems of the tables
        raise
    last = last_plan(loaded.state_folder)
    settled = settle(loaded, last)
    if settled.refused:
        load_or_exit(config, is_start=True)
    warnings = [str(warning) for warning in loaded.warnings]
    for name, reading in loaded.readings.items():
        warnings += [str(remark) for remark in (*reading.problems, *reading.findings.warnings)]
        if settled.sources[name] is TableSource.KEPT:
            warnings.append(f"{reading.path}: axis {name} starts with the last good table")
        elif settled.sources[name] is TableSource.ABSENT:
            warnings.append(f"{reading.path}: axis {name} starts without correction")
    compile_or_exit(loaded, settled.plan)
    return loaded.plan.name, loaded.state_folder, warnings


def compile_or_exit(loaded: "Loaded", plan: "GatewayPlan | None" = None) -> None:
    """Write the compiled form of a configuration into its state folder, or report why not and exit with 1.

    ``plan`` is its plan, if that differs from its files.
    """
    from gateway.config.compile import compile_into_state
    from gateway.state.folder import StateError

    try:
        compile_into_state(loaded, plan)
    except StateError as error:
        typer.echo(f"{loaded.path}: {error}", err=True)
        raise typer.Exit(1) from None


def state_folder_or_exit(config: Path) -> Path:
    """Return the state folder of a configuration, in spite of other problems in it.

    A running gateway can be commanded while its configuration is being edited.
    """
    from gateway.config.findings import read_document
    from gateway.config.included import read_configuration
    from gateway.config.problems import ConfigErrors
    from gateway.state.folder import names_state, state_folder_anyway

    try:
        document = read_document(config)
        if not names_state(document.tables):
            document = read_configuration(config)
    except ConfigErrors as errors:
        for problem in errors.problems:
            typer.echo(problem, err=True)
        raise typer.Exit(1) from None
    return state_folder_anyway(config, document.tables)
