"""``pitch-gateway disable CONFIG [AXIS]...``."""

from gateway.cli.arguments import AsJson, Config
from gateway.cli.commanding import Axes, command


def disable(config: Config, axes: Axes = None, *, as_json: AsJson = False) -> None:
    """Switch the compensation of axes off, in the running gateway of CONFIG, until enable or a restart.

    No axis moves because of it. The correction is removed at the next different target, or blended out along
    a stream of setpoints. Axes of a group change together.

    Exit code 1 if no gateway runs or an axis cannot be switched off.

    Examples:
        pitch-gateway disable gateway.toml

        pitch-gateway disable gateway.toml x
    """
    from gateway.exchange.commands import Disable

    command(
        config,
        Disable(axes=tuple(axes or ())),
        "compensation is off; the correction is removed at the next motion",
        "nothing to change: the compensation was already off",
        as_json=as_json,
    )
