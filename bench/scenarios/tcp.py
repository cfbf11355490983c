"""Modbus/TCP in, Modbus/TCP out, on loopback: what each candidate adds to the round trip."""

from collections.abc import Sequence
from functools import partial
from typing import Final

from bench.candidates import (
    C_RELAY,
    COMPILED,
    DIRECT,
    GATEWAY,
    MODBUS_PROXY,
    PYMODBUS,
    SOCAT,
    TCP_CANDIDATES,
)
from bench.context import ANYWHERE, ON_ONE, Bench, Cpus
from bench.errors import BenchError
from bench.figures import Interval, Series, added, added_ratio, over_rounds, ratio
from bench.gateway_setup import COMMAND, COUNTS_PER_MM, forward_mm
from bench.measuring import Load, Way, holding, start_drive
from bench.processes import Processes
from bench.results import Bar, Goal, Section, Table, in_us, latency_table

TITLE: Final = "TCP to TCP"
PROOF_WRITES, PROOF_COUNTS = 1000, 50_000
"""After so many writes ``load`` is at this position, on the way up."""
OTHER_KINDS: Final = {
    "read": "Reads of four registers that hold no position",
    "cycle": "Write, read back (checked: it is what was written), read four registers, in turn",
}
"""Kinds of request beside the main one, measured with a quarter of the exchanges."""


def run(bench: Bench) -> Section:
    """Measure writes of a position that changes each time; and, shorter, other requests."""
    section = Section.of(
        TITLE,
        "A controller writes a 32-bit position that changes each time (function code 16), one request at a "
        "time. *Added* is the median round trip through the candidate minus the direct one of the same "
        "rounds. The gateway corrects the position from a table of 201 points, or has no table.",
    )
    judged, costs = _placed(bench, ON_ONE, bench.processors.one, section)
    free, _ = _placed(bench, ANYWHERE, None, section)
    section.goals += goals(judged, free, costs)
    section.bars += [Bar(name, _in_us(added(judged, name))) for name in judged if name != DIRECT]
    return section


def _placed(bench: Bench, placement: str, cpus: Cpus, section: Section) -> tuple[Series, Series]:
    """Measure one placement; returns the rounds of the main kind, and processor times of an exchange."""
    kinds = OTHER_KINDS if placement == ON_ONE else {}
    with Processes() as processes:
        drive = start_drive(processes, bench.programs, cpus=cpus)
        tools = bench.tools(cpus)
        ways = {name: start(processes, tools, drive.ports[0]) for name, start in TCP_CANDIDATES.items()}
        for name, way in ways.items():
            bench.say(f"{TITLE}: waiting for {name}")
            bench.meter.wait_until_serving(way)
            _prove(bench, name, way, drive.ports[0])
        series, costs = _series(bench, ways, Load(bench.effort.count, cpus=cpus))
        others = {
            kind: _series(bench, ways, Load(bench.effort.count // 4, kind=kind, cpus=cpus))[0]
            for kind in kinds
        }
        said = drive.stop()
    if said["bad_frames"] or said["exceptions"]:
        raise BenchError(f"the drive was sent what it refused: {said}")
    used = [str(_used(costs, name)) if ways[name].pids else "" for name in series]
    more = [("processor time of an exchange µs", used)]
    section.tables.append(_table(series, f"Writes of one position, {placement}.", more))
    section.tables += [_table(others[kind], f"{caption}, {placement}.") for kind, caption in kinds.items()]
    return series, costs


def _prove(bench: Bench, name: str, way: Way, drive: int) -> None:
    """See that a candidate does what it is measured for: with a table the drive gets corrected positions."""
    bench.meter.run(way, Load(PROOF_WRITES, warmup=0))
    nominal = PROOF_COUNTS
    has_table = name in {GATEWAY, COMPILED}
    wanted = nominal + (round(COUNTS_PER_MM * forward_mm(nominal / COUNTS_PER_MM)) if has_table else 0)
    found = holding(drive, COMMAND)
    if abs(found - wanted) > has_table:
        raise BenchError(f"{name}: the drive was told {found} counts where {wanted} are right")


def goals(judged: Series, free: Series, costs: Series) -> list[Goal]:
    """Compare with what the design asks for; ``free`` is what the remarks tell.

    ``costs`` are processor times of an exchange.
    """

    def goal(what: str, limit: float, of: str, to: str) -> Goal:
        remark = f"{ANYWHERE}: {added_ratio(free, of, to)}"
        return Goal(what, limit, added_ratio(judged, of, to), remark=remark)

    late, late_free = (ratio(series, COMPILED, SOCAT, "p99") for series in (judged, free))
    used = ratio(costs, COMPILED, C_RELAY)
    return [
        goal("TCP→TCP added median, compiled ÷ socat's", 1.0, COMPILED, SOCAT),
        Goal("… p99 of the round trip ÷ socat's", 1.5, late, remark=f"{ANYWHERE}: {late_free}"),
        Goal("… processor time of an exchange ÷ the relay's in C", 1.8, used),
        goal("… ÷ modbus-proxy's", 0.3, COMPILED, MODBUS_PROXY),
        goal("… ÷ a pymodbus forwarder's", 0.2, COMPILED, PYMODBUS),
        goal("TCP→TCP added median, not compiled ÷ socat's", 3.0, GATEWAY, SOCAT),
        goal("… ÷ modbus-proxy's", 0.3, GATEWAY, MODBUS_PROXY),
        goal("… ÷ a pymodbus forwarder's", 0.2, GATEWAY, PYMODBUS),
    ]


def _series(bench: Bench, ways: dict[str, Way], load: Load) -> tuple[Series, Series]:
    """Return round trips, and the processor time of an exchange where it is known whose it is."""
    rounds = bench.interleaved(
        f"{TITLE}, {load.kind}", {name: partial(bench.meter.run, way, load) for name, way in ways.items()}
    )
    trips = {name: [one.from_sent for one in found] for name, found in rounds.items()}
    return trips, {name: [one.used for one in found] for name, found in rounds.items()}


def _table(series: Series, caption: str, extra: Sequence[tuple[str, Sequence[str]]] = ()) -> Table:
    names = list(series)
    more = [in_us(added(series, name).estimate) if name != DIRECT else "" for name in names]
    to_socat = [str(added_ratio(series, name, SOCAT)) if name != DIRECT else "" for name in names]
    return latency_table(series, [("added µs", more), ("added ÷ socat's", to_socat), *extra], caption)


def _used(costs: Series, name: str) -> Interval:
    return _in_us(over_rounds({name: costs[name]}, lambda pick: pick(name, "p50")))


def _in_us(ns: Interval) -> Interval:
    return Interval(ns.estimate / 1000, ns.low / 1000, ns.high / 1000)
