"""The relay while all beside it works hard: tables that change, a dead broker, pages that are loaded."""

import json
import os
import sys
from dataclasses import dataclass
from functools import partial
from typing import Final

from bench.background import LAST_COMMAND_S
from bench.candidates import free_port
from bench.context import Bench
from bench.errors import BenchError
from bench.features import with_outputs
from bench.figures import Judged, Round, ratio
from bench.gateway_process import Gateway, gateway_command, start_gateway
from bench.gateway_setup import TABLE, Controller, GatewaySetup, LineSetup
from bench.measuring import Load, Way, start_drive
from bench.processes import LOGS, PATIENCE_S, Processes, line_from
from bench.results import Goal, Section, latency_table

TITLE: Final = "Under load"
POINTS: Final = 50_000
PAGES_PER_SECOND: Final = 100
ROUNDS: Final = 15
IDLE, LOADED = "idle", "loaded"
NAME: Final = "gateway-load"


@dataclass
class _Work:
    """What the load did in all rounds together."""

    counts: dict[str, int]

    def add(self, said: str) -> None:
        if not said:
            raise BenchError(f"the load did not say what it has done (see {LOGS})")
        for name, count in json.loads(said).items():
            self.counts[name] = self.counts.get(name, 0) + count


def run(bench: Bench) -> Section:
    """Measure p99.9 idle and loaded in turn."""
    section = Section(TITLE)
    work = _Work({})
    with Processes() as processes:
        drive = start_drive(processes, bench.programs, cpus=bench.processors.one)
        port = free_port()
        line = LineSetup((Controller(tcp_port=port),), drive_port=drive.ports[0])
        outputs = with_outputs(GatewaySetup((line,), points=POINTS))
        gateway = start_gateway(processes, NAME, outputs.setup, is_whole=True, cpus=bench.processors.one)
        way = Way.tcp(port)
        bench.meter.wait_until_serving(way)
        move_aside(bench, gateway)
        stand_in = not gateway.supervisor_pid
        command = gateway_command("check" if stand_in else "reload", gateway.config)
        words = [str(gateway.config.parent / "tables" / TABLE), str(POINTS), str(PAGES_PER_SECOND)]
        words += [outputs.page or "-", *command]
        measures = {
            IDLE: partial(_idle, bench, way),
            LOADED: partial(_loaded, bench, way, processes, words, work),
        }
        series = bench.interleaved(TITLE, measures, bench.effort.of(ROUNDS, 5))
    section.text += _text(bench, work, outputs.missing, stand_in=stand_in)
    section.tables.append(latency_table(series))
    what = "p99.9 under load ÷ idle"
    remark = f"without {', '.join(outputs.missing)}" if outputs.missing else ""
    section.goals.append(Goal(what, 1.3, ratio(series, LOADED, IDLE, "p999"), Judged.LOW, remark))
    return section


def move_aside(bench: Bench, gateway: Gateway) -> None:
    """Leave the relay its processor, as ``[relay] cpus`` does: the rest of the gateway goes off it.

    Also the process that starts a new supervisor when one has died: a child runs where its parent may.
    """
    supervisor, other = gateway.supervisor_pid, bench.processors.other
    if supervisor is not None and other is not None:
        for pid in (gateway.process.pid, supervisor):
            os.sched_setaffinity(pid, other)


def _load(bench: Bench) -> Load:
    return Load(bench.effort.of(60_000, 30_000), cpus=bench.processors.one)  # two tables or more in each


def _idle(bench: Bench, way: Way) -> Round:
    return bench.meter.run(way, _load(bench)).from_sent


def _loaded(bench: Bench, way: Way, processes: Processes, words: list[str], work: _Work) -> Round:
    command = [sys.executable, "-m", "bench.background", *words]
    process = processes.start("background", command, cpus=bench.processors.other, is_talking=True)
    line_from(process)
    found = bench.meter.run(way, _load(bench)).from_sent
    work.add(processes.stop(process, PATIENCE_S + LAST_COMMAND_S))
    return found


def _text(bench: Bench, work: _Work, missing: tuple[str, ...], *, stand_in: bool) -> list[str]:
    counts = work.counts
    what = (
        "Rounds without and with load in turn. Controller, drive and relay are on one processor, the load is "
        f"on the other. Load: a table of {POINTS} points replaced every second ({counts['tables']} times in "
        f"all), a broker that is not there, {PAGES_PER_SECOND} pages a second ({counts['pages']} loaded, "
        f"{counts['failed_pages']} failed)."
    )
    text = [what]
    if missing:
        text.append(f"This version of the gateway has no {' and no '.join(missing)} yet.")
    if stand_in:
        text.append(
            "It has no supervisor either: `pitch-gateway check`, which parses the table, was started "
            f"{counts['commands']} times in its place, once a second."
        )
    else:
        text.append(
            f"`pitch-gateway reload` was started {counts['commands']} times, once a second; the log tells of "
            f"{table_events()} events about tables."
        )
    if bench.processors.other is None:
        text.append("This machine has one processor: the load could not be kept away from the relay.")
    return text


def table_events() -> int:
    """Count the events about tables in the log of the gateway."""
    lines = (LOGS / f"{NAME}.log").read_text().splitlines()
    return sum('"event": "table' in line or '"event":"table' in line for line in lines)
