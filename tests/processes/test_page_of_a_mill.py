"""The page over a real gateway with simulated drives, in a real browser."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from tests.processes.mill import Controller, Mill
from tests.supervisor.http.doors import make_certificates
from tests.support.browser import started_browser
from tests.support.commands import typed

WAIT_MS = 100_000
DIGITS = "article.axis:first-of-type .digits"
TROUBLE = "#troubles"


@pytest.fixture
def mill(tmp_path: Path) -> Mill:
    return Mill(tmp_path)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with started_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def page(browser: Browser) -> Page:
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.set_default_timeout(WAIT_MS)
    return page


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
        assert "tables/cnc10x.tab:4: axis.x.table" in words
        assert str(mill.folder) not in words
        assert "Correct the file" in words
        table.write_text(good)
        gateway.until("table-mended")
        page.wait_for_selector("#verdict.well")
        assert page.locator(f"{TROUBLE} > *").count() == 0
        controller.end()
    page.wait_for_selector("#lost:not([hidden])")
    assert all("Failed to load resource" in text or "ERR_" in text for text in complaints), complaints


def test_frames_are_shown_in_words_to_whoever_asks_for_them(mill: Mill, page: Page) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    with mill.running():
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


# A person at a real browser: logs in over TLS, sees the mill, logs out; and is out when the token is.


LOGIN = "#form"
AXIS = "article.axis svg.drawing .line-forward"


class Guarded(Mill):
    """A mill whose page asks who looks, over TLS."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        make_certificates(folder)
        self.token_file = folder / "people.token"
        assert typed("token", str(self.token_file)).returncode == 0
        text = self.config.read_text().replace(
            "[line.xyz]",
            'tokens = [{ name = "people", file = "people.token" }]\n'
            'tls = { certificate = "page.crt", key = "page.key" }\n\n[line.xyz]',
            1,
        )
        self.config.write_text(text)
        self.address = self.address.replace("http://", "https://")


def visit(browser: Browser, mill: Guarded, complaints: list[str]) -> Page:
    context = browser.new_context(ignore_https_errors=True)  # the authority is this test's own
    page = context.new_page()
    page.set_default_timeout(WAIT_MS)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("console", lambda message: complaints.append(message.text))
    page.goto(mill.address)
    return page


def log_in(page: Page, token: str) -> None:
    page.fill("#token", token)
    page.click("#enter")


@pytest.mark.timeout(240)
def test_a_person_logs_in_looks_and_logs_out(browser: Browser, tmp_path: Path) -> None:
    mill = Guarded(tmp_path)
    complaints: list[str] = []
    with mill.running() as gateway:
        page = visit(browser, mill, complaints)
        page.wait_for_selector(LOGIN)
        log_in(page, "a wrong one of thirty-two characters")
        page.wait_for_selector("#problem:text-is('This gateway does not know this token.')")
        token = mill.token_file.read_text().strip()
        log_in(page, token)
        page.wait_for_selector(AXIS)
        page.wait_for_selector("body[data-link=live]")
        assert page.title() != "Log in · Pitch gateway"
        cookies = page.context.cookies()
        assert [(c["secure"], c["httpOnly"], c["sameSite"], c["domain"]) for c in cookies] == [
            (True, True, "Strict", "127.0.0.1")
        ]
        assert token not in page.url
        assert (
            page.evaluate("document.cookie + JSON.stringify(localStorage) + JSON.stringify(sessionStorage)")
            == "{}{}"
        )
        page.reload()
        page.wait_for_selector(AXIS)
        page.click("#logout")
        page.wait_for_selector(LOGIN)
        page.reload()
        page.wait_for_selector(LOGIN)

        log_in(page, token)
        page.wait_for_selector(AXIS)
        assert typed("token", str(mill.token_file), "--force").returncode == 0
        page.wait_for_selector(LOGIN)  # by itself, with the stream that ended
        log_in(page, mill.token_file.read_text().strip())
        page.wait_for_selector(AXIS)
        page.context.close()
    assert [what for what in complaints if "401" not in what] == []
    refused = [note for note in gateway.notes if note["event"] == "token-refused"]
    assert [(note["peer"], note["times"]) for note in refused] == [("127.0.0.1", 1)]
