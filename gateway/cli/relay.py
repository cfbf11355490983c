"""``pitch-gateway relay CONFIG``."""

from gateway.cli.arguments import Config
from gateway.cli.run import HowToLog, StatusEvery
from gateway.ipc.log import LogFormat


def relay(config: Config, *, log_format: HowToLog = LogFormat.AUTO, status_every: StatusEvery = 0.0) -> None:
    """Run only the relay: Modbus and correction, from the compiled configuration. For services.

    First run check --compile or run: they write what the relay needs into the state folder. The relay does
    not start if the configuration has changed since. The supervisor may stop and start while the relay runs.

    Exit code 0 after a stop; 1 if nothing is compiled, a port cannot be opened, or after a second signal.

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
