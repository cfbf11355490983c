"""Standard error: nothing but JSON where the log is JSON, and priorities where the journal reads it."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.commands import typed
from tests.support.gateway import Site, site_in
from tests.support.processes import COMMAND, ROOT, SECONDS, children, started, typed_apart

BAD_TABLE = "no table"
KEPT = "axis x starts with the last good table"
ENTRY = re.compile(rb"<([346])>(.*)\n", re.DOTALL)
LEVELS = {b"3": "error", b"4": "warning", b"6": "info"}
"""syslog(3): LOG_ERR, LOG_WARNING, LOG_INFO."""


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with site_in(tmp_path) as site:
        yield site


def with_a_bad_table(site: Site) -> Site:
    """Let a start warn: the table is bad, and one of before is kept."""
    assert typed("check", "--compile", str(site.config)).returncode == 0
    site.table.write_text(BAD_TABLE)
    return site


def entries(log: bytes) -> list[tuple[bytes, bytes]]:
    """Return priority and text of each line; a line without a priority is a failure."""
    found = []
    for line in log.splitlines(keepends=True):
        entry = ENTRY.fullmatch(line)
        assert entry, line
        found.append((entry[1], entry[2]))
    return found


def log_in_journal(command: list[str], until: bytes = b"") -> list[tuple[bytes, bytes]]:
    """Run a command with a pipe that it takes for the journal; SIGTERM at the word ``until``."""
    ours, theirs = os.pipe()
    stream = os.fstat(theirs)
    environment = {**os.environ, "JOURNAL_STREAM": f"{stream.st_dev}:{stream.st_ino}"}
    with started(command, cwd=ROOT, stderr=theirs, env=environment) as process:
        os.close(theirs)
        log = b""
        with os.fdopen(ours, "rb") as lines:
            for line in lines:
                log += line
                if until and until in line:
                    process.send_signal(signal.SIGTERM)
                    until = b""
        process.wait(SECONDS)
    return entries(log)


def test_run_says_what_is_wrong_with_a_table_as_json_too(site: Site) -> None:
    with_a_bad_table(site)
    command = [*COMMAND, "run", str(site.config), "--log-format", "json"]
    notes = []
    with started(command, cwd=ROOT, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        for line in process.stderr:
            notes.append(json.loads(line))
            if notes[-1]["event"] == "ready":
                process.send_signal(signal.SIGTERM)
        assert process.wait(SECONDS) == 0
    said = [note for note in notes if note["event"] == "configuration-warning"]
    assert {note["level"] for note in said} == {"warning"}
    assert said[-1]["detail"] == f"{site.table}: {KEPT}"
    assert not any(note["detail"].startswith("warning") for note in said)


def test_relay_supervisor_and_run_name_the_gateway(site: Site) -> None:
    command = [*COMMAND, "run", str(site.config), "--log-format", "json"]
    whose = {}
    with started(command, cwd=ROOT, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        for line in process.stderr:
            note = json.loads(line)
            whose[note["event"]] = note.get("gateway")
            if note["event"] == "relay-reached":
                os.kill(children(process)["gateway.supervisor"], signal.SIGKILL)
            if note["event"] == "supervisor-ended":
                process.send_signal(signal.SIGTERM)
        assert process.wait(SECONDS) == 0
    words = ("line-up", "ready", "supervising", "relay-reached", "supervisor-ended")
    assert [whose[word] for word in words] == ["trial"] * len(words)


def test_two_processes_write_whole_lines_into_one_log() -> None:
    """Lines of 20 000 characters, by relay's writer and by sys.stderr; a pipe tears writes above 4096."""
    program = (
        "import sys\n"
        "from gateway.catalogue.entry import Severity\n"
        "from gateway.ipc.log import LogEntry, LogFormat, json_writer, take_standard_error\n"
        "take_standard_error(LogFormat.JSON)\n"
        "write = json_writer(sys.argv[1])\n"
        "for _ in range(200):\n"
        "    write(LogEntry(Severity.INFO, 'long', {'detail': 20_000 * sys.argv[1]}))\n"
        "    print(20_000 * sys.argv[1], file=sys.stderr)\n"
    )
    ours, theirs = os.pipe()
    commands = [[sys.executable, "-c", program, name] for name in ("a", "b")]
    with started(commands[0], cwd=ROOT, stderr=theirs), started(commands[1], cwd=ROOT, stderr=theirs):
        os.close(theirs)
        with os.fdopen(ours, "rb") as lines:
            notes = [json.loads(line) for line in lines]
    assert len(notes) == 2 * 400
    for note in notes:
        assert {*note["detail"]} - {*" …(20000 characters)"} <= {note["gateway"]}
        assert "… (20000 characters) …" in note["detail"]


