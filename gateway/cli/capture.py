"""``pitch-gateway capture CONFIG``."""

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, BinaryIO, Final

import typer

from gateway.cli.arguments import Config, Line
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import Format, print_json, print_lines
from gateway.files import create

if TYPE_CHECKING:
    from rich.console import Console

    from gateway.commissioning.frames import LineEntry, LineFrames, Taken

EVERY_S: Final = 0.1
STANDARD_OUTPUT: Final = "-"
COLOURS: Final = {"request": "cyan", "answered": "cyan", "sent": "green", "reply": "green"}
"""The side of the controllers, and that of the drives."""
ERROR_COLOUR: Final = "red"
LOST: Final = "frames were lost: they came faster than this command could read them"


def capture(
    config: Config,
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="New file, for replay.", show_default=False),
    ] = None,
    *,
    pcapng: Annotated[
        str | None,
        typer.Option("--pcapng", metavar="FILE", help="New file for Wireshark; - is standard output."),
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="Continue with new frames, until Ctrl-C.")
    ] = False,
    line: Line = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print frames, or what was written, as JSON lines.")
    ] = False,
) -> None:
    """Save or show the last minutes of traffic on the lines of the running gateway of CONFIG.

    The gateway keeps its traffic in memory of a fixed size (key capture.size_mb). This command reads
    that memory and does not disturb the gateway. FILE is a recording as record writes it, with the known
    state of the axes: replay runs it. --pcapng writes a file for Wireshark, with an interface for each
    controller and one for the drives. Wireshark decodes Modbus/TCP and RTU (as mbrtu) without settings.
    Without a file, the frames are printed in words.

    FILE contains the configuration with its passwords; only your user can read it.

    Exit code 1 if no gateway runs or it keeps no traffic; 0 after Ctrl-C.

    Examples:
        pitch-gateway capture gateway.toml monday.jsonl && pitch-gateway replay monday.jsonl

        pitch-gateway capture gateway.toml --pcapng monday.pcapng

        pitch-gateway capture gateway.toml --follow --line xyz

        pitch-gateway capture gateway.toml --follow --pcapng - | wireshark -k -i -

        pitch-gateway capture gateway.toml --follow --json | jq .
    """
    from gateway.commissioning.frames import LineFrames, NothingTakenError
    from gateway.ipc.client import NobodyListensError, NoGatewayError
    from gateway.recording.capture import NoCaptureError

    if follow and file is not None:
        typer.echo("--follow writes no FILE: use record, or --pcapng, or omit FILE", err=True)
        raise typer.Exit(2)
    loaded = load_or_exit(config)
    try:
        frames = LineFrames(loaded, line)
        if frames.is_of_another:
            typer.echo(
                f"{config}: differs from the configuration that the gateway runs: names may be wrong",
                err=True,
            )
        with frames, _opened(pcapng) as out:
            if follow:
                with suppress(KeyboardInterrupt):
                    _follow(frames, out, as_json=as_json)
            elif file is None and out is None:
                _print(frames.new(), _console(), as_json=as_json)
            else:
                taken = frames.take(file, out, None if pcapng == STANDARD_OUTPUT else pcapng)
                _report(taken, as_json=as_json)
    except NobodyListensError as error:
        typer.echo(f"{config}: {error}; start it with: pitch-gateway run {config}", err=True)
        raise typer.Exit(1) from None
    except (NoGatewayError, NoCaptureError, NothingTakenError) as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None


def _report(taken: "Taken", *, as_json: bool) -> None:
    if as_json:
        print_json(taken.as_data(), Format.JSON)
    else:
        print_lines(taken.lines(), err=True)


def _follow(frames: "LineFrames", out: BinaryIO | None, *, as_json: bool) -> None:
    """Continue until the user ends it, or the gateway ends its trace buffer."""
    frames.skip()  # --follow shows new frames only
    if out is not None:
        frames.begin_packets(out)
    console = _console()
    while True:
        if out is None:
            found = frames.new()
            _print_lost(frames)
            _print(found, console, as_json=as_json)
            sys.stdout.flush()
        else:
            frames.write_packets(out)
            _print_lost(frames)
        time.sleep(EVERY_S)


def _print_lost(frames: "LineFrames") -> None:
    if frames.is_lost:
        typer.echo(LOST, err=True)


def _console() -> "Console":
    from rich.console import Console

    return Console(highlight=False, soft_wrap=True)


def _print(found: "Iterable[LineEntry]", console: "Console", *, as_json: bool) -> None:
    """Print frames, in words or as JSON lines."""
    from rich.text import Text

    for frame in found:
        if as_json:
            print_json(frame.as_data(), Format.LINE)
        else:
            colour = ERROR_COLOUR if frame.is_error else COLOURS.get(frame.kind, "yellow")
            console.print(Text(frame.words, colour))


@contextmanager
def _opened(pcapng: str | None) -> "Iterator[BinaryIO | None]":
    """Open the file for Wireshark; it is removed if nothing was written to it.

    Raises:
        NothingTakenError: it exists, or cannot be written.
    """
    from gateway.commissioning.frames import NothingTakenError

    if pcapng is None:
        yield None
        return
    if pcapng == STANDARD_OUTPUT:
        yield sys.stdout.buffer
        return
    path = Path(pcapng)
    try:
        out = open(path, "wb", opener=lambda *_: create(path))  # noqa: SIM115 - it has a name, unlike that of a descriptor
    except FileExistsError:
        raise NothingTakenError(f"{pcapng}: exists already; name a new file, or remove it") from None
    except OSError as error:
        raise NothingTakenError(f"{pcapng}: cannot be written ({error.strerror or error})") from None
    try:
        yield out
    finally:
        with suppress(OSError):  # what could not be written was reported
            out.close()
        with suppress(FileNotFoundError):  # it was moved meanwhile
            if not path.stat().st_size:
                path.unlink()
