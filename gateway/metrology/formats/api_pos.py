"""API ``.pos``, the linear measurement of an XD laser: target, laser, error, status and temperatures.

Grammar, from public files of version 5; tabs or blanks between the cells, often CRLF::

    file    := "API" .. "Linear Data Table" ..       first
               pair*                                 "key: fact", several on a line between tabs
               "Position LasRead LinearError Status" .. and three temperatures behind AirTemp and AirPress
               row*                                  as many numbers as the heading has names
               pair* table*                          results that the program computed from the rows
    short   := "API Linear Error Compensation Table"
               "Position" "Unidirectional Avg Error"
               (position error)*                     means, saved separately

``Unit`` is that of all lengths, ``inch`` or ``mm``. An error is measured - target: it must be the reading of
the laser less the position; the laser may count the other way. ``TestAxis`` is the axis, ``NumofPoints``
counts the rows and ``NumofPos`` the targets. Each run is ``NumofPos`` rows from one end to the other, so its
positions give its direction; ``TestType`` must agree. A row with a status other than 0 is one that the laser
marked as invalid.

Temperatures are in °F with inches, in °C with mm; a temperature below 0 and a missing sensor are both -1.
``ExpCoef`` is the program's setting for the material. No public file proves whether its errors are already
corrected to 20 °C. So the temperatures become facts about the measurement, not about the readings.

The short form states neither unit nor direction: both must be given. Other tables (both directions, angles,
straightness) were not available and are refused.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Final, NamedTuple

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.formats.cells import decimal
from gateway.metrology.formats.context import ReadingsContext, Runs, settled_axis, settled_units
from gateway.metrology.formats.rows import Row, to_survey
from gateway.metrology.readings import Survey
from gateway.tabfile.text import SourceLine, SourceText, shown, to_decimal, to_integer

NAME: Final = "api-pos"
TITLE: Final = "API .pos of an XD laser, direction from the order of the positions"
_FULL: Final = re.compile(r"API\b.*\bLinear Data Table\b.*")
_MEANS: Final = "API Linear Error Compensation Table"
_SHORT_HEADING: Final = ("Position", "Unidirectional", "Avg", "Error")
_HEADING: Final = ("Position", "LasRead", "LinearError", "Status")
_MATERIAL: Final = ("MatTemp", "MatTemp2", "MatTemp3")
_KEY: Final = re.compile(r"([A-Za-z][A-Za-z()/]*):\s*")
_AXIS: Final = re.compile(r"\(?([A-Za-z])\)?")
_UNITS: Final = {"inch": Units.INCH, "mm": Units.MM}
_STATUS: Final = {1: "warm up", 2: "path error", 3: "over speed", 4: "wireless error"}
_NO_SENSOR_BELOW: Final = 0.0
_AS_ROUNDED: Final = 2.0
"""Of the last digit: three rounded numbers may differ by this much."""
_NEAR_20_C: Final = 0.1


class _Stop(NamedTuple):
    """One row: a target and the laser's data for it."""

    line: int
    target: float
    laser: float
    error: float
    last_digit: float


@dataclass(frozen=True, slots=True)
class _File:
    facts: dict[str, tuple[str, int]]
    """The facts before the rows, each with its line."""
    stops: tuple[_Stop, ...]
    material: tuple[float, ...]
    """Temperatures of the material, in the unit of the file."""


def recognise(source: SourceText) -> bool:
    """Whether the first line is that of an API file, including the kinds that are not read."""
    return re.match(r"API\b.*\bTable\b", source.lines[0].text) is not None


