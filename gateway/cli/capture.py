"""``pitch-gateway capture CONFIG``."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import Config
from gateway.cli.configuration import load_or_exit

if TYPE_CHECKING:
    from gateway.cli.capturing.showing import Taken


def capture(
    config: Config,
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="A new file, which replay runs.", show_default=False),
    ] = None,
    *,
    pcapng: Annotated[
        str | None,
        typer.Option(
            "--pcapng", metavar="FILE", help="A new file that Wireshark reads; - is standard output."
        ),
    ] = None,
    follow: Annotated[
        bool, typer.Option("--follow", "-f", help="Go on with what comes, until Ctrl-C.")
    ] = False,
    line: Annotated[str | None, typer.Option("--line", help="Only this line of the gateway.")] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print frames, or what was written, as JSON lines.")
    ] = False,
) -> None:
    """Take the last minutes of the lines out of the gateway that runs CONFIG.

    The gateway keeps what passed on its lines in memory of a fixed size (size_mb of capture). This looks into
    it: the gateway does nothing for that, and goes on. FILE holds it as record does, with what was known of
    the axes, so that replay runs it. --pcapng has it for Wireshark, an interface for each controller and one
    for the drives: Modbus/TCP as such, RTU as mbrtu, and nothing has to be set there. Without a file the
    frames are printed, in words.

    FILE holds the configuration with its passwords, so only this user may read it.

    Exit code 1 when no gateway runs, or it keeps nothing; 0 after Ctrl-C.

    Examples:
        pitch-gateway capture gateway.toml monday.jsonl && pitch-gateway replay monday.jsonl

        pitch-gateway capture gateway.toml --pcapng monday.pcapng

        pitch-gateway capture gateway.toml --follow --line xyz

        pitch-gateway capture gateway.toml --follow --pcapng - | wireshark -k -i -

        pitch-gateway capture gateway.toml --follow --json | jq .
    """
    from gateway.cli.capturing.showing import NothingTakenError, take
    from gateway.ipc.client import NobodyListensError, NoGatewayError
    from gateway.recording.capture import NoCaptureError

    if follow and file is not None:
        typer.echo("--follow with FILE: use record, or --pcapng, or follow without a file", err=True)
        raise typer.Exit(2)
    loaded = load_or_exit(config)
    try:
        taken = take(loaded, file, pcapng, line, is_following=follow, as_json=as_json)
    except NobodyListensError as error:
        typer.echo(f"{config}: {error}; start it with: pitch-gateway run {config}", err=True)
        raise typer.Exit(1) from None
    except (NoGatewayError, NoCaptureError, NothingTakenError) as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None
    if taken is not None:
        _report(taken, as_json=as_json)


def _report(taken: "Taken", *, as_json: bool) -> None:
    if as_json:
        sys.stdout.write(json.dumps(taken.as_data()) + "\n")
        return
    for path in taken.files:
        typer.echo(f"{taken.frames} frames of {taken.span} in {path}", err=True)
