"""``pitch-gateway record CONFIG FILE``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.run import HowToLog, StatusEvery
from gateway.ipc.log import LogFormat

if TYPE_CHECKING:
    from gateway.recording.writer import Recorder

MEGA = 1_000_000


def record(
    config: Config,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording; a new file.", show_default=False)],
    *,
    max_mb: Annotated[
        int, typer.Option("--max-mb", min=1, help="Size in megabytes at which the recording ends.")
    ] = 1000,
    log_format: HowToLog = LogFormat.AUTO,
    status_every: StatusEvery = 0.0,
) -> None:
    """Run the relay of the gateway, and record all its traffic.

    It forwards frames and corrects positions like run. For page, MQTT and new tables, run supervise in a
    second terminal.

    The recording contains every request, reply, time-out and command with its time, the gateway's output, the
    configuration and the tables. replay can run it on any computer. It contains the passwords of the
    configuration; only your user can read it.

    If the disk is full or too slow, the recording ends with an error in the log, and the gateway goes on.

    Examples:
        pitch-gateway record gateway.toml monday.jsonl

        pitch-gateway replay monday.jsonl --show
    """
    from gateway.config.recording_header import header_of
    from gateway.ipc.structured_log import StructuredLog
    from gateway.recording.writer import Recorder
    from gateway.relay.errors import StartError
    from gateway.relay.run import run_relay

    loaded = load_or_exit(config, is_start=True)
    try:
        recorder = Recorder(file, header_of(loaded), max_mb * MEGA)
    except OSError as error:
        typer.echo(f"{error.filename or config}: {error.strerror or error}", err=True)
        raise typer.Exit(1) from None
    _open_or_exit(recorder)
    log = StructuredLog(log_format)
    log.name_gateway(loaded.plan.name)
    try:
        run_relay(
            loaded.plan,
            log.write,
            status_every,
            state=loaded.state_folder,
            recorder=recorder,
        )
    except StartError as error:
        for problem in error.problems:
            typer.echo(f"{config}: {problem}", err=True)
        raise typer.Exit(1) from None
    typer.echo(f"{recorder.entries} entries in {file}", err=True)


def _open_or_exit(recorder: "Recorder") -> None:
    try:
        recorder.open()
    except FileExistsError:
        typer.echo(f"{recorder.path}: exists already; name a new file, or remove this one", err=True)
    except OSError as error:
        why = error.strerror or error
        typer.echo(f"{recorder.path}: cannot be written ({why}); name a file in your own folder", err=True)
    else:
        return
    raise typer.Exit(1)
