"""``pitch-gateway supervise CONFIG``."""

from typing import Annotated

import typer

from gateway.cli.arguments import Config
from gateway.cli.run import HowToLog
from gateway.ipc.log import LogFormat


def supervise(
    config: Config,
    *,
    log_format: HowToLog = LogFormat.AUTO,
    events: Annotated[
        bool, typer.Option("--events", help="Log the events of the relay too; the relay also logs them.")
    ] = False,
) -> None:
    """Run only the supervisor: it gives the relay new tables. For services.

    It waits for the relay and reconnects to it. It reads the tables when it has connected, and on SIGHUP. A
    bad table changes nothing; the log names file, line and reason.

    Exit code 0 after a stop; 1 if CONFIG cannot be read, or another supervisor uses its state folder.

    Examples:
        pitch-gateway supervise gateway.toml

        pitch-gateway supervise gateway.toml --log-format json --events
    """
    from gateway.cli.processes import become, command_of

    become(
        config,
        command_of("gateway.supervisor", config, log_format, "--events", "yes" if events else "no"),
        log_format,
    )
