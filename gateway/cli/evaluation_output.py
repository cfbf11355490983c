"""Results of ISO 230-2 as ``pitch-gateway table`` shows them: before and after, each way and both."""

import sys
from collections.abc import Iterator
from typing import Final

from gateway.cli.table_output import PLAIN_WIDTH
from gateway.metrology.evaluation import Evaluation
from gateway.report.findings import other_stretch

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


def results_text(before: Evaluation, after: Evaluation | None, titles: tuple[str, str]) -> None:
    """Print the results for a person, with the share that is left."""
    from rich.console import Console
    from rich.table import Table

    unit = before.units.value
    table = Table(title=f"ISO 230-2, {unit}", title_justify="left")
    table.add_column("result")
    shown = [(titles[0], _values(before))] + ([(titles[1], _values(after))] if after else [])
    for title, _ in shown:
        for way in ("forward", "backward", "both"):
            table.add_column(f"{title}\n{way}", justify="right")
    if after:
        table.add_column("left", justify="right")
    comparable = after is None or not other_stretch(before, after)
    digits = 6 if unit == "inch" else 5
    for name, meaning in _NAMES:
        numbers = [value for _, values in shown for value in values[name]]
        cells = ["–" if number is None else f"{round(number, digits) + 0.0:.{digits}f}" for number in numbers]
        left = _left(numbers, 0.5 * 10**-digits)
        table.add_row(f"{name}  {meaning}", *cells, *(left if comparable else ("–" for _ in left)))
    Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH).print(table)


def _left(numbers: list[float | None], least: float) -> Iterator[str]:
    """Share of the result of both directions that is left; nothing has no share."""
    if len(numbers) > 3:
        was, now = numbers[2], numbers[5]
        yield "–" if was is None or now is None or abs(was) < least else f"{abs(now) / abs(was):.0%}"
