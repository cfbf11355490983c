"""The whole bench: ``python -m bench.run`` (``make bench``), or ``--quick`` (``make bench-quick``).

Builds its programs, runs every scenario, prints what it found and writes ``results.md`` with a chart. Ctrl-C
stops everything that was started; what was measured until then is in ``build/so-far.json``.
"""

import argparse
import dataclasses
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from bench import machine, report
from bench.building import build_programs, compared_python, compiled_package
from bench.context import Bench, Effort, Processors, Progress
from bench.errors import BenchError
from bench.measuring import Meter
from bench.places import BENCH, BUILD, CHART, NOTES, RESULTS
from bench.processes import stop_on_signals
from bench.results import Goal, Section
from bench.scenarios import cut, hot, load, memory, period, regimes, rtu, scale, supervisor, tcp, wire

SO_FAR: Final = BUILD / "so-far.json"
"""The sections of a run that has not come to its end, if it has measured any."""
SCENARIOS: Final[dict[str, Callable[[Bench], Section]]] = {
    "hot": hot.run,
    "tcp": tcp.run,
    "regimes": regimes.run,
    "rtu": rtu.run_rtu,
    "tcp-rtu": rtu.run_mixed,
    "wire": wire.run,
    "cut": cut.run,
    "period": period.run,
    "memory": memory.run,
    "scale": scale.run,
    "load": load.run,
    "supervisor": supervisor.run,
}


def main() -> int:
    """Run what the command line asks for.

    Exit codes: 0 measured (whatever the verdicts), 1 something could not be, 2 wrong usage, 130 Ctrl-C.
    """
    options = _options()
    stop_on_signals()
    say = Progress()
    try:
        sections, facts, python = _measured(options, say)
    except BenchError as error:
        say.end()
        sys.stderr.write(f"{error}\n")
        return 1
    except KeyboardInterrupt:
        say.end()
        sys.stderr.write(f"stopped; what was measured until then, if anything, is in {SO_FAR}\n")
        return 130
    say.end()
    sys.stdout.write(report.terminal(sections))
    if options.json is not None:
        text = json.dumps(_plain(sections, facts), indent=1, ensure_ascii=False)
        options.json.write_text(text + "\n")
    folder: Path = options.to
    folder.mkdir(parents=True, exist_ok=True)
    chart = _draw(sections, python, folder / CHART.name)
    notes = NOTES.read_text() if NOTES.exists() else ""
    (folder / RESULTS.name).write_text(report.markdown(sections, facts, notes, chart))
    sys.stdout.write(f"\nwritten: {folder / RESULTS.name}{f', {chart}' if chart else ''}\n")
    return 0 if all(section.is_measured for section in sections) else 1


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.run", description=__doc__.split("\n\n")[0])
    parser.add_argument(
        "--quick", action="store_true", help="a few minutes, wide intervals; results go to bench/build"
    )
    parser.add_argument("--only", metavar="NAMES", help=f"some of, with commas: {', '.join(SCENARIOS)}")
    parser.add_argument("--rounds", type=int, help="rounds of the scenarios that have no number of their own")
    parser.add_argument("--count", type=int, help="exchanges in a round")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures there as well")
    parser.add_argument("--to", type=Path, metavar="FOLDER", help="where results.md and the chart go")
    options = parser.parse_args()
    options.names = options.only.split(",") if options.only else list(SCENARIOS)
    unknown = [name for name in options.names if name not in SCENARIOS]
    if unknown:
        parser.error(f"--only {','.join(unknown)}: no such scenario; there are {', '.join(SCENARIOS)}")
    if options.rounds is not None and options.rounds < 2:
        parser.error("--rounds: at least 2, an interval needs them")
    if options.to is None:
        # A quick or a partial run must not pass for the results of all.
        options.to = BUILD if options.quick or options.only else BENCH
    return options


def _measured(
    options: argparse.Namespace, say: Callable[[str], None]
) -> tuple[list[Section], machine.Facts, Path]:
    effort = Effort.quick() if options.quick else Effort()
    effort = replace(effort, rounds=options.rounds or effort.rounds, count=options.count or effort.count)
    BUILD.mkdir(exist_ok=True)
    say("building")
    programs, python, compiled = build_programs(), compared_python(say), compiled_package(say)
    SO_FAR.unlink(missing_ok=True)
    disturbance = machine.Disturbance()
    bench = Bench(programs, python, compiled, Meter(programs), effort, Processors.of_this_machine(), say)
    sections: list[Section] = []
    for name in options.names:
        say(f"{name}: begins")
        try:
            sections.append(SCENARIOS[name](bench))
        except BenchError as error:  # the others can still be measured
            say(f"{name}: {error}\n")
            unmeasured = Goal(f"scenario `{name}`", 0.0, None, remark="could not be measured, see below")
            sections.append(
                Section(name, [f"Could not be measured: {error}"], goals=[unmeasured], is_measured=False)
            )
        SO_FAR.write_text(json.dumps(_plain(sections, []), indent=1, ensure_ascii=False) + "\n")
    calls = machine.system_calls(programs.calls, bench.processors.one)
    own = [("its own system calls", machine.system_calls_in_words(calls))]
    facts = machine.machine() + own + machine.versions(python) + machine.how_and_when() + disturbance.facts()
    return sections, facts, python


def _plain(sections: Sequence[Section], facts: machine.Facts) -> dict[str, Any]:
    plain = [dataclasses.asdict(section) for section in sections]
    for section, found in zip(plain, sections, strict=True):
        for goal, with_verdict in zip(section["goals"], found.goals, strict=True):
            goal |= {"judged": goal["judged"].value, "verdict": with_verdict.verdict.name.lower()}
    return {"facts": dict(facts), "sections": plain}


def _draw(sections: Sequence[Section], python: Path, where: Path) -> str:
    """Draw the chart; returns the name of the picture, empty where there is nothing to draw."""
    drawn = next((section for section in sections if section.bars), None)
    if drawn is None:
        return ""
    bars = [dataclasses.asdict(bar) for bar in drawn.bars]
    figures = BUILD / "chart.json"
    figures.write_text(
        json.dumps({"title": f"{drawn.title}: what each candidate adds to writing a position", "bars": bars})
    )
    command = [str(python), str(BENCH / "chart.py"), str(figures), str(where)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BenchError(f"the chart cannot be drawn:\n{done.stderr}")
    return where.with_suffix(".svg").name


if __name__ == "__main__":
    sys.exit(main())