def read(source: SourceText, context: ReadingsContext) -> Survey:
    """Read the file, each run with its direction.

    Raises:
        TabFileError: another kind of table, an invalid row, counts that do not agree, a row that contradicts
            itself or was marked invalid, runs that are not from one end to the other, no unit or no direction
            given if the file does not state it.
    """
    if source.lines[0].text == _MEANS:
        return _read_means(source, context)
    if _FULL.fullmatch(source.lines[0].text) is None:
        raise source.error(
            shown(source.lines[0].text),
            f"'API … Linear Data Table …' or {_MEANS!r}: other tables of this laser are not read",
            line=source.lines[0].number,
        )
    file = _parse(source)
    unit, line = _fact(source, file, "Unit")
    name = (unit.split() or [""])[0]
    if name not in _UNITS:
        raise source.error(f"Unit {shown(unit)}", "inch or mm", line=line)
    units = settled_units(source, context, _UNITS[name], line)
    _check_against_laser(source, file.stops)
    rows = tuple(_rows(source, file))
    axis = _AXIS.fullmatch(_fact(source, file, "TestAxis")[0].strip())
    return to_survey(
        source,
        rows,
        units,
        axis=settled_axis(source, context, axis[1] if axis else None),
        facts={key: fact for key, (fact, _) in file.facts.items() if fact},
        remarks=_about_temperature(source, file, units),
    )


def _parse(source: SourceText) -> _File:
    facts: dict[str, tuple[str, int]] = {}
    names: tuple[str, ...] = ()
    stops: list[_Stop] = []
    material: list[float] = []
    for line in source.lines[1:]:
        cells = line.text.split()
        if not names and tuple(cells[: len(_HEADING)]) == _HEADING:
            names = tuple(cells)
        elif not names:
            for key, fact in _pairs(line):
                before = facts.setdefault(key, (fact, line.number))
                if before[0] != fact:
                    raise source.error(
                        f"{key} {shown(fact)}, but {shown(before[0])} in line {before[1]}",
                        "only one of them",
                        line=line.number,
                    )
        elif not cells or to_decimal(cells[0]) is None:
            break
        else:
            stops.append(_stop(source, line, cells, names))
            material += [
                value
                for at, name in enumerate(names)
                if name in _MATERIAL
                and (value := decimal(source, line.number, cells[at], name)) > _NO_SENSOR_BELOW
            ]
    if not names:
        raise source.error(
            "no rows", f"{' '.join(_HEADING)} …, and a row for each stop: check that the file is complete"
        )
    return _File(facts, tuple(stops), tuple(material))


def _pairs(line: SourceLine) -> Iterator[tuple[str, str]]:
    parts = _KEY.split(line.text)
    for key, fact in zip(parts[1::2], parts[2::2], strict=True):
        yield key, " ".join(fact.split())


def _stop(source: SourceText, line: SourceLine, cells: Sequence[str], names: Sequence[str]) -> _Stop:
    if len(cells) != len(names):
        raise source.error(f"{len(cells)} numbers", f"{len(names)}: {' '.join(names)}", line=line.number)
    status = to_integer(cells[_HEADING.index("Status")])
    if status != 0:
        status_text = _STATUS.get(status or 0, "unknown")
        raise source.error(
            f"status {shown(cells[3])} ({status_text}): the laser marks this reading as not valid",
            "readings of status 0: measure this run again, or remove its rows and correct NumofPoints",
            line=line.number,
        )
    target, laser, error = (
        decimal(source, line.number, cell, name) for cell, name in zip(cells, _HEADING[:3], strict=False)
    )
    decimals = min(len(cell.partition(".")[2]) for cell in cells[1:3])
    return _Stop(line.number, target, laser, error, 10.0**-decimals)


def _fact(source: SourceText, file: _File, key: str) -> tuple[str, int]:
    if key not in file.facts:
        raise source.error(f"no {key}", f"{key} above the rows: check that the file is complete")
    return file.facts[key]


def _count(source: SourceText, file: _File, key: str, found: int, what: str) -> None:
    fact, line = _fact(source, file, key)
    if to_integer(fact) != found:
        raise source.error(
            f"{key} {fact}, but {found} {what}", f"{fact} {what}: check for lost or doubled lines", line=line
        )


def _check_against_laser(source: SourceText, stops: Sequence[_Stop]) -> None:
    """Check that each error is the laser's reading less the target, in one sense of counting."""
    senses = {
        sense: [
            stop
            for stop in stops
            if abs(sense * stop.laser - stop.target - stop.error) > _AS_ROUNDED * stop.last_digit
        ]
        for sense in (1, -1)
    }
    wrong = min(senses.values(), key=len)
    if wrong:
        stop = wrong[0]
        raise source.error(
            f"position {stop.target:.9g}, laser {stop.laser:.9g} and error {stop.error:.9g} do not agree",
            "the row as the laser's program wrote it: error = laser reading - position, with one counting "
            "direction in the whole file",
            line=stop.line,
        )


