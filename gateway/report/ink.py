"""Colours and settings of every picture; the same on every computer.

Blue and vermilion of the Okabe-Ito palette stay apart for every kind of colour blindness. Because a report is
printed too, forward and backward also differ by the mark (it points where the axis goes) and by the line.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

INK: Final = "#1b2129"
QUIET: Final = "#57606c"
GRID: Final = "#dfe3e8"
ZERO: Final = "#949ca8"
FORWARD: Final = "#0072b2"
BACKWARD: Final = "#d55e00"
BOTH: Final = "#00795a"
PAPER: Final = "#ffffff"

VARIABLES: Final = {
    INK: "--ink",
    QUIET: "--quiet",
    GRID: "--grid",
    ZERO: "--zero",
    FORWARD: "--forward",
    BACKWARD: "--backward",
    BOTH: "--both",
    PAPER: "--card",
}
"""What a page calls the colours: there they follow its light or dark scheme."""

FORWARD_STYLE: Final[dict[str, Any]] = {"color": FORWARD, "marker": ">", "linestyle": "-"}
BACKWARD_STYLE: Final[dict[str, Any]] = {"color": BACKWARD, "marker": "<", "linestyle": (0, (4, 1.6))}
BOTH_STYLE: Final[dict[str, Any]] = {"color": BOTH, "marker": "o", "linestyle": "-"}

_SETTINGS: Final[Any] = {
    "font.family": ["DejaVu Sans"],  # matplotlib brings it along
    "font.size": 8.5,
    "text.parse_math": False,  # a dollar sign in the name of a machine is no formula
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": ZERO,
    "axes.linewidth": 0.8,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.unicode_minus": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.direction": "out",
    "lines.linewidth": 1.3,
    "lines.markersize": 3.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "legend.handlelength": 2.6,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.4,
    "figure.facecolor": PAPER,
    "axes.facecolor": PAPER,
    "savefig.facecolor": PAPER,
    "svg.fonttype": "path",  # the reader's computer need not have the font
}


@contextmanager
def settings(salt: str) -> Iterator[None]:
    """Draw with these settings and no one else's; ``salt`` makes names inside an SVG the same every time."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        mpl.rcParams["svg.hashsalt"] = salt
        yield
