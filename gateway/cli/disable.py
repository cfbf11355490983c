"""``pitch-gateway disable CONFIG [AXIS]...``."""

from gateway.cli.arguments import AsJson, Config
from gateway.cli.commanding import Axes, command


def disable(config: Config, axes: Axes = None, *, as_json: AsJson = False) -> None:
    """Switch the compensation of axes off, in the gateway that runs CONFIG, until it is enabled or restarted.

    Nothing moves by itself: the correction goes with the next different target, or is blended out over the
    next stretch of a stream. Axes of one group change together.

    Exit code 1 when no gateway runs or an axis cannot be switched off.

    Examples:
        pitch-gateway disable gateway.toml

        pitch-gateway disable gateway.toml x
    """
    from gateway.exchange.commands import Disable

    command(
        config,
        Disable(axes=tuple(axes or ())),
        "compensation is off; the correction goes with the next motion",
        "nothing to change: the compensation was off already",
        as_json=as_json,
    )