def _rows(source: SourceText, file: _File) -> Iterator[Row]:
    """Yield the readings, each run with its direction; each direction counts its own runs."""
    stops = file.stops
    count = len({stop.target for stop in stops})
    _count(source, file, "NumofPoints", len(stops), "rows")
    _count(source, file, "NumofPos", count, "targets")
    runs = [stops[at : at + count] for at in range(0, len(stops), count)]
    ways = [_way(source, run, count) for run in runs]
    kind, line = _fact(source, file, "TestType")
    both = len(set(ways)) > 1
    if not kind.startswith("Bidirection" if both else "Unidirection"):
        found = "both ways" if both else "one way"
        raise source.error(
            f"TestType {shown(kind)}, but the positions go {found}",
            "Unidirection with runs in one direction, Bidirection with runs in both",
            line=line,
        )
    for at, (way, run) in enumerate(zip(ways, runs, strict=True)):
        number = ways[: at + 1].count(way)
        for stop in run:
            yield Row(stop.line, stop.target, way, number, stop.target + stop.error)


def _way(source: SourceText, run: Sequence[_Stop], count: int) -> Direction:
    targets = [stop.target for stop in run]
    if len(targets) == count > 1:
        if targets == sorted(set(targets)):
            return Direction.FORWARD
        if targets == sorted(set(targets), reverse=True):
            return Direction.BACKWARD
    raise source.error(
        f"a run from {targets[0]:.9g} to {targets[-1]:.9g}, which does not go from one end to the other",
        f"runs of {count} positions, always ascending or always descending",
        line=run[0].line,
    )


def _about_temperature(source: SourceText, file: _File, units: Units) -> list[str]:
    """Return the temperature data of the laser's program, if they matter."""
    if not file.material:
        return []
    is_fahrenheit = units is Units.INCH
    mean = fmean(file.material)
    celsius = (mean - 32.0) / 1.8 if is_fahrenheit else mean
    if abs(celsius - 20.0) <= _NEAR_20_C:
        return []
    expansion = to_decimal(file.facts.get("ExpCoef", ("", 0))[0])
    expansion_text = ""
    if expansion is not None:
        per_kelvin = expansion * 1.8 if is_fahrenheit else expansion
        expansion_text = f", expansion {per_kelvin:.4g} µm per metre and kelvin"
    remark = (
        f"{source.name}: material at {celsius:.1f} °C{expansion_text}: check in the laser's program "
        "whether the readings are already normalised to 20 °C, before you normalise them; the file does "
        "not state it"
    )
    return [remark]


def _read_means(source: SourceText, context: ReadingsContext) -> Survey:
    """Read the short form: the means of one direction, which the context must give."""
    lines = [line for line in source.lines[1:] if line.text]
    if not lines or tuple(lines[0].text.split()) != _SHORT_HEADING:
        raise source.error(
            shown(lines[0].text if lines else ""),
            f"{' '.join(_SHORT_HEADING)!r}: give the whole file: its rows are read, also those of two "
            "directions",
            line=lines[0].number if lines else source.last_line,
        )
    if context.runs not in {Runs.FORWARD, Runs.BACKWARD}:
        raise source.error(
            "means of one direction, but the file does not state which",
            "--runs forward or backward, or the whole .pos file",
            line=lines[0].number,
        )
    units = settled_units(source, context, None, lines[0].number)
    way = Direction.FORWARD if context.runs is Runs.FORWARD else Direction.BACKWARD
    rows = []
    for line in lines[1:]:
        cells = line.text.split()
        if cells[0] == "API":
            break
        if len(cells) != 2:
            raise source.error(f"{len(cells)} numbers", "2: position and error", line=line.number)
        target, error = (decimal(source, line.number, cell, "number") for cell in cells)
        rows.append(Row(line.number, target, way, 1, target + error))
    return to_survey(source, rows, units, axis=settled_axis(source, context, None))
