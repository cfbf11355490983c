"""``pitch-gateway replay FILE``."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import Format, print_json

if TYPE_CHECKING:
    from gateway.exchange.events import Event
    from gateway.recording.replay import Difference, ReplayResult
    from gateway.recording.traffic import Entry, Output

LONGEST_LINE = 64_000_000
"""A header holds every table: more than the largest that is read."""


def replay(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="A recording.", show_default=False, readable=False)
    ],
    *,
    config: Annotated[
        Path | None,
        typer.Option("--config", help="Replay it with this configuration in place of the recorded one."),
    ] = None,
    line: Annotated[str | None, typer.Option("--line", help="Only this line of the gateway.")] = None,
    show: Annotated[bool, typer.Option("--show", help="Print the traffic, readable.")] = False,
    as_json: AsJson = False,
) -> None:
    """Run a recording through the exchange again and compare every byte that comes out.

    The same inputs at the same times have to cause the same outputs, to the drives and to the controllers.
    With another configuration, or another release, the differences show what it would have done instead.

    Exit code 0 when everything is as recorded; 1 when anything differs (the first differences are printed) or
    the file is no recording.

    Examples:
        pitch-gateway replay monday.jsonl

        pitch-gateway replay monday.jsonl --show --line xyz | less

        pitch-gateway replay monday.jsonl --config new.toml --json | jq .first
    """
    from gateway.config.problems import ConfigErrors
    from gateway.files import FileRefusedError
    from gateway.recording.replay import ReplayError
    from gateway.recording.traffic import WrongEntryError

    try:
        result = _replayed(file, config, line, show=show and not as_json)
    except ConfigErrors as errors:
        typer.echo(f"{file}: its configuration is not accepted by this release:", err=True)
        for problem in errors.problems:
            typer.echo(problem, err=True)
        raise typer.Exit(1) from None
    except (ReplayError, WrongEntryError, FileRefusedError) as error:
        typer.echo(f"{file}: {error}", err=True)
        raise typer.Exit(1) from None
    except OSError as error:
        typer.echo(f"{file}: {error.strerror or error}", err=True)
        raise typer.Exit(1) from None
    _report(file, result, as_json=as_json)
    if result.different:
        raise typer.Exit(1)


def _replayed(file: Path, config: Path | None, line: str | None, *, show: bool) -> "ReplayResult":
    from gateway.cli.recordings import for_any_writer, plan_of
    from gateway.recording.readable import Reader
    from gateway.recording.replay import Replay, ReplayError
    from gateway.recording.traffic import CAPTURED, WITHOUT_PEERS, End, Header, Port
    from gateway.state.plan import as_started

    entries = _entries(file)
    first = next(entries, None)
    if first is None or not isinstance(first[1], Header):
        raise ReplayError("no recording: it does not begin with a header")
    plan = plan_of(first[1]) if config is None else load_or_exit(config).plan
    if first[1].format == WITHOUT_PEERS:
        plan = for_any_writer(plan)
    if first[1].format == CAPTURED:
        plan = as_started(plan)  # the records of its axes name these tables
    reader = Reader(plan)
    again = Replay(plan, line, _show_event if show else None)
    again.feed(*first)
    for number, entry in entries:
        different = again.result.different
        is_ours = again.feed(number, entry)
        if show and is_ours and not isinstance(entry, Header | End | Port):
            mark = "≠" if again.result.different > different else " "
            typer.echo(f"{mark}{reader.line(entry)}")
    if again.result.before and not again.result.inputs:
        raise ReplayError(
            "nothing in this capture says what held while its line was idle, and no replay can begin; look "
            "at the frames with capture --pcapng, or let size_mb in [capture] be larger"
        )
    return again.result


def _entries(file: Path) -> Iterator[tuple[int, "Entry"]]:
    """Yield the entries of a file with their line numbers; a last line that was cut off is left out."""
    from gateway.files import open_regular_file
    from gateway.recording.traffic import WrongEntryError, decode

    with open_regular_file(file, "a recording") as lines:
        number = 0
        while data := lines.readline(LONGEST_LINE):
            number += 1
            if len(data) == LONGEST_LINE:
                raise WrongEntryError(f"line {number}: more than {LONGEST_LINE} bytes; this is no recording")
            if not data.endswith(b"\n") and number > 1:
                return
            try:
                yield number, decode(data)
            except WrongEntryError as error:
                raise WrongEntryError(f"line {number}: {error}") from None


def _show_event(line: str, event: "Event") -> None:
    axis = f" axis {event.axis}" if event.axis else ""
    typer.echo(f"              {line:<8} * {event.kind.name}{axis} {event.detail}".rstrip())


def _report(file: Path, result: "ReplayResult", *, as_json: bool) -> None:
    if as_json:
        print_json(
            {
                "inputs": result.inputs,
                "outputs": result.outputs,
                "different": result.different,
                "is_cut_off": result.is_cut_off,
                "before": result.before,
                "first": [_as_json(difference) for difference in result.first],
            },
            Format.JSON,
        )
        return
    if result.is_cut_off:
        typer.echo(f"warning: {file} was cut off: it is replayed as far as it goes", err=True)
    if result.before:
        entries = "1 entry" if result.before == 1 else f"{result.before} entries"
        typer.echo(f"{file}: {entries} from before what is known: not compared", err=True)
    if not result.different:
        typer.echo(f"{result.inputs} inputs, {result.outputs} outputs: all as recorded")
        return
    for difference in result.first:
        typer.echo(
            f"{file}:{difference.file_line}: at {difference.t} ns on line {difference.line}: "
            f"expected {_shown(difference.expected)}, got {_shown(difference.got)}",
            err=True,
        )
    more = result.different - len(result.first)
    if more:
        typer.echo(f"{file}: and {more} more", err=True)
    typer.echo(f"{result.inputs} inputs, {result.outputs} outputs: {result.different} differ")


def _as_json(difference: "Difference") -> dict[str, object]:
    return {
        "entry": difference.entry,
        "file_line": difference.file_line,
        "t": difference.t,
        "line": difference.line,
        "expected": None if difference.expected is None else _shown(difference.expected),
        "got": None if difference.got is None else _shown(difference.got),
    }


def _shown(output: "Output | None") -> str:
    from gateway.recording.readable import pdu_name
    from gateway.recording.traffic import Abandoned, Answered

    if output is None:
        return "nothing"
    if isinstance(output, Abandoned):
        return "to give up waiting"
    pdu = bytes.fromhex(output.pdu)
    to = f"controller port {output.port}" if isinstance(output, Answered) else "drive"
    return f"to {to} unit {output.unit}: {pdu_name(pdu)} {pdu.hex(' ')}"
