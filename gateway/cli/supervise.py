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
        bool, typer.Option("--events", help="Log what happens in the relay, too; it does so itself.")
    ] = False,
) -> None:
    """Run the supervisor alone: it gives the relay new tables. For services.

    It waits for the relay and finds it again. Tables are read when the relay is reached, and on SIGHUP; a bad
    one changes nothing and is in the log with file, line and reason.

    Exit code 0 after a stop; 1 when CONFIG cannot be read, or another supervisor has its state folder.

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
