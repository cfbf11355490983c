"""The lines of the log: the relay's, those of supervisor and commands, and those for people."""

import json
import math
import re
import sys
from collections.abc import Callable
from select import PIPE_BUF
from typing import Any

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


def strict(line: str) -> dict[str, Any]:
    """Read JSON as every other program does: without NaN."""

    def refuse(constant: str) -> None:
        raise ValueError(constant)

    found: dict[str, Any] = json.loads(line, parse_constant=refuse)
    return found


def named() -> StructuredLog:
    log = StructuredLog(LogFormat.JSON)
    log.name_gateway("mill-1")
    return log


@pytest.mark.parametrize("write", [json_writer, lambda name: named().write], ids=["relay", "supervisor"])
def test_a_line_of_json_says_of_which_gateway_line_and_axis_it_is(
    write: Callable[[str], Callable[[LogEntry], None]], capfd: pytest.CaptureFixture[str]
) -> None:
    write("mill-1")(WARNING)
    assert capfd.readouterr().err == (
        '{"gateway": "mill-1", "line": "xyz", "axis": "x", "timestamp": "1970-01-01T00:00:00.000+00:00", '
        '"event": "line-down", "level": "warning"}\n'
    )


@pytest.mark.parametrize("write", [json_writer, lambda name: named().write], ids=["relay", "supervisor"])
def test_a_long_line_of_json_is_shortened_to_one_write_of_a_pipe(
    write: Callable[[str], Callable[[LogEntry], None]], capfd: pytest.CaptureFixture[str]
) -> None:
    """Each of both fields is too long by itself; "ü" takes six bytes in JSON."""
    fields = {"axis": "x", "traceback": "Traceback" + 5000 * "ü" + "the end", "list": 1000 * ["abc"]}
    write("mill-1")(LogEntry(Severity.ERROR, "unexpected", fields, 0.0))
    line = capfd.readouterr().err
    assert len(line) <= PIPE_BUF
    found = strict(line)
    assert (found["gateway"], found["axis"], found["event"]) == ("mill-1", "x", "unexpected")
    assert re.fullmatch(r"Tracebackü+ … \(5016 characters\) … ü+the end", found["traceback"])
    assert re.fullmatch(r'\["abc", .* … \(7000 characters\) … .*"abc"\]', found["list"])


def test_as_much_of_a_long_field_is_kept_as_a_line_has_room_for(capfd: pytest.CaptureFixture[str]) -> None:
    json_writer("mill-1")(LogEntry(Severity.ERROR, "unexpected", {"detail": 9000 * "d"}, 0.0))
    assert 3900 < len(capfd.readouterr().err) <= PIPE_BUF


def test_a_line_of_very_many_fields_stays_json(capfd: pytest.CaptureFixture[str]) -> None:
    json_writer("mill-1")(LogEntry(Severity.INFO, "many", {f"field-{n}": n for n in range(1000)}, 0.0))
    line = capfd.readouterr().err
    assert len(line) <= PIPE_BUF
    assert strict(line)


def test_a_number_that_is_not_finite_is_null(capfd: pytest.CaptureFixture[str]) -> None:
    fields = {"a": math.nan, "b": [math.inf, 1.5], "c": {"d": -math.inf}}
    json_writer("mill-1")(LogEntry(Severity.INFO, "odd", fields, 0.0))
    found = strict(capfd.readouterr().err)
    assert (found["a"], found["b"], found["c"]) == (None, [None, 1.5], {"d": None})


def test_a_long_line_for_people_is_cut(capfd: pytest.CaptureFixture[str]) -> None:
    log = StructuredLog(LogFormat.CONSOLE)
    log.write(LogEntry(Severity.INFO, "ready", {"detail": 3000 * "ü"}, 0.0))
    line = capfd.readouterr().err
    assert len(line.encode()) <= PIPE_BUF
    assert re.search(r"ü… \(\d+ bytes\)\n$", line)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(NOTES)
def test_relay_and_supervisor_write_the_same_lines(capfd: pytest.CaptureFixture[str], note: LogEntry) -> None:
    json_writer("mill-1")(note)
    ours = capfd.readouterr().err
    named().write(note)
    assert capfd.readouterr().err == ours
    assert strict(ours)["event"] == note.event
    assert len(ours) <= PIPE_BUF


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
