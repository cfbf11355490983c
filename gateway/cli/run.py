"""``pitch-gateway run CONFIG``."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated

import typer

from gateway.catalogue.process_events import CONFIGURATION_WARNING
from gateway.cli.arguments import Config
from gateway.cli.configuration import compile_for_start_or_exit
from gateway.ipc.log import WARNING, LogEntry, LogFormat, LogLines, log_entry
from gateway.ipc.log_thread import LogThread

HowToLog = Annotated[
    LogFormat, typer.Option("--log-format", help="How the log is written; auto: console on a terminal.")
]
StatusEvery = Annotated[
    float, typer.Option("--status-every", min=0.0, help="Seconds between status lines; 0: none.")
]


def run(config: Config, *, log_format: HowToLog = LogFormat.AUTO, status_every: StatusEvery = 0.0) -> None:
    """Run the gateway in the foreground until it is stopped (Ctrl-C, SIGTERM).

    It listens, connects to the drives and corrects. The log goes to stderr; the event ready says that all
    listeners are open, and where. Drives and serial adapters that are not there yet are waited for. A stop
    finishes the exchange on the wire first; a second signal ends at once. SIGHUP, as from a terminal that is
    closed, stops nothing: the tables are read anew. Commands (enable, disable,
    reference, reload) reach it through a socket in its state folder.

    There are two processes: the relay moves the frames, the supervisor gives it tables. A supervisor that
    ends is started again, and the relay goes on meanwhile; without the relay the gateway ends.

    Exit code 0 after a stop; 1 when the configuration is bad, a port cannot be opened, the relay died, or on
    a second signal.

    Examples:
        pitch-gateway run gateway.toml

        pitch-gateway run gateway.toml --status-every 1

        pitch-gateway run gateway.toml --log-format json 2> gateway.log
    """
    from gateway.cli.processes import command_of, run_both
    from gateway.ipc.log import take_standard_error

    take_standard_error(log_format)
    name, state, warnings = compile_for_start_or_exit(config)
    _warn(warnings, log_format, name)
    compiled_into = "--state", str(state)
    code = run_both(
        command_of("gateway.relay", config, log_format, "--status-every", str(status_every), *compiled_into),
        command_of("gateway.supervisor", config, log_format, *compiled_into),
        partial(_log, log_format, name),
    )
    if code:
        raise typer.Exit(code)


def _warn(warnings: Sequence[str], log_format: LogFormat, gateway: str) -> None:
    """Log the warnings about the configuration.

    A full disk, a closed reader or a stalled one keeps no gateway from starting.
    """
    lines = LogLines()

    def write(entry: LogEntry) -> None:
        lines.write(entry.severity, f"{WARNING}{entry.fields['detail']}")

    with LogThread(_log(log_format, gateway) if log_format.is_json else write) as log:
        for warning in warnings:
            log.write(log_entry(CONFIGURATION_WARNING, {"detail": warning}, time.time()))


def _log(log_format: LogFormat, gateway: str) -> Callable[[LogEntry], None]:
    from gateway.ipc.structured_log import StructuredLog

    log = StructuredLog(log_format)
    log.name_gateway(gateway)
    return log.write
