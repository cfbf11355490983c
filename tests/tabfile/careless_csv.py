"""What the sample files of the CSV dialects, Aerotech and Renishaw say, found without their readers."""

import re
from itertools import accumulate

Points = list[tuple[float, float]]
"""Positions, ascending, and what is added there."""


def _rows(text: str, marks: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.strip() and line.strip()[0] not in marks]


def laser_errors(text: str) -> tuple[Points, Points]:
    """Semicolons, decimal commas, micrometres; an error is subtracted."""
    header, *rows = _rows(text, "#")
    assert header == "position_mm;forward_error_um;backward_error_um"
    numbers = sorted(tuple(float(cell.replace(",", ".")) for cell in row.split(";")) for row in rows)
    return [(x, -up / 1000) for x, up, _ in numbers], [(x, -down / 1000) for x, _, down in numbers]


def aerotech(text: str) -> tuple[Points, Points]:
    """The first value lies at 0; a value is added."""
    rows = _rows(text, ";'")
    head = " ".join(row for row in rows if row.upper().startswith(":START"))
    step = float(re.findall(r"(?i)SAMPLEDIST=(\S+)", head)[0])
    (unit,) = re.findall(r"(?i)CORUNIT=PRIMARY(?:/(\d+))?(?: |$)", head)
    values = [float(value) for row in rows if row[0] != ":" for value in row.split()]
    sign = -1 if "NEGCOR" in head.upper() else 1
    points = [(i * step, sign * value / float(unit or 1)) for i, value in enumerate(values)]
    return points, points


def _increments(text: str) -> tuple[list[float], dict[int, int]]:
    rows = [row.split(",") for row in _rows(text, "#")]
    return [float(row[1]) for row in rows[:5]], {int(row[0]): int(row[1]) for row in rows[6:]}


def _outward(steps: list[float], reference: int, interval: float) -> Points:
    """Sums of ascending steps, 0 after the first ``reference`` of them."""
    sums = [0.0, *accumulate(steps)]
    return [((i - reference) * interval, total - sums[reference]) for i, total in enumerate(sums)]


def fanuc(text: str) -> tuple[Points, Points]:
    """1000 pulses make a mm; a point is the section below it."""
    (reference, lowest, highest, magnification, interval), values = _increments(text)
    assert list(values) == list(range(int(lowest), int(highest) + 1))
    steps = [value * magnification / 1000 for value in values.values()]
    points = _outward(steps, int(reference - lowest) + 1, interval)
    return points, points


def mitsubishi(text: str) -> tuple[Points, Points]:
    """A value is half a micrometre; a point is the section on the side of the reference."""
    (reference, lowest, highest, magnification, interval), values = _increments(text)
    assert list(values) == list(range(int(lowest), int(highest) + 1))
    assert values.pop(int(reference)) == 0
    steps = [value * magnification / 2000 for value in values.values()]
    points = _outward(steps, int(reference - lowest), interval)
    return points, points


def renishaw(text: str) -> tuple[Points, Points]:
    """Micrometres, added as they stand."""
    rows = [row.split() for row in _rows(text, "") if row[0].isdigit()]
    assert [int(row[0]) for row in rows] == list(range(1, len(rows) + 1))
    numbers = sorted((float(x), float(up) / 1000, float(down) / 1000) for _, x, up, down in rows)
    return [(x, up) for x, up, _ in numbers], [(x, down) for x, _, down in numbers]
