"""Results of ISO 230-2 as ``pitch-gateway table`` shows them: before and after, each way and both."""

import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import typer

from gateway.cli.table_output import PLAIN_WIDTH
from gateway.compensation.units import Units
from gateway.metrology.deviation import Small, small_unit
from gateway.metrology.evaluation import Evaluation
from gateway.metrology.shapes import LeftOut
from gateway.metrology.standard_asks import missing_line, missing_of, title_of
from gateway.report.findings import other_stretch

if TYPE_CHECKING:
    from gateway.metrology.fitting import Evidence

PREDICTED: Final = "predicted"
"""The title of figures that nobody measured."""
NOT_JUDGED: Final = "not known from these readings: too few targets, or more than tell anything"

_NAMES: Final = (
    ("A", "accuracy"),
    ("R", "repeatability"),
    ("E", "systematic error"),
    ("M", "mean systematic error"),
    ("B", "reversal, largest"),
    ("Bm", "reversal, mean"),
)


def _values(found: Evaluation) -> dict[str, tuple[float | None, float | None, float | None]]:
    """Return forward, backward and both of each result."""
    return {
        "A": (found.accuracy_forward, found.accuracy_backward, found.accuracy),
        "R": (found.repeatability_forward, found.repeatability_backward, found.repeatability),
        "E": (found.systematic_forward, found.systematic_backward, found.systematic),
        "M": (None, None, found.mean_systematic),
        "B": (None, None, found.reversal),
        "Bm": (None, None, found.mean_reversal),
    }


def results_json(found: Evaluation) -> dict[str, object]:
    """Return the results as plain data, in the units of the readings; null where the readings carry none."""
    values = _values(found)
    return {
        "units": found.units.value,
        "is_iso_230_2": not missing_of(found),
        "missing": list(missing_of(found)),
        "forward": {name: values[name][0] for name in ("A", "R", "E")},
        "backward": {name: values[name][1] for name in ("A", "R", "E")},
        "both": {name: values[name][2] for name, _ in _NAMES},
        "targets": [
            {
                "target": each.target,
                "runs": [len(way.deviations) if way else 0 for way in (each.forward, each.backward)],
                "mean": [way.mean if way else None for way in (each.forward, each.backward)],
                "s": [way.s if way else None for way in (each.forward, each.backward)],
                "reversal": each.reversal,
            }
            for each in found.targets
        ],
    }


def left_out_json(units: Units, left_out: LeftOut | None, when: str = "") -> dict[str, object]:
    """Return E between the targets, predicted by leaving out, and its bounds.

    Null is what the readings do not tell, with the reason, and the lengths, in the units of the readings, of
    what repeats unseen.
    """
    small = small_unit(units)
    names = (f"left_out_e{when}", f"left_out_e_low{when}", f"left_out_e_high{when}")
    numbers: tuple[float | None, ...] = (None,) * len(names)
    if left_out is not None and not left_out.unsettled:
        numbers = (left_out.e, left_out.low, left_out.high)
    return {
        f"{name}_{small.key}": None if number is None else number * small.factor
        for name, number in zip(names, numbers, strict=True)
    } | {
        f"left_out_unknown{when}": (NOT_JUDGED if left_out is None else left_out.unknown) or None,
        f"left_out_unseen_periods{when}": [each.length for each in left_out.unseen] if left_out else [],
    }


def predicted_json(predicted: Evaluation, left_out: LeftOut | None) -> dict[str, object]:
    """Return E as predicted at the targets, and between them."""
    small = small_unit(predicted.units)
    at_targets = None if predicted.systematic is None else predicted.systematic * small.factor
    return {f"e_{small.key}": at_targets, **left_out_json(predicted.units, left_out)}


