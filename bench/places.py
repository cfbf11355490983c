"""Where the bench keeps things. Everything under ``BUILD`` is made by the bench and ignored by git."""

from pathlib import Path
from typing import Final

BENCH: Final = Path(__file__).resolve().parent
ROOT: Final = BENCH.parent
SOURCES: Final = BENCH / "c"
BUILD: Final = BENCH / "build"
RESULTS: Final = BENCH / "results.md"
NOTES: Final = BENCH / "notes.md"
CHART: Final = BENCH / "results"
"""The chart, without its ending: ``.png`` and ``.svg``."""
