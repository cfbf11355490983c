"""Three regimes: a controller in a closed loop, and one that sends a command every 2 ms or every 10 ms.

In a closed loop all that an exchange touches is still in the caches of the processor. Pauses empty them: each
exchange of a controller with a period begins cold.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

from bench import machine
from bench.candidates import C_RELAY, COMPILED, DIRECT, GATEWAY, SOCAT, WHOLE_CANDIDATES
from bench.context import ANYWHERE, ON_ONE, Bench, Cpus
from bench.figures import Interval, Series, added_ratio, over_rounds, ratio
from bench.instructions import by_callgrind, callgrind_refusal, counted, counter_refusal
from bench.measuring import Load, Way, start_drive
from bench.processes import Processes, cpu_ns
from bench.results import Goal, Section, Table, latency_table

TITLE: Final = "Closed loop, every 2 ms, every 10 ms"
CLOSED, EVERY_2, EVERY_10 = "closed loop", "every 2 ms", "every 10 ms"
REST_S: Final = 5.0
"""For so long it is watched what the gateway does while nobody asks."""
GATEWAYS: Final = {COMPILED: "compiled", GATEWAY: "not compiled"}


@dataclass(frozen=True, slots=True)
class _Regime:
    """How often a controller asks. ``full`` and ``quick``: exchanges in a round; 0: as many as everywhere."""

    period_us: int
    full: int
    quick: int
    warmup: int

    def load(self, bench: Bench, cpus: Cpus) -> Load:
        count = bench.effort.of(self.full, self.quick) or bench.effort.count
        return Load(count, period_us=self.period_us, warmup=self.warmup, cpus=cpus)


REGIMES: Final = {
    CLOSED: _Regime(0, 0, 0, 500),
    EVERY_2: _Regime(2_000, 1_000, 200, 20),
    EVERY_10: _Regime(10_000, 200, 50, 10),
}


@dataclass(frozen=True)
class Found:
    """What was found in each regime: round trips, and the processor time of an exchange."""

    trips: Mapping[str, Series]
    costs: Mapping[str, Series]
    at_rest_us: Mapping[str, float]
    """Processor time of each candidate in a second in which nobody asks."""
    instructions: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Instructions of user mode of an exchange, by regime and candidate, as far as they could be counted."""


