"""A real browser without a screen, that reaches nothing but this machine."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM: Final = Path("/usr/bin/chromium")
FLAGS: Final = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
)


@contextlib.contextmanager
def started_browser() -> Iterator[Browser]:
    """Start the system's chromium, and stop it at the end; the test fails where there is none."""
    assert CHROMIUM.exists(), f"{CHROMIUM} is not installed: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


@contextlib.contextmanager
def opened_page(width: int, height: int, wait_ms: float) -> Iterator[Page]:
    """Start the browser with an empty page of so many pixels, which waits so long for what it looks for."""
    with started_browser() as browser:
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(wait_ms)
        yield page
