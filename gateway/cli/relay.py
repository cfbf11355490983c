"""``pitch-gateway relay CONFIG``."""

from gateway.cli.arguments import Config
from gateway.cli.run import HowToLog, StatusEvery
from gateway.ipc.log import LogFormat


def relay(config: Config, *, log_format: HowToLog = LogFormat.AUTO, status_every: StatusEvery = 0.0) -> None:
    """Run the relay alone: Modbus and correction, from the compiled configuration. For services.

    It needs what check --compile or run wrote into the state folder, and says so where the
    configuration has changed since. The supervisor may come and go meanwhile.

    Exit code 0 after a stop; 1 when nothing is compiled, a port cannot be opened, or on a second signal.

    Examples:
        pitch-gateway check --compile gateway.toml && pitch-gateway relay gateway.toml

        pitch-gateway relay gateway.toml --log-format json
    """
    from gateway.cli.processes import become, command_of

    become(
        config,
        command_of("gateway.relay", config, log_format, "--status-every", str(status_every)),
        log_format,
    )
