"""Draws what each candidate adds: run with the bench's own environment, which has matplotlib.

    python chart.py FIGURES.json WHERE

FIGURES: ``{"title": …, "bars": [{"name": …, "added_us": {"estimate": …, "low": …, "high": …}}]}``. Writes
WHERE.png and WHERE.svg.
"""

import json
import sys
from pathlib import Path
from typing import Any, Final, cast

import matplotlib as mpl
from matplotlib import pyplot as plt

OURS: Final = "#1f6f8b"
OURS_WITHOUT_TABLE: Final = "#8fbccb"
LIMIT: Final = "#6b6b6b"
OTHERS: Final = "#c9793a"
INK: Final = "#222222"
SETTINGS: Final = {
    "font.family": "DejaVu Sans",
    "font.size": 11,
    "svg.fonttype": "none",
    "svg.hashsalt": "bench",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.spines.left": False,
}


def colour(name: str) -> str:
    """Return the colour of a candidate: ours, the limit, others."""
    if name.startswith("gateway"):
        return OURS_WITHOUT_TABLE if "no table" in name else OURS
    return LIMIT if name == "relay in C" else OTHERS


def draw(figures: dict[str, Any], where: Path) -> None:
    """Draw horizontal bars with their intervals, the shortest on top."""
    bars = sorted(figures["bars"], key=lambda bar: -bar["added_us"]["estimate"])
    names = [bar["name"] for bar in bars]
    values = [bar["added_us"]["estimate"] for bar in bars]
    below = [max(0.0, bar["added_us"]["estimate"] - bar["added_us"]["low"]) for bar in bars]
    above = [max(0.0, bar["added_us"]["high"] - bar["added_us"]["estimate"]) for bar in bars]
    mpl.rcParams.update(cast("Any", SETTINGS))
    figure, axes = plt.subplots(figsize=(9, 0.48 * len(bars) + 1.5), layout="constrained")
    whiskers = {"ecolor": INK, "capsize": 3, "elinewidth": 1.1}
    axes.barh(
        names,
        values,
        color=[colour(name) for name in names],
        xerr=[below, above],
        error_kw=whiskers,
        height=0.66,
    )
    widest = max(value + more for value, more in zip(values, above, strict=True))
    for row, (value, more) in enumerate(zip(values, above, strict=True)):
        axes.text(value + more + 0.012 * widest, row, f"{value:.1f}", va="center", color=INK)
    axes.set_xlim(0, 1.1 * widest)
    axes.set_xlabel("added to the median round trip, µs (whiskers: 95 % interval over rounds)")
    axes.set_title(figures["title"], loc="left", fontsize=12, fontweight="bold")
    axes.tick_params(axis="y", length=0)
    axes.xaxis.grid(visible=True, color="#dddddd", linewidth=0.8)
    axes.set_axisbelow(True)
    figure.savefig(where.with_suffix(".png"), dpi=150, facecolor="white")
    figure.savefig(where.with_suffix(".svg"), facecolor="white", metadata={"Date": None})


if __name__ == "__main__":
    draw(json.loads(Path(sys.argv[1]).read_text()), Path(sys.argv[2]))
