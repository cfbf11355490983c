"""``make pictures``: the page of a mill that runs, as the documents show it."""

import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser

from tests.processes.mill import Controller, Mill
from tests.support.browser import started_browser

FOLDER: Final = Path(__file__).parents[2] / "docs" / "pictures"
SIZES: Final = {390: 844, 1280: 900, 2560: 1440}
SCHEMES: Final = ("light", "dark")
RUNS_S: Final = 120.0
"""So long it has run: figures, events and a history are there."""
BUDGET_US: Final = 10_000
"""A machine that needs longer, because something else runs on it, gives no pictures."""


def take(browser: Browser, address: str, name: str) -> None:
    """Take the page at each size, light and dark."""
    for width, height in SIZES.items():
        for scheme in SCHEMES:
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=scheme)
            page.goto(address)
            page.wait_for_selector("article.axis:nth-of-type(3) svg.drawing .mark[transform]")
            page.wait_for_timeout(1500)
            page.wait_for_selector("#verdict.well", timeout=2000)
            path = FOLDER / f"{name}-{width}-{scheme}.png"
            page.screenshot(path=path, full_page=True)
            page.close()
            sys.stdout.write(f"{path}\n")


def main() -> None:
    """Run a mill and take its pictures: well, and with a bad table."""
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as folder, started_browser() as browser:
        mill = Mill(Path(folder), BUDGET_US)
        table = mill.tables / "cnc10y.tab"
        good = table.read_text()
        with mill.running() as gateway:
            controller = Controller(mill.controller_port)
            controller.start()
            time.sleep(RUNS_S)
            take(browser, mill.address, "page")
            table.write_text(good.replace("INTERVAL 10", "INTERVAL ten"))
            gateway.until("table-rejected")
            page = browser.new_page(viewport={"width": 1280, "height": 900}, color_scheme="light")
            page.goto(mill.address)
            page.wait_for_selector("#troubles li")
            page.wait_for_timeout(1500)
            page.screenshot(path=FOLDER / "page-trouble.png", full_page=True)
            controller.end()
            gateway.end()


if __name__ == "__main__":
    main()
