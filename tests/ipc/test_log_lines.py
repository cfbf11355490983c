"""The lines of the log: the relay's own and those of structlog, which supervisor and commands write."""

import json
import sys
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.catalogue.entry import Severity
from gateway.ipc.log import LogEntry, LogFormat, json_writer
from gateway.ipc.structured_log import StructuredLog

WARNING = LogEntry(Severity.WARNING, "line-down", {"line": "xyz", "axis": "x"}, 0.0)
NOTES = st.builds(
    LogEntry,
    st.sampled_from(Severity),
    st.text(),
    st.dictionaries(
        st.text() | st.sampled_from(["event", "level", "timestamp", "gateway", "self", "method_name"]),
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats()
        | st.text()
        | st.lists(st.text())
        | st.binary(),
    ),
    st.floats(0.0, 4e9),
)
"""Also fields that no event has: the relay may be of another release."""


def named() -> StructuredLog:
    log = StructuredLog(LogFormat.JSON)
    log.name_gateway("mill-1")
    return log


@pytest.mark.parametrize("write", [json_writer, lambda name: named().write], ids=["relay", "structlog"])
def test_a_line_of_json_says_of_which_gateway_line_and_axis_it_is(
    write: Callable[[str], Callable[[LogEntry], None]], capfd: pytest.CaptureFixture[str]
) -> None:
    write("mill-1")(WARNING)
    assert capfd.readouterr().err == (
        '{"gateway": "mill-1", "line": "xyz", "axis": "x", "timestamp": "1970-01-01T00:00:00.000+00:00", '
        '"event": "line-down", "level": "warning"}\n'
    )


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(NOTES)
def test_relay_and_structlog_write_the_same_lines(capfd: pytest.CaptureFixture[str], note: LogEntry) -> None:
    json_writer("mill-1")(note)
    ours = capfd.readouterr().err
    named().write(note)
    assert capfd.readouterr().err == ours
    assert json.loads(ours)["event"] == note.event


def test_before_a_configuration_is_read_a_line_names_no_gateway(capfd: pytest.CaptureFixture[str]) -> None:
    log = StructuredLog(LogFormat.JSON)
    log.write(WARNING)
    assert "gateway" not in json.loads(capfd.readouterr().err)
    log.name_gateway("mill-1")
    log.write(WARNING)
    assert json.loads(capfd.readouterr().err)["gateway"] == "mill-1"


def test_a_person_reads_plain_lines(capfd: pytest.CaptureFixture[str]) -> None:
    log = StructuredLog(LogFormat.CONSOLE)
    log.name_gateway("mill-1")
    log.write(LogEntry(Severity.INFO, "ready", {"addresses": "127.0.0.1:1502"}, 0.0))
    line = capfd.readouterr().err
    assert "ready" in line
    assert "127.0.0.1:1502" in line
    assert "mill-1" not in line
    assert "\x1b" not in line or sys.stderr.isatty()


def test_without_standard_error_nothing_is_written(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    named().write(WARNING)
    json_writer("mill-1")(WARNING)
    assert capfd.readouterr().err == ""
