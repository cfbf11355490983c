"""A small curve for a terminal: dots in braille characters, eight to a character, coloured by layer."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Final

from rich.style import Style
from rich.text import Text

BLANK: Final = 0x2800
DOTS: Final = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character by row and column (Unicode, block 2800)."""


@dataclass(frozen=True, slots=True)
class Layer:
    """Points in one colour; later layers colour the characters that they share with earlier ones."""

    points: Sequence[tuple[float, float]]
    style: str


def braille_plot(
    layers: Iterable[Layer], x_range: tuple[float, float], y_limit: float, columns: int, rows: int
) -> Text:
    """Draw points with x in ``x_range`` and y in ±``y_limit``; what lies outside sits on the border.

    >>> braille_plot([Layer([(0.0, 1.0), (1.0, -1.0)], "red")], (0.0, 1.0), 1.0, columns=2, rows=1).plain
    '⠁⢀'
    """
    dots = [[0] * columns for _ in range(rows)]
    styles = [[""] * columns for _ in range(rows)]
    for layer in layers:
        for x, y in layer.points:
            column = _cell((x - x_range[0]) / (x_range[1] - x_range[0]), 2 * columns)
            row = _cell((y_limit - y) / (2 * y_limit), 4 * rows)
            dots[row >> 2][column >> 1] |= DOTS[row & 3][column & 1]
            styles[row >> 2][column >> 1] = layer.style
    return Text("\n").join(_row(*row) for row in zip(dots, styles, strict=True))


def _row(dots: Sequence[int], styles: Sequence[str]) -> Text:
    """Join neighbours of one colour: a terminal is told of a colour only where it changes."""
    text = Text()
    cells = zip(dots, styles, strict=True)
    for style, run in groupby(cells, key=lambda cell: cell[1]):
        text.append("".join(chr(BLANK + bits) for bits, _ in run), Style.parse(style))
    return text


def bar(length_um: float, full_um: float, columns: int, style: str) -> Text:
    """Draw a bar of ``length_um`` where ``full_um`` fills all columns; anything above 0 can be seen.

    >>> bar(25.0, 100.0, 4, "red").plain
    '█   '
    """
    eighths = round(8 * columns * min(1.0, length_um / full_um)) if full_um > 0 else 0
    eighths = max(eighths, 1 if length_um > 0 else 0)
    blocks = "█" * (eighths >> 3) + (chr(0x2590 - (eighths & 7)) if eighths & 7 else "")
    return Text(blocks.ljust(columns), Style.parse(style))


def _cell(share: float, cells: int) -> int:
    return min(max(int(share * cells), 0), cells - 1)
