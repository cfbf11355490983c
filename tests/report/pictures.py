"""``make pictures``: a table and a report, as the documents show them."""

import asyncio
import sys
import tempfile
from pathlib import Path
from typing import Final

from gateway.commissioning.demo.cycle import DemoObserver, run_round
from gateway.commissioning.demo.result import REPORT_RUNS, report_of
from gateway.report.axis_data import Report, axis_data_of
from gateway.report.writing import write_report
from gateway.tabfile import FileContext, inspect_table
from tests.support.browser import started_browser

ROOT: Final = Path(__file__).parents[2]
FOLDER: Final = ROOT / "docs" / "pictures"
TABLE: Final = ROOT / "tables" / "demo" / "cnc10x.tab"
SPEED_UP: Final = 100.0


def take_table() -> None:
    """Draw a table as ``pitch-gateway table plot`` does."""
    loaded = inspect_table(TABLE, FileContext())
    report = Report(f"Correction table {TABLE.name}", (axis_data_of(loaded, None),), "")
    write_report(report, FOLDER / "report-table.png", force=True)


def take_page(folder: Path) -> None:
    """Make a round of the demonstration and take the part of its report that is about one axis."""
    view = asyncio.run(run_round(1, folder, SPEED_UP, DemoObserver(), REPORT_RUNS))
    told = report_of(view, "")
    page = folder / "report.html"
    write_report(Report(told.title, told.axes[:1], told.made_at, told.facts), page)
    with started_browser() as browser:
        tab = browser.new_page(viewport={"width": 900, "height": 1500}, color_scheme="light")
        tab.goto(page.as_uri())
        tab.screenshot(path=FOLDER / "report-page.png")


def main() -> None:
    """Take both pictures."""
    take_table()
    with tempfile.TemporaryDirectory() as folder:
        take_page(Path(folder))
    sys.stdout.write("".join(f"{FOLDER / name}\n" for name in ("report-table.png", "report-page.png")))


if __name__ == "__main__":
    main()
