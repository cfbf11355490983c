"""The tables of an HTML report: results of ISO 230-2, how they were measured, the points of the table."""

from html import escape
from typing import Final

from gateway.metrology.evaluation import Evaluation, missing_of
from gateway.report.findings import FIGURES, Figure, Findings, about_readings
from gateway.report.words import GAP, NONE, number, shortest

MOST_ROWS: Final = 1000
"""Points that are listed. Longer tables are for programs, and in their file."""
ISO_PLACES: Final = 2
POINT_PLACES: Final = 2


def results_table(found: Findings) -> str:
    """Return the results before and after, empty where nothing was measured."""
    columns = _columns(found)
    if not columns:
        return ""
    heads = "".join(f'<th scope="col">{word}</th>' for word, _ in columns)
    if found.before is not None and found.after is not None:
        heads += '<th scope="col">left over</th>'
    rows = ""
    for figure in FIGURES:
        rows += _row(found, figure, [each for _, each in columns])
        if (figure.symbol, figure.direction) == ("E", "backward"):
            rows += _between_row(found, len(columns))
    return (
        '<div class="wide"><table class="results">\n'
        f"<caption>Results {escape(_title(found))}, in {escape(found.scale.deviation)}</caption>\n"
        f'<thead><tr><th scope="col">quantity</th>{heads}</tr></thead>\n'
        f"<tbody>\n{rows}</tbody>\n</table></div>\n"
    )


def _title(found: Findings) -> str:
    """Return what the figures may be called: the standard's own name only where nothing is missing."""
    missing = any(missing_of(each) for each in (found.before, found.after) if each is not None)
    return "by the formulas of ISO 230-2" if missing else "after ISO 230-2"


def _columns(found: Findings) -> list[tuple[str, Evaluation]]:
    word = "after"
    if found.story.is_predicted:
        word = 'after, <span class="predicted">predicted</span> at the targets'
    both = ((found.before_word, found.before), (word, found.after))
    return [(name, each) for name, each in both if each is not None]


def _row(found: Findings, figure: Figure, evaluations: list[Evaluation]) -> str:
    values = [figure.of(each) for each in evaluations]
    cells = "".join(
        f"<td>{NONE if value is None else number(found.scale.of(value), ISO_PLACES)}</td>" for value in values
    )
    if len(values) > 1:
        cells += f"<td>{NONE if found.other_stretch else _share(*values)}</td>"
    if figure.direction == "both":
        name = f"<b>{figure.symbol}</b> {figure.name}"
        return f'<tr class="total"><th scope="row">{name}</th>{cells}</tr>\n'
    return f'<tr class="part"><th scope="row">{figure.symbol} {figure.direction}</th>{cells}</tr>\n'


def _between_row(found: Findings, columns: int) -> str:
    """Return the line of what a table will leave between the targets."""
    left_out = found.story.left_out
    if left_out is None or not found.story.is_predicted or columns < 2:
        return ""
    value = NONE if left_out.unsettled else f"≥{GAP}{_shown(found, left_out.low)}"
    why = escape(left_out.unknown)
    if left_out.e is not None and left_out.high is not None:
        value = _shown(found, left_out.e)
        why = (
            f"predicted by leaving out (nine of ten cases: {_shown(found, left_out.low)} to "
            f"{_shown(found, left_out.high)})"
        )
    return (
        f'<tr class="total"><th scope="row"><b>E</b> between the targets<br><small>{why}</small></th>'
        f"<td>{NONE}</td><td>{value}</td><td>{NONE}</td></tr>\n"
    )


def _shown(found: Findings, length: float) -> str:
    return number(found.scale.of(length), ISO_PLACES)


def _share(before: float | None, after: float | None) -> str:
    """Say how much is left of a number, in percent."""
    if before is None or after is None or not before:
        return NONE
    return f"{number(abs(after / before) * 100, 1)}{GAP}%"


def readings_lines(found: Findings) -> str:
    """Say how the results were measured, a line for each set of readings."""
    lines = [
        f"<b>{word.capitalize()}</b>: {escape(about_readings(each))}."
        for word, each in ((found.before_word, found.before), (f"after ({found.after_word})", found.after))
        if each is not None
    ]
    return f'<p class="quiet">{"<br>".join(lines)}</p>\n' if lines else ""


def points_table(found: Findings) -> str:
    """Return the points of the table, folded away; empty where there is no table."""
    table = found.story.table
    if table is None:
        return ""
    count = len(table.positions)
    unit, position = escape(found.scale.deviation), escape(found.scale.position)
    rows = "".join(
        f'<tr><th scope="row">{shortest(at)}</th><td>{_point(found, forward)}</td>'
        f"<td>{_point(found, backward)}</td><td>{_point(found, forward - backward)}</td></tr>\n"
        for at, forward, backward in zip(
            table.positions[:MOST_ROWS],
            table.forward[:MOST_ROWS],
            table.backward[:MOST_ROWS],
            strict=True,
        )
    )
    cut = f" The first {MOST_ROWS} are listed; the file of the table has all." if count > MOST_ROWS else ""
    return (
        f"<details>\n<summary>The {count} points of the table</summary>\n"
        f'<div class="wide"><table>\n<caption>What is added to a command, in {unit}.{cut}</caption>\n'
        f'<thead><tr><th scope="col">position / {position}</th><th scope="col">moving forward</th>'
        '<th scope="col">moving backward</th><th scope="col">difference</th></tr></thead>\n'
        f"<tbody>\n{rows}</tbody>\n</table></div>\n</details>\n"
    )


def _point(found: Findings, correction: float) -> str:
    return number(found.scale.of(correction), POINT_PLACES)
