"""Wiring that is wrong and drives that fall ill: status, page and health say the same, and say it rightly."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page

from gateway.status.model import COUNTERS
from tests.processes.sick_line import GARBAGE, Client, Health, SickLine, kinds
from tests.support.browser import opened_page
from tests.support.processes import children

WAIT_MS = 100_000
CODE_NO_ANSWER = bytes.fromhex("83 0B")
CONTROLLERS = (
    "[...document.querySelectorAll('.controller-state')].map((one) => one.textContent.split(',')[0])"
)
"""Without how long ago they asked."""
STATES = (
    "[...document.querySelectorAll('article.axis .state span:not(.since)')].map((one) => one.textContent)"
)


@pytest.fixture
def sick(tmp_path: Path) -> Iterator[SickLine]:
    line = SickLine(tmp_path)
    yield line
    line.close()


@pytest.fixture(scope="module")
def browser_page() -> Iterator[Page]:
    with opened_page(1920, 1080, WAIT_MS) as page:
        yield page


def until(page: Page, script: str, wanted: object) -> None:
    page.wait_for_function(
        f"wanted => JSON.stringify({script}) === JSON.stringify(wanted)", arg=wanted, timeout=WAIT_MS
    )


def shot(page: Page, name: str) -> None:
    """Keep a picture where somebody wants to look at it."""
    if folder := os.environ.get("PICTURES"):
        page.wait_for_timeout(500)
        page.screenshot(path=Path(folder) / f"{name}.png")


def test_a_drive_that_has_never_answered_is_named_and_not_called_unreferenced(
    sick: SickLine, browser_page: Page
) -> None:
    sick.drives.health[1] = Health.SILENT
    with sick.running():
        client = Client(sick.cnc_port)

        def ask() -> None:
            assert client.read(1) == CODE_NO_ANSWER
            assert client.read(2)[:2] == bytes.fromhex("03 04")

        trouble = sick.until_trouble("drive-silent", ask)
        assert trouble["where"] == "axis x"
        assert trouble["what"].startswith("its drive (unit id 1) has never answered in ")
        assert "unit id, baud rate and parity. `pitch-gateway capture CONFIG --follow`" in trouble["remedy"]
        assert trouble["axes"] == ["x"]
        status = sick.status()
        assert kinds(status)[0] == "drive-silent"
        assert "unreferenced" not in kinds(status)  # which only follows from it
        assert status["lines"]["xy"]["unit_ids"]["drives"]["2"]["silent_s"] is None
        assert status["axes"]["x"]["trouble"]["title"] == "Drive silent"
        assert status["axes"]["y"]["trouble"] is None
        code, body = sick.get("healthz")
        assert (code, b"axis x: its drive (unit id 1) has never answered" in body) == (503, True)
        metrics = sick.get("metrics")[1].decode()
        assert 'pitch_gateway_drive_answers{axes="x",line="xy",unit_id="1"} 0.0' in metrics
        assert 'pitch_gateway_drive_answers{axes="y",line="xy",unit_id="2"} 1.0' in metrics
        line = status["lines"]["xy"]
        for part in (line, *line["controllers"], *line["unit_ids"]["drives"].values()):
            for key, value in part.items():
                assert not isinstance(value, int) or isinstance(value, bool) or key in COUNTERS, key

        browser_page.goto(sick.address)
        until(browser_page, STATES, ["Drive silent", "Compensated"])
        words = browser_page.locator("#troubles li:first-child").inner_text()
        assert "its drive (unit id 1) has never answered in" in words
        assert "Check power, cable, unit id, baud rate and parity" in words
        until(
            browser_page, "document.querySelector('article.line .state').textContent", "1 of 2 drives silent"
        )
        shot(browser_page, "never-answered")
        client.close()


def test_a_drive_that_hangs_takes_the_green_from_its_axis_alone_and_gives_it_back(
    sick: SickLine, browser_page: Page
) -> None:
    with sick.running():
        client = Client(sick.cnc_port)

        def ask() -> None:
            client.read(1)
            client.read(2)

        for unit_id in (1, 2):
            assert client.move(unit_id, 40_000) == bytes.fromhex("10 0064 0002")
        sick.until(lambda status: status["axes"]["x"]["nominal_actual"] == 40.0, ask)
        assert sick.get("healthz")[0] == 200
        browser_page.goto(sick.address)
        until(browser_page, STATES, ["Compensated", "Compensated"])
        shot(browser_page, "well")

        sick.drives.health[1] = Health.SILENT
        trouble = sick.until_trouble("drive-silent", ask)
        assert trouble["what"].startswith("its drive (unit id 1) has not answered for ")
        assert kinds(sick.status()) == ["drive-silent"]
        assert sick.get("healthz")[0] == 503
        status = sick.until(lambda status: status["axes"]["x"]["nominal_actual"] is None, ask)
        last = status["axes"]["x"]["last_seen"]
        assert last["nominal"] == 40.0
        assert last["age_s"] >= 2.0  # a reading is shown as the place for 2 s
        until(browser_page, STATES, ["Drive silent", "Compensated"])
        until(browser_page, "document.querySelector('article.axis .digits').textContent", "40.000")
        until(browser_page, "document.querySelector('article.axis').dataset.known", "no")
        name = browser_page.locator("article.axis:first-of-type .reading-name").inner_text()
        assert name.startswith("Last seen ")
        assert name.endswith(" s ago")
        shot(browser_page, "hung")

        sick.drives.health[1] = Health.WELL
        sick.until(lambda status: not kinds(status), ask)
        assert sick.get("healthz") == (200, b"ok\n")
        until(browser_page, STATES, ["Compensated", "Compensated"])
        client.close()


def test_a_drive_that_answers_garbage_is_told_from_one_that_says_nothing(
    sick: SickLine, browser_page: Page
) -> None:
    sick.drives.health[1] = Health.GARBLED
    with sick.running():
        client = Client(sick.cnc_port)
        trouble = sick.until_trouble("drive-garbled", lambda: client.read(1))
        assert trouble["where"] == "axis x"
        assert trouble["remedy"].startswith("compare baud rate and parity with the drive")
        found = kinds(sick.status())
        assert "drive-silent" not in found
        assert "drive-damaged" not in found
        drive = sick.status()["lines"]["xy"]["unit_ids"]["drives"]["1"]
        assert drive["damaged_in_a_row"] == min(drive["timeouts_in_a_row"], 32)
        of = f"{drive['damaged_in_a_row']} of {drive['damaged_in_a_row']} replies were damaged"
        assert of in sick.status()["troubles"][0]["what"]
        code, body = sick.get("healthz")
        assert (code, b"sent no valid frame" in body) == (503, True)
        browser_page.goto(sick.address)
        until(browser_page, STATES, ["Drive not understood", "Compensated"])
        assert "has sent no valid frame" in browser_page.locator("#troubles li:first-child").inner_text()
        shot(browser_page, "garbled-drive")
        client.close()


def test_a_controller_port_from_which_nothing_whole_ever_came_is_named_with_its_count(
    sick: SickLine, browser_page: Page
) -> None:
    with sick.running():
        client = Client(sick.cnc_port)
        for number in range(1, 13):
            os.write(sick.plc.fd, GARBAGE)
            sick.until(
                lambda status: status["lines"]["xy"]["controllers"][2]["damaged"] == number,  # noqa: B023
                lambda: client.read(1),
            )
        trouble = sick.until_trouble("controller-garbled", lambda: client.read(1))
        assert trouble["where"] == "line xy, controller plc"
        assert trouble["what"] == f"all 12 frames from {sick.plc.path} were damaged"
        assert trouble["remedy"].startswith("compare baud rate and parity with the controller")
        assert kinds(sick.status()) == ["controller-garbled"]  # and not that many of them are damaged
        code, body = sick.get("healthz")
        assert (code, b"line xy, controller plc: all 12 frames" in body) == (503, True)
        browser_page.goto(sick.address)
        until(browser_page, STATES, ["Compensated", "Compensated"])  # its drives answer others
        assert "all 12 frames from" in browser_page.locator("#troubles").inner_text()
        until(browser_page, CONTROLLERS, ["connected", "not connected", "not understood: port open"])
        shot(browser_page, "garbled-controller")

        os.write(sick.plc.fd, bytes.fromhex("01 03 00 C8 00 02 45 F5"))  # a whole one: 1 of 13
        trouble = sick.until_trouble("controller-damaged", lambda: client.read(1))
        assert trouble["what"] == f"12 of 13 frames from {sick.plc.path} were damaged in the last minute"
        assert sick.get("healthz")[0] == 200
        client.close()


def test_two_controllers_that_want_one_axis_are_named(sick: SickLine, browser_page: Page) -> None:
    with sick.running():
        cnc, panel = Client(sick.cnc_port), Client(sick.panel_port)

        def both() -> None:
            assert cnc.move(1, 30_000) == bytes.fromhex("10 0064 0002")
            assert panel.move(1, 60_000) == bytes.fromhex("90 06")  # busy: another one moves it

        trouble = sick.until_trouble("two-writers", both)
        assert trouble["where"] == "axis x"
        assert trouble["what"].startswith("cnc (127.0.0.1) and panel (127.0.0.1) both try to move it: ")
        assert "requests were refused in" in trouble["what"]
        assert sick.get("healthz")[0] == 200  # commands reach the drive: those of one
        browser_page.goto(sick.address)
        until(browser_page, STATES, ["Two controllers", "Compensated"])
        shot(browser_page, "two-controllers")
        cnc.close()
        panel.close()


def test_a_controller_that_no_axis_hears_is_named_with_the_unit_ids(
    sick: SickLine, browser_page: Page
) -> None:
    with sick.running():
        cnc, panel = Client(sick.cnc_port), Client(sick.panel_port)

        def ask() -> None:
            cnc.read(1)
            cnc.read(2)
            assert panel.read(17) == CODE_NO_ANSWER

        trouble = sick.until_trouble("unheard-controller", ask)
        assert trouble["where"] == "line xy, controller panel"
        assert trouble["what"] == (
            "it addresses only unit id 17, which has no axis; "
            "the axes are axis x (unit id 1), axis y (unit id 2)"
        )
        browser_page.goto(sick.address)
        browser_page.wait_for_selector("#troubles >> text=Line xy, controller panel")
        shot(browser_page, "unheard-controller")
        cnc.close()
        panel.close()


def test_a_relay_that_is_frozen_leaves_nothing_green(sick: SickLine, browser_page: Page) -> None:
    with sick.running() as gateway:
        client = Client(sick.cnc_port)
        sick.until(lambda status: status["axes"]["x"]["nominal_actual"] is not None, lambda: client.read(1))
        browser_page.goto(sick.address)
        until(browser_page, STATES, ["Compensated", "Compensated"])
        until(browser_page, "document.getElementById('link').textContent", "Live")
        relay = children(gateway.process)["gateway.relay"]
        os.kill(relay, signal.SIGSTOP)
        try:
            trouble = sick.until_trouble("relay-silent", lambda: None)
            assert trouble["what"].startswith("the relay has reported nothing for ")
            assert trouble["what"].endswith(": the machine may not obey")
            assert kinds(sick.status()) == ["relay-silent"]
            code, body = sick.get("healthz")
            assert (code, b"the machine may not obey" in body) == (503, True)
            until(browser_page, STATES, ["Relay silent", "Relay silent"])
            until(
                browser_page, "document.getElementById('link').textContent", "Relay silent: it may not obey"
            )
            until(browser_page, "document.querySelector('article.line .state').textContent", "Not known")
            until(browser_page, CONTROLLERS, ["not known", "not known", "not known"])
            until(browser_page, "getComputedStyle(document.querySelector('main')).filter", "grayscale(1)")
            shot(browser_page, "frozen-relay")
        finally:
            os.kill(relay, signal.SIGCONT)
        client.close()
        again = Client(sick.cnc_port)  # what had waited while it stood still was given up, and its connection
        sick.until(lambda status: not kinds(status), lambda: again.read(1))
        until(browser_page, STATES, ["Compensated", "Compensated"])
        again.close()
