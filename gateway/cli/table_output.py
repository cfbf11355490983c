"""Output of ``pitch-gateway table``: rich tables for people, plain data for programs."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from gateway.metrology.evaluation import NAMES, Evaluation, missing_line, missing_of, title_of, values_of
from gateway.metrology.residue import LeftOut, left_out_line
from gateway.plain import JsonObject
from gateway.report.findings import other_stretch
from gateway.tabfile import LoadedTable, PositionExplanation, SourceRow
from gateway.tabfile.explanation import DirectionExplained

if TYPE_CHECKING:
    from rich.console import RenderableType

PREDICTED: Final = "predicted"
"""The title of figures that are not measured."""
PLAIN_WIDTH = 140
"""Columns of a rich table that does not go to a terminal."""


@dataclass(frozen=True, slots=True)
class TableShown:
    """A table with its points; a person sees the first ``limit`` of them, 0 for all."""

    loaded: LoadedTable
    limit: int

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        remarks = [lint.as_data() for lint in self.loaded.lints]
        return {**self._facts(), "lints": remarks, "rows": [row._asdict() for row in self.loaded.source.rows]}

    def lines(self) -> "Iterator[RenderableType]":
        """Yield it for a person."""
        for key, item in self._facts().items():
            if key not in ("decisions", "behaves_as") and item is not None:
                yield f"{key:15} {_plain(item)}"
        source = self.loaded.source
        unit, file_unit = self.loaded.table.units.value, source.value_unit
        rows = source.rows[: self.limit] if self.limit else source.rows
        headings = [f"position ({unit})", f"forward correction ({unit})", f"backward correction ({unit})"]
        headings += [f"forward file value ({file_unit})", f"backward file value ({file_unit})", "lines"]
        yield _table(headings, [_row_cells(row) for row in rows])
        if len(rows) < len(source.rows):
            yield f"{len(source.rows) - len(rows)} more points: --limit 0 shows all"
        yield from remarks(self.loaded)

    def _facts(self) -> JsonObject:
        """Return the data besides the points."""
        table, source = self.loaded.table, self.loaded.source
        return {
            "file": self.loaded.file,
            "format": self.loaded.format,
            "sha256": self.loaded.sha256,
            "units": table.units.value,
            "file_unit": source.value_unit,
            "axis": source.axis,
            "points": len(table.positions),
            "range": [table.first, table.last],
            "unidirectional": table.is_unidirectional,
            "max_correction": table.max_correction(),
            "max_reversal": table.max_reversal(),
            "max_slope": table.max_slope(),
            "forward_rule": source.forward_rule,
            "backward_rule": source.backward_rule,
            "decisions": list(source.decisions),
            "behaves_as": list(source.behaves_as),
        }


def explained(explanation: PositionExplanation) -> "Iterator[RenderableType]":
    """Yield for a person the effect of a table at one position."""
    loaded, table = explanation.loaded, explanation.loaded.table
    unit = table.units.value
    yield (
        f"{loaded.file}: {loaded.format}, {len(table.positions)} points from {table.first:g} to "
        f"{table.last:g} {unit}"
    )
    if explanation.outside:
        yield (
            f"{explanation.at:g} {unit} is outside the table, {explanation.outside.value} it: the axis's "
            "'outside' policy decides; hold (the default) gives the end values below"
        )
    ahead, back = explanation.forward, explanation.backward
    forward_cells = _direction_cells(loaded, ahead, is_forward=True)
    backward_cells = _direction_cells(loaded, back, is_forward=False)
    rows = [
        (label, one, other) for (label, one), (_, other) in zip(forward_cells, backward_cells, strict=True)
    ]
    headings = (
        f"at {explanation.at:g} {unit}",
        "forward (towards greater positions)",
        "backward (towards smaller positions)",
    )
    yield _table(headings, rows, right=False)
    yield from remarks(loaded)


def remarks(loaded: LoadedTable) -> Iterator[str]:
    """Yield the reader's decisions, the control's behaviour besides the table, and every lint."""
    yield from (f"decided: {decision}" for decision in loaded.source.decisions)
    yield from (f"to behave like its control, set for the axis: {line}" for line in loaded.source.behaves_as)
    yield from (lint.line_in(loaded.file) for lint in loaded.lints)


def _direction_cells(
    loaded: LoadedTable, direction: DirectionExplained, *, is_forward: bool
) -> list[tuple[str, str]]:
    unit, file_unit = loaded.table.units.value, loaded.source.value_unit
    ends = (direction.low, direction.high)
    values = [row.forward_value if is_forward else row.backward_value for row in ends]
    lines = [row.forward_line if is_forward else row.backward_line for row in ends]
    rows_there = [
        f"{row.position:g} ({f'line {line}' if line else 'not listed'})"
        for row, line in zip(ends, lines, strict=True)
    ]
    cells = [
        ("segment", " to ".join(rows_there[: 1 if direction.low is direction.high else 2])),
        ("file values there", " to ".join(f"{value:g}" for value in values)),
        ("file value here", _with_unit(direction.file_value, file_unit)),
        ("sign rule", direction.rule),
        ("added", f"{direction.correction:+.9g} {unit}"),
        ("corrected", f"{direction.corrected:.9g} {unit}"),
    ]
    if direction.counts is not None:
        cells.append(("counts", f"{direction.counts} (without correction {direction.nominal_counts})"))
    return cells


def _row_cells(row: SourceRow) -> Sequence[str]:
    lines = {line for line in (row.forward_line, row.backward_line) if line is not None}
    return (
        f"{row.position:.6g}",
        f"{row.forward:+.8f}",
        f"{row.backward:+.8f}",
        f"{row.forward_value:g}",
        f"{row.backward_value:g}",
        ", ".join(map(str, sorted(lines))) or "not listed",
    )


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]], *, right: bool = True) -> "RenderableType":
    from rich.table import Table
    from rich.text import Text

    table = Table()
    for heading in headings:
        table.add_column(Text(heading), justify="right" if right else "left")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    return table


def _with_unit(number: float, unit: str) -> str:
    return f"{number:.9g} {f'x {unit}' if unit[0].isdigit() else unit}"


def _plain(item: Any) -> str:
    if isinstance(item, list):
        return " to ".join(f"{part:g}" for part in item)
    return f"{item:.6g}" if isinstance(item, float) else str(item)


# --- results of readings ----------------------------------------------------------------------------------


def results_lines(
    before: Evaluation,
    after: Evaluation | None,
    titles: tuple[str, str],
    *,
    left_out: LeftOut | None = None,
) -> "Iterator[RenderableType]":
    """Yield the results for a person, with the share that is left; ``left_out`` is E between the points.

    A note says that the predicted figures are those at the targets.
    """
    from rich.table import Table

    unit = before.units.value
    shown_all = [each for each in (before, after) if each is not None]
    title = next((title_of(each) for each in shown_all if missing_of(each)), title_of(before))
    table = Table(title=f"{title}, {unit}", title_justify="left")
    table.add_column("result")
    shown = [(titles[0], values_of(before))] + ([(titles[1], values_of(after))] if after else [])
    is_predicted = PREDICTED in titles
    for title, _ in shown:
        where = "\nat targets" if title == PREDICTED else "\n" * is_predicted
        for way in ("forward", "backward", "both"):
            table.add_column(f"{title}{where}\n{way}", justify="right")
    if after:
        table.add_column("left", justify="right")
    comparable = after is None or not other_stretch(before, after)
    digits = 6 if unit == "inch" else 5
    for name, description in NAMES:
        numbers = [value for _, values in shown for value in values[name]]
        cells = ["–" if number is None else f"{round(number, digits) + 0.0:.{digits}f}" for number in numbers]
        left = _left(numbers, 0.5 * 10**-digits)
        table.add_row(f"{name}  {description}", *cells, *(left if comparable else ("–" for _ in left)))
        if name == "E" and is_predicted:
            table.add_row(*_between_row(before, left_out, digits))
    yield table
    yield from filter(None, dict.fromkeys(missing_line(each) for each in shown_all))
    if left_out is not None:
        yield left_out_line(before, left_out)


def _between_row(before: Evaluation, left_out: LeftOut | None, digits: int) -> list[str]:
    """Return the row for the predicted error between the targets."""
    if left_out is None or left_out.unsettled:
        shown, left = "not known", ["–"]
    elif left_out.e is None:
        shown, left = f"≥ {left_out.low:.{digits}f}", ["–"]
    else:
        shown = f"{left_out.e:.{digits}f}"
        left = list(_left([None, None, before.systematic, None, None, left_out.e], 0.5 * 10**-digits))
    return ["E  between the targets", "", "", "–", "", "", shown, *left]


def _left(numbers: list[float | None], least: float) -> Iterator[str]:
    """Yield the remaining share of the result of both directions; a result of 0 has no share."""
    if len(numbers) > 3:
        was, now = numbers[2], numbers[5]
        yield "–" if was is None or now is None or abs(was) < least else f"{abs(now) / abs(was):.0%}"
