"""``make pictures``: a table, a report and the page of ``table edit``, as the documents show them."""

import asyncio
import sys
import tempfile
import threading
from pathlib import Path
from typing import Final

from gateway.commissioning.demo.cycle import DemoObserver, run_round
from gateway.commissioning.demo.result import REPORT_RUNS, report_of
from gateway.commissioning.editor.editing import Editing
from gateway.commissioning.editor.serving import EditorServer
from gateway.commissioning.table_options import ReadOptions
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


def take_editor() -> None:
    """Edit a table, and take the page as it is then."""
    editing = Editing(TABLE, FileContext(), ReadOptions())
    editing.change(12, "forward", editing.state().now.forward[12] + 12.0, together=False)
    with EditorServer(editing, print) as server, started_browser() as browser:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        tab = browser.new_page(viewport={"width": 1280, "height": 800}, color_scheme="light")
        tab.goto(server.url)
        tab.locator("#grid input").nth(24).focus()
        tab.evaluate(
            "document.getElementById('about').textContent = 'Axis X, centroid-3, 31 points, in tables/demo'"
        )
        tab.screenshot(path=FOLDER / "table-edit.png")
        server.shutdown()


def main() -> None:
    """Take all pictures."""
    take_table()
    with tempfile.TemporaryDirectory() as folder:
        take_page(Path(folder))
    take_editor()
    names = ("report-table.png", "report-page.png", "table-edit.png")
    sys.stdout.write("".join(f"{FOLDER / name}\n" for name in names))


if __name__ == "__main__":
    main()
