"""``pitch-gateway probe CONFIG``."""

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gateway.cli.arguments import AsJson, Config
from gateway.cli.configuration import load_or_exit
from gateway.cli.output import Format, print_lines, show

if TYPE_CHECKING:
    from gateway.config.load import Loaded
    from gateway.state.plan import LinePlan


def probe(
    config: Config,
    *,
    axis: Annotated[str | None, typer.Option("--axis", help="Only this axis.")] = None,
    timing: Annotated[
        bool,
        typer.Option("--timing", help="Measure how long the drives take to reply, and propose time-outs."),
    ] = False,
    scan: Annotated[
        bool,
        typer.Option("--scan", help="Also read from each unit id from 1 to 247, to see which ones reply."),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Check the real drives before anything moves. It writes nothing.

    It reads the positions and bits of the register maps, one request at a time, with the silences that the
    drives need. It checks that each drive replies, the word order is right, the axis is inside its travel and
    its table, and the commanded and actual positions agree. On Modbus/TCP it also reads from a unit id
    without an axis: if no device replies, the address may serve further devices, which other_units must name.
    On a serial line each drive gets one read with a wrong CRC, which it must not answer.

    --scan reads one register from each unit id from 1 to 247 and lists those that reply. If none replies,
    this takes 247 times response_timeout_ms.

    --timing reads each drive a hundred times, then fifty times with shorter and shorter silences before each
    request. It proposes response_timeout_ms, drain_ms and gap_ms, with their cost. Only reads are measured: a
    drive may need longer to store a value.

    First stop the gateway: only one program can use a line. Exit code 1 if a check fails.

    Examples:
        pitch-gateway probe gateway.toml

        pitch-gateway probe gateway.toml --timing

        pitch-gateway probe gateway.toml --scan

        pitch-gateway probe gateway.toml --axis x --json | jq .axes.x
    """
    from gateway.commissioning.probe import probing
    from gateway.options import OptionError

    loaded = load_or_exit(config)
    try:
        lines = probing.lines_with(loaded.plan.lines, axis)
    except OptionError as error:
        typer.echo(f"{config}: {error.why}", err=True)
        raise typer.Exit(1) from None
    _refuse_beside_gateway(loaded, config)
    if timing:
        if axis is not None:
            raise typer.BadParameter(
                "remove --axis: all drives of a line share its time-outs", param_hint="--axis"
            )
        if scan:
            raise typer.BadParameter("give --timing or --scan, not both", param_hint="--scan")
        found: probing.Timed | probing.Probed = asyncio.run(probing.time_drives(lines))
    else:
        found = asyncio.run(probing.probe(lines, axis, is_scanned=scan, on_scan=_print_scan))
    show(found, Format.JSON if as_json else Format.TEXT)
    print_lines((f"{config}: {problem}" for problem in found.problems), err=True)
    if not found.is_good:
        raise typer.Exit(1)


def _refuse_beside_gateway(loaded: "Loaded", config: Path) -> None:
    from gateway.ipc.address import SocketError, socket_path
    from gateway.ipc.client import NobodyListensError, NoGatewayError, ask
    from gateway.ipc.messages import Ping

    try:
        ask(socket_path(loaded.state_folder), Ping())
    except (NobodyListensError, SocketError):
        return
    except NoGatewayError:
        pass  # a gateway, perhaps of another release, is running and uses the drives
    typer.echo(
        f"{config}: its gateway is running and uses the drives. To probe, stop the gateway first. While "
        f"it runs: pitch-gateway status {config} shows whether they reply, pitch-gateway capture "
        f"{config} --follow shows each frame",
        err=True,
    )
    raise typer.Exit(1)


def _print_scan(line: "LinePlan") -> None:
    from gateway.commissioning.probe.readings import LAST_UNIT_ID
    from gateway.times import NS_PER_MS, NS_PER_S, span

    at_most = span(LAST_UNIT_ID * line.timing.response_timeout_ms * NS_PER_MS / NS_PER_S)
    typer.echo(
        f"line {line.name}: reads from unit ids 1 to {LAST_UNIT_ID}, for {at_most} at most; Ctrl-C ends it",
        err=True,
    )
