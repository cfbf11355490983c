"""A report as one self-contained HTML file: no script, no network, no own font."""

import re
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import Final

from gateway import __version__
from gateway.compensation.direction import Direction
from gateway.metrology.evaluation import Evaluation, missing_of
from gateway.report.axis_data import Report
from gateway.report.drawing import VARIABLES, Panel, opening_tag, panel_svg
from gateway.report.figures import panels
from gateway.report.findings import FIGURES, AxisResults, Figure, about_readings, sentence
from gateway.report.words import GAP, NONE, clean, number, shortest

_PAGE: Final = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<meta name="generator" content="pitch-gateway {version}">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<header>
<h1>{title}</h1>
{made_at}{facts}</header>
<main>
{axes}{method}{sign}</main>
<footer><p>Made by pitch-gateway {version}.</p></footer>
</body>
</html>
"""
_METHOD: Final = """\
<section class="card method" aria-labelledby="method">
<h2 id="method">How the numbers are made</h2>
<p>{readings}A correction is the amount that is added to a commanded position; between the points of a table
it is a straight line.{predicted}</p>
</section>
"""
_READINGS: Final = """\
A deviation is where the instrument saw the nut, less the target; positive means that it went too far. At
each target and in each direction the readings have a mean and a standard deviation s (of a sample, n − 1).
With them, after ISO 230-2: the <b>accuracy A</b> is the distance from the lowest mean − 2s to the highest
mean + 2s of all targets; the <b>repeatability R</b> is the largest of 4s, and for both directions of
2s forward + 2s backward + the size of the reversal; the <b>systematic deviation E</b> is the range of the
means; <b>M</b> is the range of the mean of both directions; the <b>reversal B</b> is the largest difference
of the mean forward and the mean backward, B̄ its mean with its sign, negative where the nut stays behind.
The readings are the ones that were given; none is left out unless a note says so. """
_PREDICTED: Final = (
    " A result that is marked as predicted was not measured: it is computed from the readings before and "
    "the table. The means of readings that the table itself was made of vanish by that alone: what is left "
    "at the targets is their scatter. What is left <b>between the targets</b> is predicted by leaving "
    "targets out: each is compared with what all others say of it, and the curves that the readings allow "
    "are taken with the table; only a new measurement at other targets shows it."
)
_SIGN: Final = """\
<section class="sign" aria-label="To fill in and to sign">
{lines}</section>
"""
_FILLED_IN: Final = {
    "Machine, serial number": ("machine",),
    "Instrument, certificate": ("instrument", "gauge", "laser"),
    "Temperature of machine and air": ("temperature",),
}
"""What a printed report leaves room for, unless the name of a fact has one of these words."""
_SIGNED: Final = ("Measured by, date", "Signature", "Released by, date", "Signature")
MOST_ROWS: Final = 1000
"""Maximum of listed points. Programs read longer tables from their file."""
ISO_DECIMALS: Final = 2
POINT_DECIMALS: Final = 2
_COLOURS: Final = re.compile("|".join(VARIABLES))


def html_page(report: Report, found: Sequence[AxisResults]) -> str:
    """Return the whole page. All text of the report is escaped: it comes from untrusted files."""
    predicted = any(each.axis_data.is_predicted and each.after is not None for each in found)
    measured = any(each.before is not None or each.after is not None for each in found)
    return _PAGE.format(
        version=escape(__version__),
        title=text(report.title),
        made_at=f'<p class="quiet">{text(report.made_at)}</p>\n' if report.made_at else "",
        style=files("gateway.report").joinpath("sheet.css").read_text(encoding="utf-8"),
        facts=_facts(report.facts.items()),
        axes="".join(_axis(each, index) for index, each in enumerate(found, start=1)),
        method=_METHOD.format(
            readings=_READINGS if measured else "", predicted=_PREDICTED if predicted else ""
        ),
        sign=_sign(report),
    )


def text(words: str) -> str:
    """Return text for a page, with all markup escaped."""
    return escape(clean(words))


def _sign(report: Report) -> str:
    """Return lines for a pen, which only the printed page has."""
    names = " ".join(
        name for facts in (report.facts, *(axis.facts for axis in report.axes)) for name in facts
    )
    missing = [line for line, words in _FILLED_IN.items() if not any(word in names.lower() for word in words)]
    return _SIGN.format(lines="".join(f"<p>{line}</p>\n" for line in (*missing, *_SIGNED)))


def _facts(facts: Iterable[tuple[str, str]]) -> str:
    rows = "".join(f"<dt>{text(name)}</dt><dd>{text(fact)}</dd>\n" for name, fact in facts)
    return f"<dl>\n{rows}</dl>\n" if rows else ""


def _axis(found: AxisResults, index: int) -> str:
    """Return one section: sentence, facts, results, pictures, points."""
    prefix = f"axis{index}"
    notes = "".join(f"<li>{text(note)}</li>\n" for note in found.axis_data.notes)
    parts = (
        f'<section class="card" aria-labelledby="{prefix}">\n',
        f'<h2 id="{prefix}">{escape(found.subject)}</h2>\n',
        f'<p class="said">{escape(sentence(found))}</p>\n',
        _facts(found.axis_data.facts.items()),
        results_table(found),
        readings_lines(found),
        f"<h3>Notes</h3>\n<ul>\n{notes}</ul>\n" if notes else "",
        '<div class="pictures">\n',
        *(_picture(panel, prefix) for panel in panels(found)),
        "</div>\n",
        points_table(found),
        "</section>\n",
    )
    return "".join(parts)


def _picture(panel: Panel, prefix: str) -> str:
    """Return a picture for the page, with its text for screen readers."""
    name = f"{prefix}-{panel.name}"
    svg = panel_svg(panel, prefix)
    tag = opening_tag(svg)
    view_box = re.search(r'viewBox="[^"]*"', tag)
    assert view_box is not None, "matplotlib writes a viewBox"
    opening = (
        f'<svg {view_box[0]} role="img" aria-labelledby="{name}-title {name}-about">'
        f'<title id="{name}-title">{escape(panel.title)}</title>'
    )
    drawing = _COLOURS.sub(lambda found: f"var({VARIABLES[found[0]]})", _without_styles(svg[len(tag) :]))
    kind = ' class="half"' if panel.is_half else ""
    return (
        f"<figure{kind}>\n<h3>{escape(panel.title)}</h3>\n"
        f'<div class="wide">{opening}{drawing.rstrip()}</div>\n'
        f'<figcaption id="{name}-about">{escape(panel.about)}</figcaption>\n</figure>\n'
    )


def _without_styles(svg: str) -> str:
    """Remove the style sheet of an SVG: inside a page it would apply to the whole page."""
    return re.sub(r"\s*<defs>\s*<style.*?</style>\s*</defs>", "", svg, flags=re.DOTALL)


# --- Tables: results of ISO 230-2, how they were measured, the points of the table


def results_table(found: AxisResults) -> str:
    """Return the results before and after, empty if nothing was measured."""
    columns = _result_columns(found)
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
        f"<caption>Results {escape(_results_title(found))}, in {escape(found.scale.deviation)}</caption>\n"
        f'<thead><tr><th scope="col">quantity</th>{heads}</tr></thead>\n'
        f"<tbody>\n{rows}</tbody>\n</table></div>\n"
    )


def _results_title(found: AxisResults) -> str:
    """Return the title of the results: the standard's own name only if nothing is missing."""
    missing = any(missing_of(each) for each in (found.before, found.after) if each is not None)
    return "by the formulas of ISO 230-2" if missing else "after ISO 230-2"


