"""The HTML report in a real browser, without network."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page

from gateway.report.writing import write_report
from tests.report.stories import axis_data, report
from tests.support.browser import started_browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with started_browser() as started:
        yield started


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_report(report(axis_data(), axis_data(axis="y")), path)
    return path


def opened(context: BrowserContext, file: Path) -> tuple[Page, list[str]]:
    """Open the report; what it asked for and what went wrong is in the list."""
    context.set_offline(True)
    page = context.new_page()
    heard: list[str] = []
    page.on("request", lambda request: heard.append(request.url))
    page.on("console", lambda message: heard.append(message.text))
    page.on("pageerror", lambda error: heard.append(str(error)))
    page.goto(file.as_uri())
    return page, heard


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_opens_alone_and_fits(browser: Browser, file: Path, width: int, scheme: str) -> None:
    context = browser.new_context(
        viewport={"width": width, "height": 800},
        color_scheme="dark" if scheme == "dark" else "light",
        java_script_enabled=True,
    )
    page, heard = opened(context, file)
    assert heard == [file.as_uri()]
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.get_by_role("heading", level=1).inner_text() == "Accuracy of a mill"
    names = [picture.get_attribute("aria-labelledby") for picture in page.get_by_role("img").all()]
    assert len(names) == 12
    assert page.get_by_role("img", name="Correction table What the gateway adds").count() == 2
    curve = page.locator("#axis1-correction-forward path").first
    stroke = curve.evaluate("curve => getComputedStyle(curve).stroke")
    assert stroke == ("rgb(108, 185, 242)" if scheme == "dark" else "rgb(0, 114, 178)")
    # before and after stand beside each other where there is room
    before, after = (
        page.locator(f"#axis1-readings-{when}-zero").bounding_box() for when in ("before", "after")
    )
    assert before is not None
    assert after is not None
    assert (before["x"] < after["x"]) is (width == 1280)
    # Numbers are never cut; on a telephone only the two wide pictures of an axis are wider, and say so.
    wide = "[...document.querySelectorAll('.wide')].filter(each => each.scrollWidth > each.clientWidth)"
    assert page.evaluate(f"{wide}.length") == (4 if width == 390 else 0)
    assert page.evaluate(f"{wide}.every(each => each.querySelector('svg'))")
    told = "getComputedStyle(document.querySelector('figure:not(.half) h3'), '::after').content"
    assert ("sideways" in page.evaluate(told)) is (width == 390)
    context.close()


def test_the_points_unfold_without_a_script(browser: Browser, file: Path) -> None:
    context = browser.new_context(java_script_enabled=False)
    page, _ = opened(context, file)
    cell = page.get_by_role("rowheader", name="30", exact=True).first
    assert not cell.is_visible()
    page.get_by_text("The 4 points of the table").first.click()
    assert cell.is_visible()
    context.close()


def test_it_prints_on_white_a4(browser: Browser, file: Path) -> None:
    context = browser.new_context(color_scheme="dark")
    page, _ = opened(context, file)
    pdf = page.pdf(prefer_css_page_size=True)
    # each axis has two pages, the last one the method too; A4 is 595 x 842 points
    boxes = re.findall(rb"/MediaBox \[0 0 (\d+)\.?\d* (\d+)", pdf)
    assert {(int(width), int(height)) for width, height in boxes} <= {(594, 841), (595, 841), (595, 842)}
    assert 4 <= len(boxes) <= 5
    lines = page.locator(".sign p")
    assert not lines.first.is_visible()
    page.emulate_media(media="print")
    assert all(each.is_visible() for each in lines.all())
    edges = lines.evaluate_all("lines => lines.slice(-4).map(line => line.getBoundingClientRect().x)")
    # who measured and who released, each beside a signature
    assert [edge == edges[0] for edge in edges] == [True, False] * 2
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert page.evaluate("getComputedStyle(document.body).color") == "rgb(27, 33, 41)"
    context.close()
