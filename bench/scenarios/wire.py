"""RTU on wires with a baud rate: measured beside what arithmetic says."""

from contextlib import ExitStack, closing
from functools import partial
from operator import attrgetter
from statistics import median
from typing import Final

from bench.candidates import DIRECT, GATEWAY, Cable, gateway_on_ptys
from bench.context import Bench
from bench.figures import Interval, Round, Series, over_rounds
from bench.gateway_process import has_command
from bench.gateway_setup import Controller, GatewaySetup, LineSetup, write_setup
from bench.measuring import Load, Way, start_drive
from bench.places import BUILD
from bench.processes import Processes
from bench.results import Section, Table
from bench.serial_times import Budget, budget_of, round_trip_ns
from gateway.simulator.pty import Pty

TITLE: Final = "RTU on serial wires"
BAUDRATES: Final = (9600, 38400, 115200)
ROUNDS: Final = 5
WIRES: Final = {DIRECT: 1, GATEWAY: 2}


def run(bench: Bench) -> Section:
    """Measure writes of one position at three baud rates."""
    section = Section.of(
        TITLE,
        "Writes of one position (13 characters) and their replies (8 characters) of ten bits, on "
        "wires between pseudo terminals: one wire directly, two with the gateway between them, "
        "which hands on whole frames. *Wire* is arithmetic: characters × bits ÷ baud rate × wires. *Above "
        "it* is what was measured beyond that: the programs, and the wires' own timers (a process in C for "
        "each wire). *Beyond two wires* is the round trip through the gateway minus twice the "
        "direct one. *Budget* is what `pitch-gateway budget` computes for the same exchange, with the time "
        "that it reckons for the gateway itself.",
    )
    rows: list[tuple[str, ...]] = []
    for baudrate in BAUDRATES:
        series, budget = _series(bench, baudrate)
        rows += [_row(baudrate, name, series, budget) for name in series]
    heads = ("", "wire ms", "p50 ms", "p99 ms", "above it µs", "beyond two wires µs", "`budget` ms")
    section.tables.append(Table(heads, tuple(rows)))
    if not has_command("budget"):
        section.text.append("This version of the gateway has no `budget` command yet.")
    return section


def _row(baudrate: int, name: str, series: Series, budget: Budget | None) -> tuple[str, ...]:
    wire_ns = round_trip_ns(baudrate, WIRES[name])
    above = over_rounds({name: series[name]}, lambda pick: (pick(name, "p50") - wire_ns) / 1e3)
    beyond = over_rounds(series, lambda pick: (pick(name, "p50") - 2 * pick(DIRECT, "p50")) / 1e3)
    says = attrgetter("direct_ms" if name == DIRECT else "through_ms")
    p50, p99 = (median([getattr(one, share) for one in series[name]]) / 1e6 for share in ("p50", "p99"))
    return (
        f"{baudrate} baud, {name}", f"{wire_ns / 1e6:.3f}", f"{p50:.3f}", f"{p99:.3f}", _whole(above),
        _whole(beyond) if name != DIRECT else "", "" if budget is None else f"{says(budget):.3f}",
    )  # fmt: skip


def _whole(found: Interval) -> str:
    return f"{found.estimate:.0f} [{found.low:.0f}, {found.high:.0f}]"


def _series(bench: Bench, baudrate: int) -> tuple[Series, Budget | None]:
    with ExitStack() as stack:
        processes = stack.enter_context(Processes())

        def wire() -> Cable:
            cable = Cable(stack.enter_context(closing(Pty())), stack.enter_context(closing(Pty())))
            fds = (cable.near.master_fd, cable.far.master_fd)
            command = [str(bench.programs.wire), *map(str, (baudrate, *fds))]
            processes.start(f"wire-{baudrate}", command, fds=fds, is_talking=True)
            return cable

        direct, near, far = wire(), wire(), wire()
        # The gateway's ports: the far end of the controller's wire, the near end of the drive's.
        middle = Cable(near.far, far.near)
        gateway_on_ptys(baudrate=baudrate)(processes, bench.tools(None), middle)
        drives = [f"tty:{direct.far.path}", f"tty:{far.far.path}"]
        start_drive(processes, bench.programs, drives)
        ways = {DIRECT: Way.tty(direct.near.path), GATEWAY: Way.tty(near.near.path)}
        count = bench.effort.of(60, 20) * (1 if baudrate < 20_000 else 4)
        load = Load(count, warmup=2)

        def measure(way: Way) -> Round:
            return bench.meter.run(way, load).from_sent

        for way in ways.values():
            bench.meter.wait_until_serving(way)
        measures = {name: partial(measure, way) for name, way in ways.items()}
        rounds = bench.effort.of(ROUNDS, 2)
        return bench.interleaved(f"{TITLE}, {baudrate} baud", measures, rounds), _budget(baudrate, middle)


def _budget(baudrate: int, middle: Cable) -> Budget | None:
    line = LineSetup((Controller(tty=middle.near.path),), drive_tty=middle.far.path, baudrate=baudrate)
    return budget_of(write_setup(BUILD / "setups" / "budget", GatewaySetup((line,))))
