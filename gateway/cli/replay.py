"""``pitch-gateway replay FILE``."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson, Line
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import Format, StderrLine, show

if TYPE_CHECKING:
    from gateway.exchange.events import Event
    from gateway.recording.replay import ReplayResult
    from gateway.recording.traffic import Input, Output
    from gateway.state.plan import GatewayPlan


def replay(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A recording.", show_default=False, readable=False)
    ],
    *,
    config: Annotated[
        Path | None,
        typer.Option("--config", help="Use this configuration in place of the recorded one."),
    ] = None,
    line: Line = None,
    show_traffic: Annotated[bool, typer.Option("--show", help="Print the traffic in words.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run a recording through the exchange again and compare every output byte.

    The same inputs at the same times must give the same outputs, to drives and controllers. With another
    configuration or release, the differences show its effect.

    Exit code 0 if everything is as recorded; 1 if anything differs (the first differences are printed) or the
    file is no recording.

    Examples:
        pitch-gateway replay monday.jsonl

        pitch-gateway replay monday.jsonl --show --line xyz | less

        pitch-gateway replay monday.jsonl --config new.toml --json | jq .first
    """
    from gateway.commissioning.recordings import RecordedFile
    from gateway.config.problems import ConfigErrors
    from gateway.files import FileRefusedError
    from gateway.recording.replay import ReplayError
    from gateway.recording.traffic import WrongEntryError

    try:
        recorded = RecordedFile(file)
        plan = recorded.plan(None if config is None else load_or_exit(config).plan)
        telling = _telling(plan) if show_traffic and not as_json else ()
        result = recorded.replay(plan, line, *telling)
    except ConfigErrors as errors:
        typer.echo(f"{file}: this release does not accept its configuration:", err=True)
        for problem in errors.problems:
            typer.echo(problem, err=True)
        raise typer.Exit(1) from None
    except (ReplayError, WrongEntryError, FileRefusedError) as error:
        typer.echo(f"{file}: {error}", err=True)
        raise typer.Exit(1) from None
    except OSError as error:
        typer.echo(f"{file}: {error.strerror or error}", err=True)
        raise typer.Exit(1) from None
    show(result, Format.JSON if as_json else Format.TEXT, _words(file, result))
    if result.different:
        raise typer.Exit(1)


def _telling(
    plan: "GatewayPlan",
) -> "tuple[Callable[[Input | Output, bool], None], Callable[[str, Event], None]]":
    """Return the printer of the traffic, readable, and that of the events."""
    from gateway.recording.readable import Reader

    reader = Reader(plan)

    def entry_came(entry: "Input | Output", is_different: bool) -> None:
        typer.echo(f"{'≠' if is_different else ' '}{reader.line(entry)}")

    return entry_came, _show_event


def _show_event(line: str, event: "Event") -> None:
    axis = f" axis {event.axis}" if event.axis else ""
    typer.echo(f"              {line:<8} * {event.kind.name}{axis} {event.detail}".rstrip())


def _words(file: Path, result: "ReplayResult") -> Iterator[str]:
    if result.is_truncated:
        yield StderrLine(f"warning: {file} is truncated: only its complete part is replayed")
    if result.before:
        entries = "1 entry" if result.before == 1 else f"{result.before} entries"
        yield StderrLine(f"{file}: {entries} could not be compared: the state before them is unknown")
    if not result.different:
        yield f"{result.inputs} inputs, {result.outputs} outputs: all as recorded"
        return
    yield from (StderrLine(f"{file}:{difference.file_line}: {difference}") for difference in result.first)
    if more := result.different - len(result.first):
        yield StderrLine(f"{file}: and {more} more")
    yield f"{result.inputs} inputs, {result.outputs} outputs: {result.different} differ"