def test_why_a_relay_does_not_start_names_the_gateway(site: Site) -> None:
    assert typed("check", "--compile", str(site.config)).returncode == 0
    with socket.create_server(("127.0.0.1", site.port)):
        ended = typed_apart("relay", str(site.config), "--log-format", "json")
    assert ended.returncode == 1
    notes = [json.loads(line) for line in ended.stderr.splitlines()]
    assert notes[-1]["event"] == "standard-error"
    assert "in use" in notes[-1]["detail"]
    assert {note.get("gateway") for note in notes} == {"trial"}


@pytest.mark.parametrize("command", ["run", "relay", "supervise"])
def test_why_nothing_starts_is_json_too(site: Site, command: str) -> None:
    site.config.write_text("[gateway]\nstate = 7\n")
    ended = typed_apart(command, str(site.config), "--log-format", "json")
    assert ended.returncode == 1
    notes = [json.loads(line) for line in ended.stderr.splitlines()]
    assert {(note["event"], note["level"]) for note in notes} == {("standard-error", "error")}
    assert any("gateway.state" in note["detail"] for note in notes)


def test_what_a_relay_that_cannot_start_says_is_json_too(site: Site) -> None:
    ended = typed_apart("relay", str(site.config), "--log-format", "json")
    [note] = map(json.loads, ended.stderr.splitlines())
    assert ended.returncode == 1
    assert "it has not been compiled yet" in note["detail"]


def test_a_person_is_told_in_plain_lines(site: Site) -> None:
    ended = typed_apart("relay", str(site.config), "--log-format", "console")
    assert ended.stderr.startswith(f"{site.config}: it has not been compiled yet")


@pytest.mark.parametrize("log_format", ["json", "console"])
def test_each_line_of_run_has_its_priority_in_the_journal(site: Site, log_format: str) -> None:
    with_a_bad_table(site)
    text = site.config.read_text()
    assert 'compensation = "on"' in text
    site.config.write_text(text.replace('compensation = "on"', 'compensation = "shadow"'))
    log = log_in_journal(
        [*COMMAND, "run", str(site.config), "--log-format", log_format], until=b"relay-reached"
    )
    if log_format == "json":
        for priority, line in log:
            assert json.loads(line)["level"] == LEVELS[priority]
    by_word = {word: {number for number, line in log if word in line} for word in (b"ready", b"shadow")}
    assert b"6" in by_word[b"ready"]
    assert b"4" in by_word[b"shadow"]
    assert {number for number, line in log if KEPT.encode() in line} == {b"4"}


@pytest.mark.parametrize(
    "command", [("relay",), ("supervise",), ("check", "--compile"), ("reload",), ("run",)], ids=" ".join
)
def test_what_stops_a_unit_is_an_error_in_the_journal(site: Site, command: tuple[str, ...]) -> None:
    site.config.write_text("[gateway]\nstate = 7\n")
    log = log_in_journal([*COMMAND, *command, str(site.config)])
    assert {number for number, _ in log} == {b"3"}


@pytest.mark.parametrize("log_format", ["json", "console"])
def test_each_line_of_a_traceback_has_its_priority(log_format: str) -> None:
    """An exception that nobody catches; in JSON it is one line."""
    program = (
        "from gateway.ipc.log import LogFormat, take_standard_error\n"
        f"take_standard_error(LogFormat({log_format!r}))\n"
        "raise RuntimeError('a mistake\\nof two lines')\n"
    )
    log = log_in_journal([sys.executable, "-c", program])
    assert {number for number, _ in log} == {b"3"}
    if log_format == "json":
        [(_, line)] = log
        note = json.loads(line)
        assert (note["event"], note["level"]) == ("unexpected", "error")
        assert note["traceback"].endswith("RuntimeError: a mistake\nof two lines\n")
    else:
        assert [line for _, line in log[-2:]] == [b"RuntimeError: a mistake", b"of two lines"]


def test_a_stream_that_is_not_the_journal_gets_no_priorities(site: Site) -> None:
    """The variable is inherited by whoever redirects the log: it names another stream then."""
    environment = {**os.environ, "JOURNAL_STREAM": "1:1"}
    command = [*COMMAND, "check", str(site.config)]
    site.config.write_text("[gateway]\nstate = 7\n")
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, env=environment, check=False)
    assert ended.returncode == 1
    assert ended.stderr.startswith(str(site.config).encode())
