"""Memory of the relay: without tables, per point of a table, and over very many connections."""

from statistics import median
from typing import Final

from bench.candidates import free_port
from bench.context import Bench
from bench.figures import Interval, Judged
from bench.gateway_process import Gateway, start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Load, Way, start_drive
from bench.processes import Processes, resident_bytes
from bench.results import Goal, Section, Table

TITLE: Final = "Memory of the relay"
SMALL, LARGE = 10_000, 300_000
"""Points of two tables; a point costs what the second needs more."""
MIB: Final = 2**20
STARTS: Final = 3
STEPS: Final = 10
GROWTH_LIMIT: Final = 1.0
"""Bytes per connection, measured over all of them, that still count as no growth: a page of 4096 bytes more
for every 4096 connections is the allocator's."""


def run(bench: Bench) -> Section:
    """Measure what stays in RAM."""
    section = Section(
        TITLE, ["Resident memory (RSS) of the process that carries the traffic, after some traffic."]
    )
    sizes: dict[int, list[int]] = {0: [], SMALL: [], LARGE: []}
    command = ""
    for _ in bench.rounds(TITLE, STARTS):
        for points, found in sizes.items():
            size, command = _resident(bench, points)
            found.append(size)
    bare = _spread([size / MIB for size in sizes[0]])
    per_point = _spread([
        (large - small) / (LARGE - SMALL) for small, large in zip(sizes[SMALL], sizes[LARGE], strict=True)
    ])  # fmt: skip
    section.text.append(f"Started as `{command}`, {STARTS} times.")
    section.tables.append(Table(("", "RSS MiB"), (
        *((_named(points), f"{median(found) / MIB:.1f}") for points, found in sizes.items()),
        ("bytes a point", f"{per_point.estimate:.1f}"),
    )))  # fmt: skip
    section.goals += [
        Goal("RSS of the relay without tables, MiB", 33.0, bare),
        Goal(
            "bytes a point of a table",
            24.0,
            per_point,
            Judged.LOW,
            "memory comes in pages: lowest of all starts",
        ),
        _connections(bench, section),
    ]
    return section


def _spread(values: list[float]) -> Interval:
    """Median and range of a few starts."""
    return Interval(median(values), min(values), max(values))


def _named(points: int) -> str:
    return f"table of {points} points" if points else "no table"


def _exactly(value: float) -> Interval:
    return Interval(value, value, value)


def _resident(bench: Bench, points: int) -> tuple[int, str]:
    with Processes() as processes:
        way, gateway = _gateway(bench, processes, points)
        bench.say(f"{TITLE}: {points} points")
        bench.meter.run(way, Load(2000))
        return resident_bytes(gateway.relay_pid), f"pitch-gateway {gateway.command} CONFIG"


def _connections(bench: Bench, section: Section) -> Goal:
    total = bench.effort.of(1_000_000, 100_000)
    step = total // STEPS
    sizes: list[int] = []
    seconds = 0.0
    with Processes() as processes:
        way, gateway = _gateway(bench, processes, 0)
        for _ in bench.rounds(f"{TITLE}, {total} connections", STEPS):
            seconds += bench.meter.run(way, Load(step, warmup=0, is_reconnecting=True)).seconds
            sizes.append(resident_bytes(gateway.relay_pid))
    growth = (sizes[-1] - sizes[0]) / (total - step)
    cells = tuple((f"{(i + 1) * step}", f"{size / MIB:.2f}") for i, size in enumerate(sizes))
    caption = (
        f"{total} connections, one after the other, one exchange each: {total / seconds:.0f} in a second."
    )
    section.tables.append(Table(("connections", "RSS MiB"), cells, caption))
    what = f"growth over {total} connections, bytes each (from the first tenth to the last)"
    return Goal(what, GROWTH_LIMIT, _exactly(growth))


def _gateway(bench: Bench, processes: Processes, points: int) -> tuple[Way, Gateway]:
    drive = start_drive(processes, bench.programs)
    port = free_port()
    setup = GatewaySetup((LineSetup((Controller(tcp_port=port),), drive_port=drive.ports[0]),), points=points)
    gateway = start_gateway(processes, f"gateway-memory-{points}", setup)
    way = Way.tcp(port)
    bench.meter.wait_until_serving(way)
    return way, gateway
