"""A command every 2 ms: how regularly it reaches the drive, and how late the reply can be."""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Final

from bench.candidates import DIRECT, GATEWAY, SOCAT, TCP_CANDIDATES, Start, Tools, free_port
from bench.context import Bench
from bench.figures import Round, Series, ratio
from bench.gateway_process import refusal, start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Load, Way, start_drive
from bench.places import BUILD
from bench.processes import Processes
from bench.realtime import make_fifo, realtime_refused
from bench.results import Goal, Section, latency_table

TITLE: Final = "A command every 2 ms"
PERIOD_US: Final = 2000
FIFO: Final = GATEWAY + ", fifo"
RELAY_PRIORITY: Final = 50
ENDS_PRIORITY: Final = 60
"""Controller and drive keep better time than what is measured; where that is allowed."""
QUIET, BUSY = "an idle machine", "a busy machine"
ROUNDS: Final = {QUIET: 3, BUSY: 5}
WARMUP: Final = 50
ENDLESS: Final = "while True: pass"


@dataclass(frozen=True)
class _Condition:
    """What was found on an idle or a busy machine: round trips, deviations from the period at the drive."""

    trips: Series
    spacings: Series


def run(bench: Bench) -> Section:
    """Measure round trips and spacings at the drive, on an idle and on a busy machine."""
    refused = realtime_refused(ENDS_PRIORITY)
    own = "" if refused else f"Controller and drive run with SCHED_FIFO {ENDS_PRIORITY} themselves. "
    section = Section.of(
        TITLE,
        "A position is written every 2 ms. A round trip counts from the moment at which the request was due, "
        "so that one that had to wait is not counted as a quick one. *Spacing* is how far two writes that "
        f"follow each other arrived at the drive from 2 ms apart. {own}Busy: as many endless loops as there "
        "are processors run beside all this, at the usual priority.",
    )
    if refused:
        section.text.append(f"This machine refuses real-time scheduling: {refused}.")
    found = {QUIET: _measured(bench, QUIET, refused), BUSY: _measured(bench, BUSY, refused)}
    for name, condition in found.items():
        section.tables.append(latency_table(condition.trips, caption=f"Round trips on {name}."))
        section.tables.append(latency_table(condition.spacings, caption=f"Spacing − 2 ms on {name}."))
    section.goals += _goals(found, refused)
    return section


def _goals(found: dict[str, _Condition], refused: str) -> list[Goal]:
    def of(pick: Callable[[_Condition], Series], what: str, share: str) -> Goal:
        series, quiet = pick(found[BUSY]), pick(found[QUIET])
        if FIFO not in series:
            return Goal(what, 0.4, None, remark=f"no real-time scheduling: {refused}")
        idle, without = ratio(quiet, FIFO, SOCAT, share), ratio(series, GATEWAY, SOCAT, share)
        remark = f"on {QUIET}: {idle}; without fifo: {without}"
        return Goal(what, 0.4, ratio(series, FIFO, SOCAT, share), remark=remark)

    # p99 too: interruptions by the host, which nobody's priority keeps away, hide p99.9 on a virtual machine.
    return [
        goal
        for name, share in (("p99.9", "p999"), ("p99", "p99"))
        for goal in (
            of(
                lambda one: one.trips,
                f"commands every 2 ms with `fifo`, busy machine: {name} of the round trip ÷ socat's",
                share,
            ),
            of(
                lambda one: one.spacings, f"… {name} of the deviation from 2 ms at the drive ÷ socat's", share
            ),
        )
    ]


def _measured(bench: Bench, condition: str, refused: str) -> _Condition:
    with Processes() as processes:
        starts: dict[str, Start] = {name: TCP_CANDIDATES[name] for name in (DIRECT, SOCAT, GATEWAY)}
        if not refused:
            starts[FIFO] = partial(_fifo_gateway, bench)
        priority = 0 if refused else ENDS_PRIORITY
        rigs = {name: _Rig(bench, processes, name, start, priority) for name, start in starts.items()}
        if condition == BUSY:
            for number in range(len(os.sched_getaffinity(0))):
                processes.start(f"busy-{number}", [sys.executable, "-c", ENDLESS])
        measures = {name: rig.measure for name, rig in rigs.items()}
        rounds = bench.effort.of(ROUNDS[condition], 2)
        pairs = bench.interleaved(f"{TITLE}, {condition}", measures, rounds)
    return _Condition(
        {name: [trip for trip, _ in found] for name, found in pairs.items()},
        {name: [spacing for _, spacing in found] for name, found in pairs.items()},
    )


def _fifo_gateway(bench: Bench, processes: Processes, _tools: Tools, drive: int) -> Way:
    """Start a gateway with ``[relay] fifo``; without such a key the bench sets it from outside."""
    cpus = bench.processors.one or ()
    port = free_port()
    line = LineSetup((Controller(tcp_port=port),), drive_port=drive)
    wanted = GatewaySetup((line,), fifo=RELAY_PRIORITY, cpus=cpus)
    has_key = not refusal(wanted)
    gateway = start_gateway(processes, "gateway-fifo", wanted if has_key else GatewaySetup((line,)))
    way = Way.tcp(port)
    bench.meter.wait_until_serving(way)
    if not has_key:
        make_fifo(gateway.relay_pid, RELAY_PRIORITY, cpus)
    return way


class _Rig:
    """One candidate in front of a drive of its own, which keeps when its writes arrived."""

    def __init__(self, bench: Bench, processes: Processes, name: str, start: Start, priority: int) -> None:
        self._bench = bench
        arrivals = BUILD / f"arrivals-{name.replace(' ', '-')}.bin"
        self._drive = start_drive(processes, bench.programs, arrivals=arrivals, fifo=priority)
        self._way = start(processes, bench.tools(None), self._drive.ports[0])
        self._load = Load(bench.effort.of(5000, 1000), period_us=PERIOD_US, warmup=WARMUP, fifo=priority)
        bench.meter.wait_until_serving(self._way)

    def measure(self) -> tuple[Round, Round]:
        """Return round trips, and deviations of the spacing at the drive from the period."""
        self._drive.arrivals()
        trips = self._bench.meter.run(self._way, self._load).by_due
        times = self._drive.arrivals()[WARMUP:]
        period_ns = PERIOD_US * 1000
        return trips, Round.of([abs(b - a - period_ns) for a, b in pairwise(times)])
