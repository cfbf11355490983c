"""``pitch-gateway enable CONFIG [AXIS]...``."""

from gateway.cli.arguments import Config
from gateway.cli.commanding import AsJson, Axes, command


def enable(config: Config, axes: Axes = None, *, as_json: AsJson = False) -> None:
    """Switch the compensation of axes on, in the gateway that runs CONFIG.

    Nothing moves by itself: the correction comes into force with the next different target, or is blended in
    over the next stretch of a stream. Axes of one group change together.

    Exit code 1 when no gateway runs or an axis cannot be switched on.

    Examples:
        pitch-gateway enable gateway.toml

        pitch-gateway enable gateway.toml x y
    """
    from gateway.ipc.messages import Enable

    command(
        config,
        Enable(axes=tuple(axes or ())),
        "compensation is on; it comes into force with the next motion",
        "nothing to change: the compensation was on already",
        as_json=as_json,
    )
