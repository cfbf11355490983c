"""``pitch-gateway simulate``: drives without a machine."""

import asyncio
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gateway.cli.arguments import Config
from gateway.cli.options import takes_options
from gateway.cli.output import Format, show
from gateway.simulator.clock import SPEED_UP
from gateway.simulator.wire import (
    AT_ONCE,
    Adapter,
    BurstBytes,
    Cable,
    Jitter,
    LatencyTimer,
    Noise,
    WireFaults,
)

if TYPE_CHECKING:
    from gateway.simulator.ears import Hearing
    from gateway.simulator.gauge import VirtualGauge
    from gateway.simulator.world import ServedLine
    from gateway.state.plan import GatewayPlan


@takes_options
def simulate(
    config: Config,
    speed_up: Annotated[float, SPEED_UP] = 1.0,
    seed: Annotated[int, typer.Option("--seed", help="The same seed makes the same worn screws.")] = 0,
    *,
    paced: Annotated[
        bool,
        typer.Option(
            "--paced/--unpaced",
            help="Serial bytes and replies of drives take their real time.",
        ),
    ] = True,
    latency_timer_ms: LatencyTimer = AT_ONCE.latency_timer_ms,
    burst_bytes: BurstBytes = AT_ONCE.burst_bytes,
    jitter_ms: Jitter = AT_ONCE.jitter_ms,
    noise: Noise = 0.0,
    hearing: Annotated[
        str,
        typer.Option(
            "--hearing",
            show_default="whole good frames, at any place",
            help="What serial drives accept as a frame: standard, any-length, merging, no-check.",
        ),
    ] = "",
    gauge: Annotated[
        bool,
        typer.Option(
            "--gauge",
            help="Simulate a laser at each axis: a port gauge-AXIS in this folder for measure, and a "
            "line of output at each position where the axis stops.",
        ),
    ] = False,
    json_output: Annotated[
        bool, typer.Option("--json", help="Print the simulated ports as one line of JSON.")
    ] = False,
) -> None:
    """Simulate the drives of CONFIG, to try it without a machine.

    An axis with a shipped drive profile gets a simulated drive of that type: how it starts moves, its
    function codes, limits and refusals. An axis with its own register map gets a plain drive, which moves
    when a position is written.

    It listens on the drives' local TCP addresses and makes serial ports that do not exist. If it also makes a
    controller's port, the controller opens the same path with .controller added. It runs until Ctrl-C.

    Drives with --hearing standard split a frame at a pause of 1.5 characters. any-length: they accept intact
    frames of any length. merging: as any-length, but only 10 ms of silence end a frame. no-check: they ignore
    the CRC.

    --gauge adds a laser for each linear axis, which shows the real position after the error of the worn
    screw. Its port works like a Sylvac gauge: use measure --gauge gauge-x, or type the printed readings into
    measure.

    Examples:
        pitch-gateway simulate gateway.toml
        pitch-gateway run gateway.toml            (in a second terminal)
        pitch-gateway simulate gateway.toml --speed-up 20 --seed 7
        pitch-gateway simulate gateway.toml --gauge
        pitch-gateway simulate gateway.toml --latency-timer 16 --hearing standard
    """
    from gateway.config.load import load
    from gateway.config.problems import ConfigErrors
    from gateway.simulator.errors import SimulatorError

    try:
        adapter = Adapter(latency_timer_ms, burst_bytes=burst_bytes, jitter_ms=jitter_ms, seed=seed)
        cable = Cable(adapter, WireFaults(noise=noise, seed=seed), _hearing(hearing))
        plan = load(config).plan
        _warn_of_what_is_not_played(config, plan)
        asyncio.run(_serve(plan, speed_up, seed, cable, paced=paced, gauge=gauge, json_output=json_output))
    except ConfigErrors as errors:
        typer.echo(str(errors), err=True)
        raise typer.Exit(1) from None
    except SimulatorError as error:
        typer.echo(f"{config}: {error}", err=True)
        raise typer.Exit(1) from None


