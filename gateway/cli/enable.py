"""``pitch-gateway enable CONFIG [AXIS]...``."""

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.commanding import Axes, ask_or_exit, command


def enable(config: Config, axes: Axes = None, *, as_json: AsJson = False) -> None:
    """Switch the compensation of axes on, in the running gateway of CONFIG.

    No axis moves because of it. The correction is applied at the next different target, or blended in along a
    stream of setpoints. Axes of a group change together. An axis in shadow mode stays in it and is named:
    change its configuration and run `reload`.

    Exit code 1 if no gateway runs or an axis cannot be switched on.

    Examples:
        pitch-gateway enable gateway.toml

        pitch-gateway enable gateway.toml x y
    """
    from gateway.exchange.commands import Enable
    from gateway.ipc.messages import GetStatus, Status

    command(
        config,
        Enable(axes=tuple(axes or ())),
        "compensation is on; the correction is applied at the next motion",
        "nothing to change: the compensation was already on",
        as_json=as_json,
        waits="compensation is on, but not applied: the axis is in shadow mode, not referenced, or has a "
        "gain of 0",
    )
    reply = ask_or_exit(config, GetStatus())
    assert isinstance(reply, Status), "a question for the status is answered by it"
    for name, axis in reply.status.axes.items():
        if axis.compensation == "shadow" and (not axes or name in axes):
            typer.echo(
                f"{config}: axis {name} is in shadow mode: corrections are shown, positions pass "
                'unchanged; for corrected positions set compensation = "on", and reload the '
                f"configuration while the axis is at standstill (pitch-gateway reload {config})",
                err=True,
            )
