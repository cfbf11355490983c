"""``pitch-gateway demo``: the whole system on one screen."""

import asyncio
import signal
import tempfile
import time
from collections.abc import Coroutine
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, TypeVar

import typer

from gateway.cli.options import takes_options
from gateway.cli.output import STOPPED_BY_SIGNAL, Format, show

if TYPE_CHECKING:
    from rich.console import Console

    from gateway.cli.demo_screen import Screen
    from gateway.commissioning.demo.cycle import View

ONCE_SPEED_UP: Final = 100.0
LIVE_SPEED_UP: Final = 8.0
"""Slow enough to see the axes move on the screen."""
PAUSE_S: Final = 4.0
"""Time to look at the result of a round on the live screen."""

Result = TypeVar("Result")


class _StoppedError(Exception):
    """A signal came before the work was done."""

    def __init__(self, number: signal.Signals) -> None:
        super().__init__(f"stopped by {number.name} before the end: there is no result")
        self.exit_code = STOPPED_BY_SIGNAL + number


@dataclass(frozen=True, slots=True)
class DemoOptions:
    """What is shown, and which files are kept."""

    once: Annotated[bool, typer.Option("--once", help="Run one round, then end.")] = False
    json_output: Annotated[
        bool, typer.Option("--json", help="Run one round; print JSON on stdout, progress on stderr.")
    ] = False
    seed: Annotated[int, typer.Option("--seed", help="The same seed makes the same machine.")] = 1
    keep: Annotated[
        Path | None,
        typer.Option("--keep", help="Keep gateway.toml and the tables in this folder.", metavar="DIR"),
    ] = None
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            help="Run one round, measured before and after; write its report: .html, .png or .svg.",
            metavar="OUT",
        ),
    ] = None
    force: Annotated[bool, typer.Option("--force", help="Overwrite the report.")] = False


@takes_options
def demo(*, options: DemoOptions) -> None:
    """Show how the gateway makes a worn machine accurate. Controllers, drives and laser are simulated.

    Three axes have worn screws and backlash. The laser measures them, its readings become a table, and the
    same random moves run without and with it. A terminal shows new rounds until Ctrl-C. Otherwise, or with
    --once, one round runs and its result is printed.

    Progress goes to stderr, the result to stdout. Exit code 1: a round left more than 1/20 of an error, or a
    position read back differs from the commanded one. 130 or 143: a signal stopped the round before its end.
    Stopping the live screen gives 0.

    Examples:
        pitch-gateway demo
        pitch-gateway demo --once --json
        pitch-gateway demo --once --seed 7 --keep /tmp/demo
        pitch-gateway demo --report machine.html
    """
    from rich.console import Console

    is_once = options.once or options.json_output or options.report is not None
    if not _perform(options, live=not is_once and Console().is_terminal):
        raise typer.Exit(1)


def _perform(options: DemoOptions, *, live: bool) -> bool:
    """Run it in a temporary folder; return whether the result is good. An early end is reported."""
    from rich.console import Console

    from gateway.relay.errors import StartError
    from gateway.report.errors import ReportError
    from gateway.report.writing import check_path
    from gateway.simulator.errors import SimulatorError

    try:
        if options.report is not None:
            check_path(options.report, force=options.force)
        with ExitStack() as exits:
            folder = options.keep or Path(
                exits.enter_context(tempfile.TemporaryDirectory(prefix="pitch-gateway-demo-"))
            )
            folder.mkdir(parents=True, exist_ok=True)
            return asyncio.run(_live(Console(), folder, options.seed) if live else _once(folder, options))
    except _StoppedError as stopped:
        typer.echo(f"demo: {stopped}", err=True)
        raise typer.Exit(stopped.exit_code) from None
    except (SimulatorError, StartError, ReportError, OSError) as error:
        typer.echo(f"demo: {error}", err=True)
        raise typer.Exit(1) from None


async def _once(folder: Path, options: DemoOptions) -> bool:
    """Run one round with a line for each step, and its result."""
    from rich.console import Console
    from rich.text import Text

    from gateway.cli.demo_screen import Narrator, summary
    from gateway.commissioning.demo.cycle import run_round
    from gateway.commissioning.demo.result import REPORT_RUNS, Demonstrated

    started_s = time.monotonic()
    runs = 0 if options.report is None else REPORT_RUNS
    narrator = Narrator(Console(stderr=True))
    view = await _until_signal(run_round(options.seed, folder, ONCE_SPEED_UP, narrator, runs))
    if options.report is not None:
        _write_report(view, options.report, force=options.force)
    found = Demonstrated(view, time.monotonic() - started_s, options.keep, options.report)
    form = Format.INDENTED_ASCII if options.json_output else Format.TEXT
    show(found, form, (summary(view), *map(Text, found.lines())))
    return found.is_good


def _write_report(view: "View", path: Path, *, force: bool) -> None:
    from gateway.commissioning.demo.result import report_of
    from gateway.report.writing import write_report

    made_at = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    write_report(report_of(view, made_at), path, force=force)


async def _live(console: "Console", folder: Path, seed: int) -> bool:
    """Show rounds on the screen, each with a new machine, until a signal."""
    from gateway.cli.demo_screen import Screen

    screen = Screen(console)
    drawing = asyncio.create_task(screen.run())
    try:
        with suppress(_StoppedError):
            await _until_signal(_rounds(screen, folder, seed))
    finally:
        drawing.cancel()
        with suppress(asyncio.CancelledError):
            await drawing
    return True


async def _rounds(screen: "Screen", folder: Path, seed: int) -> None:
    from gateway.commissioning.demo.cycle import run_round

    while True:
        await run_round(seed, folder, LIVE_SPEED_UP, screen)
        await asyncio.sleep(PAUSE_S)
        seed += 1


async def _until_signal(work: Coroutine[object, object, Result]) -> Result:
    """Run ``work``; SIGINT and SIGTERM end it cleanly.

    Raises:
        _StoppedError: one of them came.
    """
    task = asyncio.ensure_future(work)
    loop = asyncio.get_running_loop()
    came: list[signal.Signals] = []

    def stop(number: signal.Signals) -> None:
        came.append(number)
        task.cancel()

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop, number)
    try:
        return await task
    except asyncio.CancelledError:
        if came:
            raise _StoppedError(came[0]) from None
        raise