def _warn_of_what_is_not_played(config: Path, plan: "GatewayPlan") -> None:
    """Report features of a register map that its plain simulated drive does not have."""
    from gateway.simulator.drives.catalogue import DRIVES

    for axis in (axis for line in plan.lines for axis in line.axes):
        motion = axis.motion
        if axis.drive in DRIVES or not (motion.waits_for_trigger or any(motion.modes)):
            continue
        typer.echo(
            f"warning: {config}: axis.{axis.name}: simulated by a plain drive that moves as soon as a "
            "position is written: modes, triggers and staged targets of its map do nothing; for these "
            "use a shipped profile (pitch-gateway drives)",
            err=True,
        )


def _hearing(name: str) -> "Hearing | None":
    from gateway.simulator.ears import Hearing
    from gateway.simulator.errors import SimulatorError

    kinds = {kind.value: kind for kind in Hearing}
    if name and name not in kinds:
        raise SimulatorError(f"--hearing {name}: it must be one of {', '.join(kinds)}")
    return kinds.get(name)


async def _serve(
    plan: "GatewayPlan",
    speed_up: float,
    seed: int,
    cable: Cable,
    *,
    paced: bool,
    gauge: bool,
    json_output: bool,
) -> None:
    from gateway.simulator.clock import scaled_clock
    from gateway.simulator.world import World

    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for signal_number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(signal_number, ended.set)
    async with World(plan, scaled_clock(speed_up), seed=seed, paced=paced, cable=cable) as world:
        gauges = world.add_gauges() if gauge else {}
        lasers = {each.axis: path for path, each in gauges.items()} if gauge else None
        found = _Serving(world.served, speed_up, seed, lasers)
        show(found, Format.JSON if json_output else Format.TEXT)
        await (ended.wait() if json_output else _show_until(ended, tuple(gauges.values())))


@dataclass(frozen=True, slots=True)
class _Serving:
    """The simulated drives and instruments."""

    served: "Sequence[ServedLine]"
    speed_up: float
    seed: int
    lasers: Mapping[str, str] | None
    """The port of each, by its axis; None: without."""

    def as_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        lines = [asdict(line) for line in self.served]
        found = {"event": "serving", "lines": lines, "speed_up": self.speed_up, "seed": self.seed}
        return found if self.lasers is None else {**found, "gauges": self.lasers}

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        for line in self.served:
            yield from _described(line)
        for axis, path in (self.lasers or {}).items():
            yield f"axis {axis}: a laser on {path}; read it with: measure --gauge {path}"
        yield "Ctrl-C ends it."


async def _show_until(ended: asyncio.Event, gauges: "tuple[VirtualGauge, ...]") -> None:
    """Print where axes come to rest, for typed readings."""
    from gateway.simulator.gauge import DISPLAY_EVERY_S, Display

    def print_reading(gauge: "VirtualGauge", reading: float) -> None:
        typer.echo(f"axis {gauge.axis} stopped; its laser shows {reading:.5f} {gauge.units}")

    displays = [Display(gauge, print_reading) for gauge in gauges]
    while not ended.is_set():
        for display in displays:
            display.update()
        with suppress(TimeoutError):
            await asyncio.wait_for(ended.wait(), DISPLAY_EVERY_S if displays else None)


def _described(line: "ServedLine") -> Iterator[str]:
    yield f"line {line.name}: drives on {line.address} ({line.kind})"
    for axis in line.axes:
        behaves = f", behaves as {axis.drive}" if axis.drive else ""
        backlash = f"{axis.backlash_um:g} µm of backlash"
        yield f"  axis {axis.name}: unit {axis.unit_id}, a worn screw, {backlash}{behaves}"
    for controller in line.controllers:
        opens = (
            "the gateway listens there"
            if controller.gateway_opens == controller.controller_opens
            else (f"the gateway opens {controller.gateway_opens}")
        )
        yield f"  controller {controller.name}: connect it to {controller.controller_opens} ({opens})"
