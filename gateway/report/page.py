"""A report as one picture: for each axis a sheet with its result, and all panels below it."""

from collections.abc import Sequence
from textwrap import wrap
from typing import TYPE_CHECKING, Final

from gateway import __version__
from gateway.metrology.evaluation import Evaluation, missing_of
from gateway.report.axis_data import Report
from gateway.report.drawing import (
    FOREGROUND,
    GRID,
    QUIET,
    ZERO,
    Panel,
    legend_to_the_right,
    saved,
    settings,
    svg_of,
)
from gateway.report.figures import panels
from gateway.report.findings import FIGURES, AxisResults, Figure, about_readings, sentence
from gateway.report.words import NONE, clean, number, truncated

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas
    from matplotlib.figure import SubFigure
    from matplotlib.lines import Line2D

WIDTH_IN: Final = 10.0
ROW_IN: Final = 2.75
TITLE_IN: Final = 0.5
SENTENCE_IN: Final = 0.42
LINE_IN: Final = 0.22
FACTS_IN: Final = 0.25
RESULT_IN: Final = 0.28
MARGIN_IN: Final = 0.1
LEFT: Final = 0.014
RIGHT: Final = 0.986
_SENTENCE_CHARACTERS: Final = 106
_FACT_CHARACTERS: Final = 40
_FACTS_CHARACTERS: Final = 165
_BETWEEN_FACTS: Final = "   ·   "
_COLUMN: Final = 0.114
_SHORT: Final = {"systematic deviation": "systematic", "mean systematic deviation": "mean syst."}
_COLUMNS: Final = 6


def draw_page(report: Report, found: Sequence[AxisResults], form: str) -> bytes:
    """Draw the whole report as one ``png`` or ``svg``."""
    from matplotlib.figure import Figure as Canvas

    with settings("page"):
        rows = [_rows(panels(each)) for each in found]
        heights = [_head_height(each) + ROW_IN * len(its) for each, its in zip(found, rows, strict=True)]
        figure = Canvas(figsize=(WIDTH_IN, TITLE_IN + sum(heights)))
        figure.set_layout_engine("constrained", w_pad=MARGIN_IN, h_pad=MARGIN_IN / 2)
        parts = figure.subfigures(1 + len(heights), 1, height_ratios=[TITLE_IN, *heights], squeeze=False)
        _title(parts[0, 0], report)
        for index, (each, its) in enumerate(zip(found, rows, strict=True), start=1):
            _axis_part(parts[index, 0], each, its, f"axis{index}")
        if form == "svg":
            return _standalone(figure, report).encode()
        return saved(figure, form)


def _standalone(figure: "Canvas", report: Report) -> str:
    from html import escape

    svg = svg_of(figure, "")
    head, _, rest = svg.partition(">")
    title = f"<title>{escape(clean(report.title))}</title>"
    return f'<?xml version="1.0" encoding="utf-8"?>\n{head} role="img">\n{title}{rest}'


def _rows(its: list[Panel]) -> list[list[Panel]]:
    """Put panels that are readable at half the width beside each other."""
    rows: list[list[Panel]] = []
    for panel in its:
        if panel.is_half and rows and len(rows[-1]) == 1 and rows[-1][0].is_half:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    return rows


def _head_height(found: AxisResults) -> float:
    results = [each for each in (found.before, found.after) if each is not None]
    lines = (
        SENTENCE_IN
        + LINE_IN * (len(sentence_lines(found)) - 1)
        + (FACTS_IN if found.axis_data.facts else 0.0)
    )
    return lines + (RESULT_IN * (len(results) + 1) if results else 0.0)


def sentence_lines(found: AxisResults) -> list[str]:
    """Return the sentence on as many lines as it needs: its end has the main result."""
    return wrap(sentence(found), _SENTENCE_CHARACTERS, break_on_hyphens=False)


def _title(part: "SubFigure", report: Report) -> None:
    part.text(LEFT, 0.45, truncated(clean(report.title), 75), fontsize=15, fontweight="bold", va="center")
    made = f"{truncated(clean(report.made_at), 60)}\npitch-gateway {__version__}".lstrip()
    part.text(RIGHT, 0.45, made, fontsize=7.5, color=QUIET, ha="right", va="center", linespacing=1.5)


