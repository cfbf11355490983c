"""The page over a real gateway with simulated drives, in a real browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from tests.processes.mill import Controller, Mill
from tests.support.browser import opened_page

WAIT_MS = 100_000
DIGITS = "article.axis:first-of-type .digits"
TROUBLE = "#troubles"


@pytest.fixture
def mill(tmp_path: Path) -> Mill:
    return Mill(tmp_path)


@pytest.fixture(scope="module")
def page() -> Iterator[Page]:
    with opened_page(1280, 900, WAIT_MS) as page:
        yield page


def text_is(page: Page, selector: str, wanted: str) -> None:
    page.wait_for_function(
        "([selector, wanted]) => document.querySelector(selector)?.textContent === wanted",
        arg=[selector, wanted],
    )


def test_the_page_follows_the_machine_and_says_what_is_wrong_as_long_as_it_is(mill: Mill, page: Page) -> None:
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    table = mill.tables / "cnc10x.tab"
    good = table.read_text()
    with mill.running() as gateway:
        controller = Controller(mill.controller_port)
        page.goto(mill.address)
        page.wait_for_selector("article.axis:nth-of-type(3)")
        controller.move(1, -20.0)
        while controller.where(1) != -20.0:
            pass
        text_is(page, DIGITS, "−20.000")  # the drive stands at -19.998; the controller and the page say -20
        controller.move(1, -40.0)
        while controller.where(1) != -40.0:
            pass
        text_is(page, DIGITS, "−40.000")
        assert page.locator("article.axis").count() == 3
        assert page.locator(f"{TROUBLE} > *").count() == 0
        table.write_text(good.replace("INTERVAL 10", "INTERVAL ten"))
        gateway.until("table-rejected")
        page.wait_for_selector(f"{TROUBLE} >> text=INTERVAL")
        words = page.locator(TROUBLE).inner_text()
        assert "Axis x" in words
        assert f"{table}:4" in words
        assert "Correct the file" in words
        table.write_text(good)
        gateway.until("table-mended")
        page.wait_for_selector("#verdict.well")
        assert page.locator(f"{TROUBLE} > *").count() == 0
        controller.end()
        assert gateway.end() == 0
    page.wait_for_selector("#lost:not([hidden])")
    assert all("Failed to load resource" in text or "ERR_" in text for text in complaints), complaints


def test_frames_are_shown_in_words_to_whoever_asks_for_them(mill: Mill, page: Page) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    with mill.running() as gateway:
        controller = Controller(mill.controller_port)
        page.goto(mill.address)
        page.wait_for_selector("article.axis:nth-of-type(3)")
        controller.move(1, -20.0)
        while controller.where(1) != -20.0:
            pass
        assert not [url for url in asked if "/frames/" in url]
        page.locator("#frames-room summary").click()
        page.wait_for_selector("#frames >> text=[x actual -20 mm]")
        words = page.locator("#frames").inner_text()
        assert "read holding registers" in words
        assert {"from controller", "to drive", "from drive", "to controller"} <= set(words.split("\n"))
        # The controller reads -20 mm; the drive says where that is on its own scale.
        assert "[x actual -19.99" in words
        page.locator("#frames-hold").click()
        page.wait_for_selector("#frames-hold[aria-pressed=true]")
        controller.end()
        assert gateway.end() == 0