def _result_columns(found: AxisResults) -> list[tuple[str, Evaluation]]:
    word = "after"
    if found.axis_data.is_predicted:
        word = 'after, <span class="predicted">predicted</span> at the targets'
    both = ((found.before_word, found.before), (word, found.after))
    return [(name, each) for name, each in both if each is not None]


def _row(found: AxisResults, figure: Figure, evaluations: list[Evaluation]) -> str:
    values = [figure.of(each) for each in evaluations]
    cells = "".join(
        f"<td>{NONE if value is None else number(found.scale.of(value), ISO_DECIMALS)}</td>"
        for value in values
    )
    if len(values) > 1:
        cells += f"<td>{NONE if found.other_stretch else _share(*values)}</td>"
    if figure.direction == "both":
        name = f"<b>{figure.symbol}</b> {figure.name}"
        return f'<tr class="total"><th scope="row">{name}</th>{cells}</tr>\n'
    return f'<tr class="part"><th scope="row">{figure.symbol} {figure.direction}</th>{cells}</tr>\n'


def _between_row(found: AxisResults, columns: int) -> str:
    """Return the row of what a table will leave between the targets."""
    left_out = found.axis_data.left_out
    if left_out is None or not found.axis_data.is_predicted or columns < 2:
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


def _shown(found: AxisResults, length: float) -> str:
    return number(found.scale.of(length), ISO_DECIMALS)


