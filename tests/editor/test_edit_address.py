"""``pitch-gateway table edit`` as a process: who reaches its page, and when it ends."""

import signal
import sys
from pathlib import Path

import pytest

from tests.editor.desk import UP_TO_HOME
from tests.editor.program import editing
from tests.support.commands import typed
from tests.support.processes import ROOT, SECONDS, eventually


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "cnc10x.tab"
    path.write_text(UP_TO_HOME)
    return path


def test_only_the_page_of_this_computer_gets_an_answer(file: Path) -> None:
    with editing(file) as program:
        assert program.first.startswith(f"{file}: http://127.0.0.1:")
        assert program.hint == "close the tab, or press Ctrl-C, to end"
        page = f"/{program.token}/"
        status, headers, body = program.ask("GET", page)
        assert (status, body[:15]) == (200, b"<!DOCTYPE html>")
        assert headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self';")
        assert (headers["Cache-Control"], headers["Referrer-Policy"]) == ("no-store", "no-referrer")
        assert headers["Set-Cookie"] is None
        for path, wanted in (
            ("/", 404),
            ("/favicon.ico", 404),
            (f"/{program.token[:-1]}A/", 404),
            (f"{page}../editing.py", 404),
            (f"{page}editing.py", 404),
            (f"{page}editor.js", 200),
        ):
            assert program.ask("GET", path)[0] == wanted, path
        port = program.host.rpartition(":")[2]
        for host in ("evil.example", f"evil.example:{port}", f"localhost:{port}", "127.0.0.1"):
            assert program.ask("GET", page, Host=host)[0] == 421, host
        show = b'{"do": "show"}'
        origin = f"http://{program.host}"
        for body, headers_sent, wanted in (
            (show, {}, 400),
            (show, {"Origin": "http://evil.example"}, 400),
            (show, {"Origin": origin}, 200),
            (show, {"Origin": "null", "Sec-Fetch-Site": "same-site"}, 400),
            (show, {"Origin": "null", "Sec-Fetch-Site": "same-origin"}, 200),
            (b"x" * 5000, {"Origin": origin}, 400),
            (b'{"do": "format"}', {"Origin": origin}, 400),
            (b'{"do": "change", "value": 1e999}', {"Origin": origin}, 400),
            (b'{"do": "change", "way": "up"}', {"Origin": origin}, 400),
        ):
            assert program.ask("POST", f"{page}do", body, **headers_sent)[0] == wanted, (body, headers_sent)
        assert program.ask("POST", f"{page}elsewhere", show, Origin=origin)[0] == 404
        program.process.send_signal(signal.SIGINT)
        assert program.process.wait(SECONDS) == 0
        assert (program.line(), program.line()) == ("", f"{file}: not changed")
    assert file.read_text() == UP_TO_HOME


def test_it_ends_when_its_tab_is_closed_but_not_with_changes_that_would_be_lost(file: Path) -> None:
    with editing(file) as program:
        with program.tab():
            status, state = program.do(do="change", index=0, way="forward", value=7.0)
            assert (status, state["now"]["forward"][0]) == (200, 7.0)
        said = program.line()
        assert said.startswith(
            f"not saved yet: open http://{program.host}/{program.token}/ again, or press Ctrl-C"
        )
        with program.tab():
            assert program.do(do="show")[1]["now"]["forward"][0] == 7.0
            assert program.do(do="save")[1]["said"].startswith("cnc10x.tab is saved")
        assert program.process.wait(SECONDS) == 0
        assert program.line() == f"{file}: saved; the old file is cnc10x.tab.bak"


def test_a_browser_is_opened_at_the_address(file: Path, tmp_path: Path) -> None:
    browser, asked = tmp_path / "browser", tmp_path / "asked"
    browser.write_text(f'#!/bin/sh\necho "$1" > {asked}.part && mv {asked}.part {asked}\n')
    browser.chmod(0o700)
    with editing(file, "--axis", "x", BROWSER=f"{browser} %s") as program:
        eventually(asked.exists, bool)
        assert program.first == f"{file}: {asked.read_text().strip()}"


def test_it_needs_nothing_that_is_unix_only(file: Path) -> None:
    with editing(file, program=[sys.executable, "-m", "tests.support.without_unix"]) as program:
        assert program.ask("GET", f"/{program.token}/chart.js")[0] == 200
        program.do(do="change", index=0, way="forward", value=7.0)
        status, state = program.do(do="save")
        assert (status, state["is_changed"]) == (200, False)
    assert file.with_name("cnc10x.tab.bak").read_text() == UP_TO_HOME
    assert "+0.00700000" in file.read_text()


def test_what_cannot_be_edited_is_refused_before_a_page_is_there(tmp_path: Path) -> None:
    file = ROOT / "tables/renishaw/x.ren"
    found = typed(
        "table", "edit", str(file), "--units", "mm", "--file-counts-per-unit", "1000", "--no-browser"
    )
    assert (found.returncode, found.stdout) == (1, "")
    assert found.stderr.startswith(
        f"error: {file}: format renishaw-ren, which is read, not written; allowed: "
    )
    missing = typed("table", "edit", str(tmp_path / "x.tab"), "--no-browser")
    assert (missing.returncode, missing.stderr.count("\n")) == (1, 1)
