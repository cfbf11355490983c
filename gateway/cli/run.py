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
    LogFormat, typer.Option("--log-format", help="Format of the log; auto: console on a terminal.")
]
StatusEvery = Annotated[
    float, typer.Option("--status-every", min=0.0, help="Seconds between status lines; 0: none.")
]


def run(config: Config, *, log_format: HowToLog = LogFormat.AUTO, status_every: StatusEvery = 0.0) -> None:
    """Run the gateway in the foreground until Ctrl-C or SIGTERM.

    It opens its listeners, connects to the drives and corrects positions. The log goes to stderr; the event
    ready lists the open listeners. The gateway waits for drives and serial adapters that are missing. A stop
    first finishes the exchange on the wire; a second signal ends immediately. SIGHUP, for example from a
    closed terminal, only reads the tables again. The commands enable, disable, reference and reload use a
    socket in the state folder.

    The gateway has two processes: the relay forwards frames, the supervisor gives it tables. If the
    supervisor ends, it is restarted while the relay goes on. If the relay ends, the gateway ends.

    Exit code 0 after a stop; 1 if the configuration is bad, a port cannot be opened, the relay died, or after
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