def _share(before: float | None, after: float | None) -> str:
    """Return how much of a number remains, in percent."""
    if before is None or after is None or not before:
        return NONE
    return f"{number(abs(after / before) * 100, 1)}{GAP}%"


def readings_lines(found: AxisResults) -> str:
    """Return how the results were measured, a line for each set of readings."""
    lines = [
        f"<b>{word.capitalize()}</b>: {escape(about_readings(each))}."
        for word, each in ((found.before_word, found.before), (f"after ({found.after_word})", found.after))
        if each is not None
    ]
    return f'<p class="quiet">{"<br>".join(lines)}</p>\n' if lines else ""


def points_table(found: AxisResults) -> str:
    """Return the points of the table, folded away; empty without a table."""
    table = found.axis_data.table
    if table is None:
        return ""
    count = len(table.positions)
    unit, position = escape(found.scale.deviation), escape(found.scale.position)
    rows = "".join(
        f'<tr><th scope="row">{shortest(at)}</th><td>{_point(found, forward)}'
        f"{_uncertain(found, at, Direction.FORWARD)}</td>"
        f"<td>{_point(found, backward)}{_uncertain(found, at, Direction.BACKWARD)}</td>"
        f"<td>{_point(found, forward - backward)}</td></tr>\n"
        for at, forward, backward in zip(
            table.positions[:MOST_ROWS],
            table.forward[:MOST_ROWS],
            table.backward[:MOST_ROWS],
            strict=True,
        )
    )
    omission = (
        f" The first {MOST_ROWS} are listed; the file of the table has all." if count > MOST_ROWS else ""
    )
    if found.axis_data.band is not None:
        omission += " ±: its uncertainty (k = 2, 95 %)."
    return (
        f"<details>\n<summary>The {count} points of the table</summary>\n"
        f'<div class="wide"><table>\n<caption>What is added to a command, in {unit}.{omission}</caption>\n'
        f'<thead><tr><th scope="col">position / {position}</th><th scope="col">moving forward</th>'
        '<th scope="col">moving backward</th><th scope="col">difference</th></tr></thead>\n'
        f"<tbody>\n{rows}</tbody>\n</table></div>\n</details>\n"
    )


def _uncertain(found: AxisResults, at: float, way: Direction) -> str:
    """Return the uncertainty of a correction; empty if it is unknown."""
    band = found.axis_data.band
    value = None if band is None else band.at(at, way)
    return "" if value is None else f" <small>±{GAP}{number(found.scale.of(value), POINT_DECIMALS)}</small>"


def _point(found: AxisResults, correction: float) -> str:
    return number(found.scale.of(correction), POINT_DECIMALS)
