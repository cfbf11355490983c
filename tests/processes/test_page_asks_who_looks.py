"""A person at a real browser: logs in over TLS, sees the mill, logs out; and is out when the token is."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from tests.processes.mill import Mill
from tests.supervisor.http.doors import make_certificates
from tests.support.browser import started_browser
from tests.support.commands import typed

WAIT_MS = 100_000
LOGIN = "#form"
AXIS = "article.axis svg.drawing .line-forward"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with started_browser() as browser:
        yield browser


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
        page.wait_for_selector("#problem:text-is('That is no token of this gateway.')")
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
        assert gateway.end() == 0
    assert [what for what in complaints if "401" not in what] == []
    refused = [note for note in gateway.notes if note["event"] == "token-refused"]
    assert [(note["peer"], note["times"]) for note in refused] == [("127.0.0.1", 1)]
