"""Cut-through between two serial wires, in simulated time and in real: what is added, and what is torn."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from bench.context import Bench
from bench.cut_damage import HEARINGS, Damage
from bench.cut_line import Found, Way, shares
from bench.cut_line import run as run_way
from bench.figures import Interval
from bench.results import Goal, Section, Table
from bench.scenarios import cut_ptys
from gateway.simulator.wire import Adapter

TITLE: Final = "Cut-through between two serial wires"
MILLISECOND: Final = Adapter(latency_timer_ms=1.0)
FIFO: Final = Adapter(quiet_characters=4.0, burst_bytes=8)
WAYS: Final = {
    "9 600 Bd": (Way(9_600), 0.4),
    "19 200 Bd": (Way(19_200), 0.4),
    "38 400 Bd, lumps of 1 ms": (Way(38_400, adapter=MILLISECOND), 0.6),
    "38 400 Bd": (Way(38_400), None),
    "38 400 Bd, lumps of 8 characters": (Way(38_400, adapter=FIFO), None),
    "115 200 Bd": (Way(115_200), None),
    "9 600 Bd in front, 19 200 Bd behind": (Way(9_600, 19_200), None),
    "19 200 Bd in front, 9 600 Bd behind": (Way(19_200, 9_600), None),
    "9 600 Bd, lumps of 16 ms": (Way(9_600, adapter=Adapter(latency_timer_ms=16.0)), None),
}
"""Each with what is to be reached; None: no worse than stored."""
BUSY: Final = Way(9_600, adapter=Adapter(jitter_ms=0.3), late_ms=0.2)
NO_WORSE: Final = 0.005
"""Of a round trip: what two runs may differ by where the line stores anyway."""


def run(bench: Bench) -> Section:
    """Measure all ways, with and without; then jitter, then damage."""
    section = Section.of(
        TITLE,
        "Real exchange, decoders and forwarders between simulated wires of 11 bits for a character, with a "
        "drive that knows the end of a frame by silence. A controller writes a setpoint (13 + 8 characters) "
        "and reads position and status (8 + 11) in turns. What is added is the median exchange less the "
        "direct one, divided by the characters of one direct round trip. Time is simulated: the gateway's "
        "own computing, microseconds, is not in it.",
    )
    count = bench.effort.of(4_000, 600)
    rows = []
    for name, (way, limit) in WAYS.items():
        bench.say(f"cut-through: {name}")
        stored = shares(way, run_way(replace(way, cuts=False), count)[0])
        cut = shares(way, run_way(way, count)[0])
        rows.append((name, *(f"{share:.3f}" for share in (*stored, *cut))))
        for what, before, found in zip(("write", "read"), stored, cut, strict=True):
            said = "" if limit is not None else "stored, and what two runs may differ by"
            most = before + NO_WORSE if limit is None else limit
            goal = f"cut-through, {what}, {name}: added ÷ one direct round trip"
            section.goals.append(Goal(goal, most, Interval(found, found, found), remark=said))
    columns = ("", "stored, write", "stored, read", "cut through, write", "cut through, read")
    section.tables.append(Table(columns, tuple(rows), "Added ÷ one direct round trip."))
    section.goals += _busy(bench)
    cut_ptys.add_to(section, bench)
    return section


def _busy(bench: Bench) -> Iterator[Goal]:
    bench.say("cut-through: jitter")
    count = bench.effort.of(20_000, 1_000)
    found = run_way(BUSY, count)[0]
    yield _none(f"cut-through, jitter of 0.3 ms and late timers, {count} exchanges: frames torn", found.torn)
    yield _none("the same: frames that a drive took and nobody sent", found.foreign)
    for hearing, found in _damaged_lines(bench):
        what = f"cut-through, {found.damaged} damaged requests through the line, {hearing} drive"
        yield _none(f"{what}: frames taken that nobody sent whole", found.foreign + found.forged)
    bench.say("cut-through: damage")
    damage = Damage(38_400, 1)
    while damage.damaged < bench.effort.of(100_000, 5_000):
        damage.frame()
    what = f"cut-through, {damage.damaged} damaged frames of every kind, three kinds of drives"
    yield _none(f"{what}: frames taken that nobody sent whole", damage.foreign + damage.forged)


def _damaged_lines(bench: Bench) -> Iterator[tuple[str, Found]]:
    for hearing in HEARINGS:
        bench.say(f"cut-through: damage, {hearing.value}")
        way = Way(38_400, hearing=hearing)
        yield hearing.value, run_way(way, bench.effort.of(10_000, 600), 0.25)[0]


def _none(what: str, number: int) -> Goal:
    return Goal(what, 0.0, Interval(number, number, number))