def _axis_part(part: "SubFigure", found: AxisResults, rows: list[list[Panel]], prefix: str) -> None:
    head_height = _head_height(found)
    ratios = [head_height, ROW_IN * len(rows)]
    head, body = part.subfigures(2, 1, height_ratios=ratios, squeeze=False)[:, 0]
    _head(head, found, head_height)
    for row, strip in zip(rows, body.subfigures(len(rows), 1, squeeze=False)[:, 0], strict=True):
        for panel, axes in zip(row, strip.subplots(1, len(row), squeeze=False)[0], strict=True):
            panel.draw_on(axes, prefix)
            legend_to_the_right(axes)
            axes.set_title(panel.title, pad=8 if len(row) == 1 else 20)


def _head(head: "SubFigure", found: AxisResults, height: float) -> None:
    """Write the sentence, the facts and the results on their lines from the top."""
    rule = 1 - 0.03 / height
    head.add_artist(_line((LEFT, RIGHT), (rule, rule)))
    at = 0.23
    for line in sentence_lines(found):
        head.text(LEFT, 1 - at / height, line, fontsize=11.5, va="center")
        at += LINE_IN
    head.text(LEFT, 1 - (at + 0.03) / height, _facts_line(found), fontsize=7.5, color=QUIET, va="center")
    results = [
        (word, each)
        for word, each in ((found.before_word, found.before), (f"after, {found.after_word}", found.after))
        if each is not None
    ]
    if results:
        axes = head.add_axes((0.0, 0.02, 1.0, (RESULT_IN * (len(results) + 1)) / height))
        _results(axes, found, results)


def _facts_line(found: AxisResults) -> str:
    """Return as many whole facts as fit on a line; an ellipsis replaces the others."""
    line = ""
    for name, text in found.axis_data.facts.items():
        fact = f"{truncated(clean(name), _FACT_CHARACTERS)}: {truncated(clean(text), _FACT_CHARACTERS)}"
        longer = f"{line}{_BETWEEN_FACTS}{fact}" if line else fact
        if len(longer) > _FACTS_CHARACTERS:
            return f"{line}{_BETWEEN_FACTS}…"
        line = longer
    return line


def _line(x: tuple[float, float], y: tuple[float, float]) -> "Line2D":
    from matplotlib.lines import Line2D

    return Line2D(x, y, color=FOREGROUND, linewidth=1.1)


def shown_figures(results: Sequence[Evaluation]) -> list[Figure]:
    """Return the figures that fit: those of both directions; if there are none, those of each."""
    both = [figure for figure in FIGURES if figure.direction == "both"]
    if any(figure.of(each) is not None for each in results for figure in both):
        return both
    return [figure for figure in FIGURES if figure.direction != "both"]


def _heading(figure: Figure) -> str:
    name = _SHORT.get(figure.name, figure.name) if figure.direction == "both" else figure.direction
    return f"{figure.symbol}  {name}"


def _results(axes: "Axes", found: AxisResults, results: list[tuple[str, Evaluation]]) -> None:
    """Write the numbers of the standard, a line for each set of readings."""
    axes.set_axis_off()
    axes.set_xlim(0, 1)
    axes.set_ylim(len(results) + 1, 0)
    for line, colour in ((0.98, ZERO), (len(results) + 0.98, GRID)):
        axes.axhline(line, xmin=LEFT, xmax=RIGHT, color=colour, linewidth=0.8)
    missing = any(missing_of(each) for _, each in results)
    title = "as in ISO 230-2" if missing else "ISO 230-2"
    axes.text(LEFT, 0.5, f"{title} / {found.scale.deviation}", color=QUIET, fontsize=7.5, va="center")
    left = RIGHT - _COLUMN * (_COLUMNS - 1)
    columns = [left + _COLUMN * index for index in range(_COLUMNS)]
    shown = shown_figures([each for _, each in results])
    for x, figure in zip(columns, shown, strict=True):
        axes.text(x, 0.5, _heading(figure), color=QUIET, fontsize=7.5, va="center", ha="right")
    for line, (word, evaluation) in enumerate(results, start=1):
        axes.text(LEFT, line + 0.5, word, fontsize=9, va="center", fontweight="bold")
        about = about_readings(evaluation).partition(";")[0].removesuffix(" in each direction")
        axes.text(0.145, line + 0.5, about, fontsize=7.5, va="center", color=QUIET)
        for x, figure in zip(columns, shown, strict=True):
            value = figure.of(evaluation)
            text = NONE if value is None else number(found.scale.of(value), 2)
            axes.text(x, line + 0.5, text, fontsize=9.5, va="center", ha="right")