def run(bench: Bench) -> Section:
    """Measure all regimes, placed in both ways."""
    section = Section.of(
        TITLE,
        "A controller writes a position as soon as the last one is answered, every 2 ms, and every 10 ms. In "
        "the pauses caches forget what an exchange touches. The gateway is whole here: both processes, with "
        "the page that nobody looks at. *Added* is the median round trip minus the direct one of the same "
        "rounds. *Processor time* is that of all processes of the candidate, with what they do for "
        "themselves in the pauses; *at rest* is that alone, with nobody who asks.",
    )
    calls = machine.system_calls(bench.programs.calls, bench.processors.one)
    section.tables.append(Table(
        ("the machine's own system calls", "µs"),
        tuple((machine.SYSTEM_CALLS[name], f"{us:.2f}") for name, us in calls.items()),
    ))  # fmt: skip
    judged = _measured(bench, ON_ONE, bench.processors.one, bench.effort.rounds, counts=True)
    judged, how_counted = _counted(bench, judged)
    section.text.append(how_counted)
    free = _measured(bench, ANYWHERE, None, max(2, bench.effort.rounds // 2))
    for placement, found in ((ON_ONE, judged), (ANYWHERE, free)):
        section.tables += _tables(found, placement)
    section.goals += goals(judged, free, machine.system_calls_in_words(calls))
    return section


def goals(judged: Found, free: Found, calls: str) -> list[Goal]:
    """Compare with what the design asks for; ``free`` and ``calls`` are what the remarks tell."""

    def added(regime: str, name: str, limit: float) -> Goal:
        what = f"{regime}, whole gateway, {GATEWAYS[name]}: added median ÷ socat's"
        elsewhere = added_ratio(free.trips[regime], name, SOCAT)
        return Goal(
            what, limit, added_ratio(judged.trips[regime], name, SOCAT), remark=f"{ANYWHERE}: {elsewhere}"
        )

    def used(regime: str, name: str, limit: float) -> Goal:
        costs = judged.costs[regime]
        remark = f"the relay's in C: {_in_us(costs, C_RELAY)}; {calls}"
        return Goal("… processor time of an exchange, µs", limit, _in_us(costs, name), remark=remark)

    late, late_free = (ratio(found.trips[CLOSED], COMPILED, SOCAT, "p99") for found in (judged, free))
    return [
        added(CLOSED, COMPILED, 1.1),
        Goal("… p99 of the round trip ÷ socat's", 1.5, late, remark=f"{ANYWHERE}: {late_free}"),
        added(CLOSED, GATEWAY, 3.0),
        added(EVERY_2, COMPILED, 1.5),
        used(EVERY_2, COMPILED, 80.0),
        added(EVERY_2, GATEWAY, 3.5),
        used(EVERY_2, GATEWAY, 200.0),
    ]


def _measured(bench: Bench, placement: str, cpus: Cpus, rounds: int, *, counts: bool = False) -> Found:
    with Processes() as processes:
        drive = start_drive(processes, bench.programs, cpus=cpus)
        tools = bench.tools(cpus)
        ways: dict[str, Way] = {}
        for name, start in WHOLE_CANDIDATES.items():
            bench.say(f"{TITLE}: waiting for {name}")
            ways[name] = start(processes, tools, drive.ports[0])
            bench.meter.wait_until_serving(ways[name])
        trips: dict[str, Series] = {}
        costs: dict[str, Series] = {}
        for regime, how in REGIMES.items():
            load = how.load(bench, cpus)
            measures = {name: partial(bench.meter.run, way, load) for name, way in ways.items()}
            found = bench.interleaved(f"{regime}, {placement}", measures, rounds)
            trips[regime] = {name: [one.from_sent for one in of] for name, of in found.items()}
            costs[regime] = {name: [one.used for one in of] for name, of in found.items() if ways[name].pids}
        counted = _by_counter(bench, ways, cpus) if counts else {}
        return Found(trips, costs, _at_rest_us(bench, ways), counted)


def _by_counter(bench: Bench, ways: Mapping[str, Way], cpus: Cpus) -> dict[str, dict[str, float]]:
    """Count in rounds of their own: to switch a counter with its process takes time."""
    program = bench.programs.counter
    if counter_refusal(program):
        return {}
    bench.say(f"{TITLE}: counting instructions")
    found: dict[str, dict[str, float]] = {}
    for regime, how in REGIMES.items():
        load = how.load(bench, cpus)
        found[regime] = {
            name: counted(program, way.pids, partial(bench.meter.run, way, load)) / (load.count + load.warmup)
            for name, way in ways.items()
            if way.pids
        }
    return found


def _counted(bench: Bench, found: Found) -> tuple[Found, str]:
    """Count by callgrind what no counter has counted; returns it with a sentence about how."""
    if found.instructions:
        return found, "Instructions of user mode were counted by the processor, of all processes."
    why = f"The processor's counter of instructions cannot be had ({counter_refusal(bench.programs.counter)})"
    refusal = callgrind_refusal()
    if refusal:
        return found, f"{why}, nor callgrind ({refusal}): instructions were not counted."
    by_name: dict[str, float] = {}
    for name in GATEWAYS:
        bench.say(f"{TITLE}: counting instructions of {name} with callgrind")
        tools = bench.tools(bench.processors.one)
        by_name[name] = by_callgrind(bench.meter, tools, is_compiled=name == COMPILED)
    said = f"{why}: callgrind counted them, of the relay alone and in a closed loop, which it slows down."
    return replace(found, instructions={CLOSED: by_name}), said


def _at_rest_us(bench: Bench, ways: Mapping[str, Way]) -> dict[str, float]:
    rest_s = REST_S / bench.effort.of(1, 5)
    before = {name: sum(map(cpu_ns, way.pids)) for name, way in ways.items() if way.pids}
    time.sleep(rest_s)
    return {name: (sum(map(cpu_ns, ways[name].pids)) - ns) / 1000 / rest_s for name, ns in before.items()}


def _tables(found: Found, placement: str) -> list[Table]:
    names = [name for name in next(iter(found.trips.values())) if name != DIRECT]

    def beside(
        caption: str, cell: Callable[[str, str], str], more: Sequence[tuple[str, Sequence[str]]] = ()
    ) -> Table:
        rows = [
            (name, *(cell(regime, name) for regime in REGIMES), *(column[i] for _, column in more))
            for i, name in enumerate(names)
        ]
        return Table(("", *REGIMES, *(head for head, _ in more)), tuple(rows), f"{caption}, {placement}.")

    def used(regime: str, name: str) -> str:
        return str(_in_us(found.costs[regime], name)) if name in found.costs[regime] else ""

    def added(regime: str, name: str) -> str:
        return str(added_ratio(found.trips[regime], name, SOCAT))

    def late(regime: str, name: str) -> str:
        return str(ratio(found.trips[regime], name, SOCAT, "p99"))

    def taken(regime: str, name: str) -> str:
        number = found.instructions.get(regime, {}).get(name)
        return "" if number is None else f"{number:.0f}"

    at_rest = [f"{found.at_rest_us[name]:.0f}" if name in found.at_rest_us else "" for name in names]
    return [
        beside("Added median ÷ socat's", added),
        beside("p99 of the round trip ÷ socat's", late),
        beside("Processor time of an exchange, µs", used, [("at rest, µs a second", at_rest)]),
        *([beside("Instructions of user mode of an exchange", taken)] if found.instructions else []),
        *(
            latency_table(trips, caption=f"Writes of one position, {regime}, {placement}.")
            for regime, trips in found.trips.items()
        ),
    ]


def _in_us(costs: Series, name: str) -> Interval:
    return over_rounds({name: costs[name]}, lambda pick: pick(name, "p50") / 1000)