def evidence_json(evidence: "Evidence") -> dict[str, object]:
    """Return why a table follows what it follows, as plain data."""
    chosen = evidence.chosen
    small = small_unit(chosen.table.units)
    return {
        "follows": chosen.shape.value,
        "step": chosen.step,
        "points_where_the_nut_stood": chosen.at_nut,
        "candidates": [
            {
                "follows": each.shape.value,
                "points": len(each.table.positions),
                f"left_out_rms_{small.key}": each.misses * small.factor,
                f"left_out_e_{small.key}": each.left_out * small.factor if evidence.is_told else None,
            }
            for each in evidence.candidates
        ],
        "harmonics": [
            {
                "name": each.period.name,
                "period": each.period.length,
                f"amplitude_{small.key}": None if each.amplitude is None else each.amplitude * small.factor,
                "phase_deg": each.phase_deg,
                "p": each.significance,
            }
            for each in evidence.harmonics
        ],
        "warnings": list(evidence.warnings),
    }


def results_text(
    before: Evaluation,
    after: Evaluation | None,
    titles: tuple[str, str],
    *,
    left_out: LeftOut | None = None,
) -> None:
    """Print the results for a person, with the share that is left; ``left_out`` is E between the points.

    Beside it stands that the predicted figures are those at the targets.
    """
    from rich.console import Console
    from rich.table import Table

    unit = before.units.value
    shown_all = [each for each in (before, after) if each is not None]
    title = next((title_of(each) for each in shown_all if missing_of(each)), title_of(before))
    table = Table(title=f"{title}, {unit}", title_justify="left")
    table.add_column("result")
    shown = [(titles[0], _values(before))] + ([(titles[1], _values(after))] if after else [])
    is_predicted = PREDICTED in titles
    for title, _ in shown:
        where = "\nat targets" if title == PREDICTED else "\n" * is_predicted
        for way in ("forward", "backward", "both"):
            table.add_column(f"{title}{where}\n{way}", justify="right")
    if after:
        table.add_column("left", justify="right")
    comparable = after is None or not other_stretch(before, after)
    digits = 6 if unit == "inch" else 5
    for name, meaning in _NAMES:
        numbers = [value for _, values in shown for value in values[name]]
        cells = ["–" if number is None else f"{round(number, digits) + 0.0:.{digits}f}" for number in numbers]
        left = _left(numbers, 0.5 * 10**-digits)
        table.add_row(f"{name}  {meaning}", *cells, *(left if comparable else ("–" for _ in left)))
        if name == "E" and is_predicted:
            table.add_row(*_between_row(before, left_out, digits))
    Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH).print(table)
    for line in dict.fromkeys(missing_line(each) for each in shown_all):
        if line:
            typer.echo(line)
    if left_out is not None:
        typer.echo(left_out_line(before, left_out))


def _between_row(before: Evaluation, left_out: LeftOut | None, digits: int) -> list[str]:
    """Return the line of what is left between the targets, where a table has none."""
    if left_out is None or left_out.unsettled:
        shown, left = "not known", ["–"]
    elif left_out.e is None:
        shown, left = f"≥ {left_out.low:.{digits}f}", ["–"]
    else:
        shown = f"{left_out.e:.{digits}f}"
        left = list(_left([None, None, before.systematic, None, None, left_out.e], 0.5 * 10**-digits))
    return ["E  between the targets", "", "", "–", "", "", shown, *left]


def left_out_line(before: Evaluation, left_out: LeftOut) -> str:
    """Say what the table will leave where nobody measured."""
    small = small_unit(before.units)
    was = ""
    if before.systematic is not None:
        was = f"; at the targets it was {small.text(before.systematic)} before"
    return f"between its points the table will leave {left_out_text(small, left_out)}{was}"


def left_out_text(small: Small, left_out: LeftOut) -> str:
    """Say E between the targets with its bounds, and what is not in them."""
    if left_out.unsettled:
        return f"an E that is {left_out.unknown}"
    if left_out.e is None or left_out.high is None:
        return f"at least E = {small.text(left_out.low)}; how much it is, is {left_out.unknown}"
    return (
        f"E = {small.text(left_out.e)} (predicted by leaving out; {small.text(left_out.low)} to "
        f"{small.text(left_out.high)} in nine of ten cases)"
    )


def _left(numbers: list[float | None], least: float) -> Iterator[str]:
    """Share of the result of both directions that is left; nothing has no share."""
    if len(numbers) > 3:
        was, now = numbers[2], numbers[5]
        yield "–" if was is None or now is None or abs(was) < least else f"{abs(now) / abs(was):.0%}"
