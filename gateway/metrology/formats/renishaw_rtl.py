"""Renishaw .rtl, the export of a laser's linear measurement: targets in mm, deviations in µm.

Grammar, from public programs that read and write such files (Renishaw publishes none)::

    file    := section*                         a line "NAME::" in any case, then its lines; often CRLF
    HEADER::                                    "File type : rtl" and other lines of "key: fact"
    USER-TEXT::                                 "key: fact"
    TARGET DATA::                               "Filetype: ..", "Target-count: n", "Targets :", then n
                                                positions on lines of up to five, then "Flags: .."
    RUNS::                                      "Run-count: r"
    DEVIATIONS::                                "Run Target Data:", then r x n lines "run target deviation"
    ENVIRONMENT::, EQUIPMENT::                  free text
    EOF::

Run and target count from 1; a deviation is measured - target. Odd runs go one way, even runs the other. The
lines of a run are in the order of measurement, so runs in both orders prove their directions. If all runs
have one order, the file may be of one direction or sorted by a program: the directions must be given.

The same sections hold the angles of an .rta file, or straightness, in their own units: a ``File type`` other
than rtl is refused. A run of zeros only, beside other runs, is also refused: some programs write one in place
of a way back that was not measured.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.formats.cells import decimal
from gateway.metrology.formats.context import ReadingsContext, Runs, settled_axis, settled_units
from gateway.metrology.formats.rows import Row, to_survey
from gateway.metrology.readings import Survey
from gateway.tabfile.text import SourceLine, SourceText, shown, to_integer

NAME: Final = "renishaw-rtl"
TITLE: Final = "Renishaw .rtl, deviations in µm, direction kept"
_SECTION: Final = re.compile(r"(?i)([A-Z][A-Z -]*?)\s*::")
_SECTIONS: Final = (
    "HEADER",
    "TARGET DATA",
    "USER-TEXT",
    "RUNS",
    "DEVIATIONS",
    "ENVIRONMENT",
    "EQUIPMENT",
    "EOF",
)
_FACTS: Final = ("HEADER", "USER-TEXT")
_FREE: Final = ("ENVIRONMENT", "EQUIPMENT")
_LINEAR: Final = ("rtl", "linear")
_OTHER_KINDS: Final = re.compile(r"(?i)angular|straight|square|flat|rotary|dynamic")
_FEW_TARGETS: Final = 2
"""This many readings may all be 0 by chance."""
_MM_PER_UM: Final = 1e-3


@dataclass(slots=True)
class _File:
    targets: list[tuple[int, float]] = field(default_factory=list)
    target_count: tuple[int, int] | None = None
    run_count: tuple[int, int] | None = None
    """Line and number."""
    deviations: list[tuple[int, int, int, float]] = field(default_factory=list)
    """Line, run, target, deviation in µm."""
    facts: dict[str, str] = field(default_factory=dict)
    last_section: str = ""


def recognise(source: SourceText) -> bool:
    """Whether the text has the sections of such a file."""
    texts = [line.text for line in source.lines]
    return any(text.upper().startswith(("HEADER:", "TARGET DATA:", "DEVIATIONS:")) for text in texts)


def read(source: SourceText, context: ReadingsContext) -> Survey:
    """Read the file, each run with its direction.

    Raises:
        TabFileError: a line outside the grammar, counts that do not agree, a reading that is missing or
            repeated, runs without a proven direction.
    """
    file = _parse(source)
    unfinished = _check_end(source, file)
    count = len(file.targets)
    _check_count(source, "Target-count", file.target_count, count, "targets")
    runs = _runs(source, file)
    _check_count(source, "Run-count", file.run_count, len(runs), "runs")
    ways, remark = _ways(source, file, runs, context.runs)
    rows = []
    for number, lines in runs.items():
        # Each direction counts its own runs.
        run = sum(ways[other] is ways[number] for other in runs if other <= number)
        for line, target, deviation in lines:
            position = file.targets[target - 1][1]
            rows.append(Row(line, position, ways[number], run, position + deviation * _MM_PER_UM))
    units = settled_units(source, context, Units.MM)
    axis = settled_axis(source, context, file.facts.get("Axis"))
    return to_survey(source, rows, units, axis=axis, facts=file.facts, remarks=(*unfinished, *remark))


def _parse(source: SourceText) -> _File:
    file = _File()
    section, in_targets, in_deviations = "", False, False
    for line in source.lines:
        if not line.text:
            continue
        if found := _SECTION.fullmatch(line.text):
            section, in_targets, in_deviations = found.group(1).upper(), False, False
            if section not in _SECTIONS:
                raise source.error(
                    f"section {shown(line.text)}", ":: ".join(_SECTIONS) + "::", line=line.number
                )
            continue
        key, colon, fact = (part.strip() for part in line.text.partition(":"))
        if section in _FACTS and colon:
            if section == "HEADER" and key.casefold() == "file type" and fact.casefold() not in _LINEAR:
                raise source.error(
                    f"a file of type {shown(fact)}",
                    "rtl: a linear measurement, targets in mm and deviations in µm",
                    line=line.number,
                )
            file.facts.update({key: fact} if fact else {})
        elif section in _FREE or section in _FACTS:
            file.facts[section.lower()] = "; ".join(
                filter(None, (file.facts.get(section.lower()), line.text))
            )
        elif section == "TARGET DATA":
            in_targets = _target_line(source, file, line, in_targets=in_targets)
        elif section == "RUNS" and key == "Run-count":
            file.run_count = (line.number, _whole(source, line, fact, "Run-count"))
        elif section == "DEVIATIONS" and key == "Run Target Data" and not fact:
            in_deviations = True
        elif section == "DEVIATIONS" and in_deviations:
            file.deviations.append(_deviation(source, line))
        else:
            raise source.error(f"{shown(line.text)} in section {section or 'none'}", TITLE, line=line.number)
    file.last_section = section
    return file


def _check_end(source: SourceText, file: _File) -> list[str]:
    """Return the remarks about a file without its end mark.

    Raises:
        TabFileError: it ends among the deviations, so digits of the last one may be lost.
    """
    if file.last_section == "EOF":
        return []
    if file.last_section == "DEVIATIONS":
        raise source.error(
            "the end of the file among the deviations",
            "EOF:: as the last line: copy the file again, because it is cut short and digits of its last "
            "number may be lost; add the line only if you know that the file is complete",
            line=source.last_line,
        )
    return [f"{source.name}: no EOF:: at its end, so the file was cut short; all readings are there"]


def _target_line(source: SourceText, file: _File, line: SourceLine, *, in_targets: bool) -> bool:
    """Process a line of the target section; return whether positions may follow."""
    key, colon, fact = (part.strip() for part in line.text.partition(":"))
    if not colon and in_targets:
        file.targets.extend(
            (line.number, decimal(source, line.number, x, "target")) for x in line.text.split()
        )
        return True
    if key == "Target-count":
        file.target_count = (line.number, _whole(source, line, fact, "Target-count"))
    elif key == "Filetype":
        if _OTHER_KINDS.search(fact):
            raise source.error(f"a measurement of type {shown(fact)}", "a linear one", line=line.number)
        file.facts[key] = fact
    elif key == "Targets":
        file.targets.extend((line.number, decimal(source, line.number, x, "target")) for x in fact.split())
        return True
    elif key == "Flags":
        file.facts[key] = fact
    else:
        raise source.error(f"{shown(line.text)} among the targets", "positions in mm", line=line.number)
    return False


def _whole(source: SourceText, line: SourceLine, text: str, what: str) -> int:
    number = to_integer(text)
    if number is None or number < 1:
        raise source.error(f"{what} {shown(text)}", "a whole number above 0", line=line.number)
    return number


def _deviation(source: SourceText, line: SourceLine) -> tuple[int, int, int, float]:
    cells = line.text.split()
    if len(cells) != 3:
        raise source.error(f"{len(cells)} numbers", "3: run, target, deviation in µm", line=line.number)
    run, target = (
        _whole(source, line, cell, what) for cell, what in zip(cells, ("run", "target"), strict=False)
    )
    return line.number, run, target, decimal(source, line.number, cells[2], "deviation")


def _check_count(
    source: SourceText, name: str, stated: tuple[int, int] | None, found: int, what: str
) -> None:
    if stated is None:
        raise source.error(f"no {name}", f"{name}: {found}")
    if stated[1] != found:
        raise source.error(
            f"{name} {stated[1]}, but {found} {what}", f"{stated[1]} {what}: lines are lost", line=stated[0]
        )


def _runs(source: SourceText, file: _File) -> dict[int, list[tuple[int, int, float]]]:
    """Return (line, target, deviation) of each run, all targets in each."""
    count = len(file.targets)
    for (_, before), (_, middle), (line, after) in zip(
        file.targets, file.targets[1:], file.targets[2:], strict=False
    ):
        if (after - middle) * (middle - before) <= 0:
            raise source.error(
                f"target {after:.9g} after {middle:.9g}, out of order", "one order in all runs", line=line
            )
    runs: dict[int, list[tuple[int, int, float]]] = {}
    last_run = 0
    for line, run, target, deviation in file.deviations:
        if target > count:
            raise source.error(f"target {target}", f"1 to {count}", line=line)
        if run not in (last_run, last_run + 1):
            raise source.error(f"run {run} after run {last_run}", f"run {last_run + 1}", line=line)
        last_run = run
        runs.setdefault(run, []).append((line, target, deviation))
    for run, lines in runs.items():
        numbers = [target for _, target, _ in lines]
        missing = sorted(set(range(1, count + 1)) - set(numbers))
        if missing or len(numbers) != count:
            twice = sorted({number for number in numbers if numbers.count(number) > 1})
            found = f"no target {', '.join(map(str, missing))}" if missing else ""
            found += f"{' and ' if missing and twice else ''}" + (
                f"target {', '.join(map(str, twice))} twice" if twice else ""
            )
            raise source.error(f"run {run} has {found}", f"each of {count} targets once", line=lines[-1][0])
    _check_zeros(source, runs)
    return runs


def _check_zeros(source: SourceText, runs: dict[int, list[tuple[int, int, float]]]) -> None:
    zeros = [run for run, lines in runs.items() if not any(deviation for _, _, deviation in lines)]
    if 0 < len(zeros) < len(runs) and len(runs[zeros[0]]) > _FEW_TARGETS:
        raise source.error(
            f"only 0 in run {', '.join(map(str, zeros))}: check whether it was measured",
            "only measured runs: remove the lines of the others, number the rest without gaps, and give "
            "--runs forward or backward",
            line=runs[zeros[0]][0][0],
        )


def _ways(
    source: SourceText,
    file: _File,
    runs: dict[int, list[tuple[int, int, float]]],
    given: Runs | None,
) -> tuple[dict[int, Direction], list[str]]:
    """Return the direction of each run, and what the user should know about it."""
    rises = {run: _rises(source, [target for _, target, _ in lines]) for run, lines in runs.items()}
    up_the_list = len(file.targets) < 2 or file.targets[-1][1] > file.targets[0][1]
    if len(set(rises.values())) > 1:
        odd = [run for run in runs if rises[run] is not (run % 2 == 1)]
        if odd and len(odd) != len(runs):
            raise source.error(
                f"runs {', '.join(map(str, odd))} go the wrong way",
                "odd runs in one direction, even runs in the other",
            )
        if given is not None and given is not Runs.ALTERNATE:
            raise source.error(
                f"runs in both directions, but --runs is {given.value}", "--runs alternate, or no --runs"
            )
        ways = {run: _way(rise is up_the_list) for run, rise in rises.items()}
        note = "" if up_the_list else f"{source.name}: the targets descend, so odd runs are backward"
        return ways, [note] if note else []
    if given is None:
        raise source.error(
            f"{len(runs)} run(s), all with the same order of targets: this does not prove their directions",
            "--runs alternate (odd runs in the order of the targets, even runs back), forward or backward",
            line=file.run_count[0] if file.run_count else None,
        )
    if given is Runs.ALTERNATE:
        return {run: _way((run % 2 == 1) is up_the_list) for run in runs}, []
    return dict.fromkeys(runs, _way(given is Runs.FORWARD)), []


def _rises(source: SourceText, numbers: Sequence[int]) -> bool:
    steps = {after - before for before, after in pairwise(numbers)}
    if len(steps) > 1:
        raise source.error(
            f"targets in the order {', '.join(map(str, numbers[:12]))}",
            "always ascending or always descending",
        )
    return steps != {-1}


def _way(is_forward: bool) -> Direction:
    return Direction.FORWARD if is_forward else Direction.BACKWARD
