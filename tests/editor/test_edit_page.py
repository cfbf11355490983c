"""The page of ``table edit`` in a real browser: one program and one tab for all tests."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.editor.desk import UP_TO_HOME
from tests.editor.program import editing
from tests.supervisor.page.visit import WAIT_MS
from tests.support.browser import opened_page

CURVE = "() => document.querySelector('.drawing .line.forward:not(.before)').getAttribute('d')"
FORWARD, BACKWARD = "forward at −{} mm", "backward at −{} mm"


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("edit") / "cnc10x.tab"
    path.write_text(UP_TO_HOME)
    return path


@pytest.fixture(scope="module")
def tab(file: Path) -> Iterator[Page]:
    expect.set_options(timeout=WAIT_MS)
    heard: list[str] = []
    with editing(file) as program, opened_page(1280, 900, WAIT_MS) as page:
        address = program.first.split()[-1]
        page.on("console", lambda message: heard.append(message.text))
        page.on("pageerror", lambda error: heard.append(str(error)))
        page.on("request", lambda asked: None if asked.url.startswith(address) else heard.append(asked.url))
        page.goto(address)
        yield page
    # the browser itself notes the two refusals that are wanted
    assert [each for each in heard if "409 (Conflict)" not in each] == []


@pytest.fixture
def page(tab: Page, file: Path) -> Iterator[Page]:
    """The tab with the file as it was, and nothing chosen; what a test has changed is undone after it."""
    expect(value(tab, FORWARD, 500)).to_have_value("11")
    yield tab
    tab.set_viewport_size({"width": 1280, "height": 900})
    tab.get_by_label("Change both").uncheck()
    undo = tab.get_by_role("button", name="Undo")
    while undo.is_enabled():
        undo.dispatch_event("click")  # once too often does nothing


def value(page: Page, way: str, at: int) -> Locator:
    return page.get_by_label(way.format(at), exact=True)


def middle(page: Page) -> tuple[float, float]:
    """Where the chosen point is, in the window."""
    box = page.locator(".chosen").bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_a_value_is_typed_and_the_picture_follows(page: Page) -> None:
    before = page.evaluate(CURVE)
    value(page, FORWARD, 300).fill("9,25")
    page.keyboard.press("Enter")
    expect(value(page, FORWARD, 200)).to_be_focused()
    expect(page.get_by_text("was 9", exact=True)).to_be_visible()
    expect(value(page, FORWARD, 300)).to_have_value("9.25")
    assert page.evaluate(CURVE) != before
    assert page.locator(".drawing .line.before.forward").get_attribute("d") != page.evaluate(CURVE)
    # 9.25 forward and 2 backward
    expect(page.get_by_role("row", name="−300").locator("td").last).to_have_text("7.25")
    assert page.title() == "• cnc10x.tab"
    value(page, FORWARD, 300).fill("much")
    page.keyboard.press("Tab")
    expect(page.get_by_role("status")).to_have_text("“much” is not a number. The value stays 9.25 µm.")
    expect(value(page, FORWARD, 300)).to_have_value("9.25")


def test_the_keyboard_alone_changes_takes_back_and_does_again(page: Page) -> None:
    value(page, BACKWARD, 400).focus()
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineWidth")
    assert outline == "3px"
    for key in ("ArrowUp", "ArrowUp", "PageDown", "ArrowDown"):  # steps of 0.1 µm: 4 + 0.2 - 1 - 0.1
        page.keyboard.press(key)
    expect(value(page, BACKWARD, 400)).to_have_value("3.1")
    page.keyboard.press("Control+z")
    expect(value(page, BACKWARD, 400)).to_have_value("3.2")
    page.keyboard.press("Control+y")
    expect(value(page, BACKWARD, 400)).to_have_value("3.1")
    page.keyboard.press("Shift+Tab")
    expect(value(page, FORWARD, 400)).to_be_focused()


def test_a_point_is_dragged_and_the_arrow_keys_go_on_from_there(page: Page) -> None:
    value(page, FORWARD, 300).focus()
    x, y = middle(page)
    value(page, FORWARD, 500).focus()
    _, high = middle(page)
    per_pixel = (11.0 - 9.0) / (y - high)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.up()
    expect(value(page, FORWARD, 300)).to_be_focused()
    expect(page.get_by_role("button", name="Undo")).to_be_disabled()  # a click alone changes nothing
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x, y + 30, steps=6)
    page.mouse.up()
    expect(page.get_by_role("button", name="Undo")).to_be_enabled()
    dragged = float(value(page, FORWARD, 300).input_value())
    assert dragged == pytest.approx(9.0 - 30 * per_pixel, abs=0.15)  # in steps of 0.1 µm
    assert dragged == round(dragged, 1)
    page.keyboard.press("ArrowDown")
    expect(value(page, FORWARD, 300)).to_have_value(f"{dragged - 0.1:.1f}")
    expect(value(page, BACKWARD, 300)).to_have_value("2")


def test_a_remark_comes_at_once_leads_to_its_point_and_an_error_forbids_to_save(page: Page) -> None:
    expect(page.locator("#verdict")).to_have_text("No remarks: the gateway loads this table.")
    value(page, BACKWARD, 200).fill("1500")  # 1.497 mm over 100 mm: a slope of 0.015; and above 0.5 mm
    page.keyboard.press("Enter")
    expect(page.locator("#remarks li.error b")).to_have_text(["error L1", "error L12"])
    expect(page.get_by_role("button", name="Save", exact=True)).to_be_disabled()
    expect(page.locator("#verdict")).to_have_text("This table cannot be saved: correct the errors.")
    page.get_by_role("button", name="to the point at −200").last.click()
    expect(value(page, FORWARD, 200)).to_be_focused()
    page.keyboard.press("Control+s")
    expect(page.get_by_role("status")).to_have_text(re.compile("^not saved: L1: slope of .*; L12: "))


def test_both_directions_move_together(page: Page) -> None:
    page.get_by_label("Change both directions together").check()
    value(page, FORWARD, 100).fill("8")  # 6 in the file; backward 1
    page.keyboard.press("Enter")
    expect(value(page, BACKWARD, 100)).to_have_value("3")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_telephone(page: Page, scheme: str) -> None:
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    page.set_viewport_size({"width": 400, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    frame = "document.getElementById('grid-frame')"
    assert page.evaluate(f"{frame}.scrollWidth <= {frame}.clientWidth")
    page.emulate_media(color_scheme="light")


def test_it_saves_and_refuses_where_the_file_was_changed_meanwhile(page: Page, file: Path) -> None:
    status, save = page.get_by_role("status"), page.get_by_role("button", name="Save", exact=True)
    value(page, FORWARD, 500).fill("12.5")
    page.keyboard.press("Control+s")  # what is typed counts
    expect(status).to_have_text("cnc10x.tab is saved; the file as it was is in cnc10x.tab.bak")
    expect(save).to_be_disabled()
    saved = file.read_text()
    assert saved.splitlines()[-1].split() == ["-500.00000000", "+0.00500000", "+0.01250000"]
    assert file.with_name("cnc10x.tab.bak").read_text() == UP_TO_HOME
    file.write_text(UP_TO_HOME)
    value(page, FORWARD, 500).fill("13")
    page.keyboard.press("Enter")
    save.click()
    expect(status).to_have_text(re.compile("^not saved: cnc10x.tab was changed by another program"))
    assert file.read_text() == UP_TO_HOME
    page.get_by_role("button", name="Save a copy").click()
    expect(status).to_have_text("the edited table is in cnc10x.tab.edited.bak; cnc10x.tab is as it was")
    assert "+0.01300000" in file.with_name("cnc10x.tab.edited.bak").read_text()
    file.write_text(saved)
    save.click()
    expect(status).to_have_text("cnc10x.tab is saved; the file as it was is in cnc10x.tab.bak")
    expect(page.get_by_role("button", name="Save a copy")).to_be_hidden()
