"""The whole status model, and what is wrong according to it."""

import re
import time
from copy import deepcopy
from datetime import UTC, datetime
from typing import Any

import pytest

from gateway.catalogue.alarms import ALARMS, HIDES
from gateway.config.problems import Problem
from gateway.supervisor.active_alarms import STALE_S
from gateway.supervisor.model import NO_LIMITS, Limits, whole_model
from gateway.supervisor.outcome import ReloadOutcome
from gateway.supervisor.recent_history import RecentHistory
from gateway.supervisor.table_files import FileState, TableFileEntry, TableFiles
from tests.support.status_models import plain, relay_model_of, supervisor_of

AXIS: dict[str, Any] = {
    "compensation": "active",
    "table": {"file": "x.tab", "points": 3, "status": "active", "error": None, "compiled": "ab"},
    "latency": {"is_over_budget": False, "budget_us": 1000.0},
}
SNAPSHOT: dict[str, Any] = {
    "gateway": {"name": "mill-1", "version": "1", "relay": "up", "snapshot_age_s": 0.0, "uptime_s": 5.0},
    "lines": {"xyz": {"state": "up", "drives": {"address": "127.0.0.1:502", "failure": None}}},
    "axes": {"x": AXIS},
}
WELL: dict[str, Any] = {
    name: {"problem": None}
    for name in ("configuration", "tables_folder", "state_folder", "http", "mqtt", "alarm_output")
}
WAITING = TableFileEntry("y.tab", FileState.WAITING)
FULL = ("gateway.state: No space left on device",)
REJECTED = Problem("tables/x.tab", "axis.x.table", "no number", "a number", 7)


def model(
    snapshot: dict[str, Any] | None = SNAPSHOT,
    outcome: ReloadOutcome | None = None,
    *,
    moving: frozenset[str] = frozenset(),
    overdue: frozenset[str] = frozenset(),
    age_s: float | None = 0.1,
    is_up: bool = True,
    supervisor: dict[str, Any] | None = WELL,
    silent_after_s: Limits = NO_LIMITS,
    recent: RecentHistory | None = None,
    file: str | None = "x.tab",
) -> dict[str, Any]:
    table_files = TableFiles()
    table_files.enter({} if file is None else {"x": file}, outcome or ReloadOutcome())
    return plain(
        whole_model(
            "mill-1",
            None if snapshot is None else relay_model_of(snapshot),
            is_relay_up=is_up,
            snapshot_age_s=age_s,
            tables=table_files.entries(moving, overdue),
            supervisor=None if supervisor is None else supervisor_of(supervisor),
            silent_after_s=silent_after_s,
            recent=recent,
        )
    )


def kinds(found: dict[str, Any]) -> list[tuple[str, str, str]]:
    return [(trouble["severity"], trouble["kind"], trouble["where"]) for trouble in found["troubles"]]


def said(found: dict[str, Any], severity: str, kind: str, where: str) -> str:
    """Return what is said of the only trouble, which is this one."""
    assert kinds(found) == [(severity, kind, where)]
    return str(found["troubles"][0]["what"])


def begins_with_a_word(remedy: str) -> bool:
    """Neither a key nor a command may stand first: the page writes the first letter large."""
    return not re.match(r"pitch-gateway|\S+ = ", remedy)


def with_axis(**changes: Any) -> dict[str, Any]:
    snapshot = deepcopy(SNAPSHOT)
    snapshot["axes"]["x"].update(changes)
    return snapshot


def test_a_gateway_that_is_well_has_no_troubles_and_says_what_the_relay_says() -> None:
    found = model()
    assert found["troubles"] == []
    assert found["lines"] == plain(relay_model_of(SNAPSHOT))["lines"]
    table = found["axes"]["x"]["table"]
    assert {key: table[key] for key in (*AXIS["table"], "problems")} == {**AXIS["table"], "problems": []}


def test_what_the_relay_said_is_not_changed() -> None:
    told = relay_model_of(SNAPSHOT)
    own, tables = supervisor_of(WELL), {"x": WAITING}
    whole_model("m", told, is_relay_up=False, snapshot_age_s=9.0, tables=tables, supervisor=own)
    assert told == relay_model_of(SNAPSHOT)


def test_a_rejected_file_says_its_first_problem_and_keeps_what_the_relay_has() -> None:
    found = model(outcome=ReloadOutcome(rejected={"x": (REJECTED,)}))
    table = found["axes"]["x"]["table"]
    assert (table["status"], table["points"]) == ("rejected", 3)
    assert table["error"] == "tables/x.tab:7: axis.x.table: no number; a number"
    assert table["problems"][0]["line"] == 7
    assert (
        said(found, "error", "table-rejected", "axis x")
        == f"{table['error']} (the last good table of 3 points stays)"
    )


def test_a_file_that_was_removed_counts_more_than_what_it_leads_to() -> None:
    gone = with_axis(compensation="no-table", table={"status": "none"})
    found = model(gone, ReloadOutcome(absent=frozenset("x")))
    assert found["axes"]["x"]["table"]["status"] == "removed"
    assert kinds(found) == [("warning", "table-removed", "axis x")]


@pytest.mark.parametrize(
    ("sha256", "outcome", "status"),
    [
        ("f" * 64, ReloadOutcome(digests={"x": "f" * 64}, problems=FULL), "active"),
        ("e" * 64, ReloadOutcome(digests={"x": "f" * 64}, problems=FULL), "waiting"),
        (None, ReloadOutcome(digests={"x": "f" * 64}, problems=FULL), "waiting"),
        ("e" * 64, ReloadOutcome(absent=frozenset("x"), problems=FULL), "waiting"),
        # It was handed over, and the relay has not reported since.
        ("e" * 64, ReloadOutcome(digests={"x": "f" * 64}), "active"),
    ],
    ids=["in force", "another is", "none is", "its table still is", "handed over"],
)
def test_a_file_is_not_called_what_it_would_be_if_it_could_be_applied(
    sha256: str | None, outcome: ReloadOutcome, status: str
) -> None:
    """A full disk, or a relay that refuses a table."""
    found = model(with_axis(table={**AXIS["table"], "sha256": sha256}), outcome)
    assert found["axes"]["x"]["table"]["status"] == status


def test_a_file_that_is_being_saved_is_waited_for_without_alarm() -> None:
    found = model(moving=frozenset("x"))
    assert found["axes"]["x"]["table"]["status"] == "waiting"
    assert found["troubles"] == []


def test_a_file_that_has_waited_for_very_long_is_an_alarm_with_every_reader() -> None:
    found = model(moving=frozenset("x"), overdue=frozenset("x"))
    assert found["axes"]["x"]["table"]["status"] == "waiting"
    what = "x.tab is not taken: for more than 30 s it has changed, or a program has had it open for writing"
    assert said(found, "warning", "table-waiting", "axis x") == what
    assert found["axes"]["x"]["verdict"]["state"] == found["verdict"]["state"] == "warning"


def test_a_bad_file_that_is_being_saved_again_keeps_its_problem_until_it_has_been_read() -> None:
    found = model(outcome=ReloadOutcome(rejected={"x": (REJECTED,)}), moving=frozenset("x"))
    assert found["axes"]["x"]["table"]["status"] == "waiting"
    assert found["axes"]["x"]["table"]["error"]


@pytest.mark.parametrize(
    ("compensation", "severity"),
    [
        ("blocked", "error"),
        ("unreferenced", "warning"),
        ("off", "warning"),
        ("shadow", "warning"),
        ("no-table", "warning"),
    ],
)
def test_an_axis_that_is_not_corrected_is_a_trouble(compensation: str, severity: str) -> None:
    found = model(with_axis(compensation=compensation))
    assert kinds(found) == [(severity, compensation, "axis x")]
    assert begins_with_a_word(found["troubles"][0]["remedy"])


BARE: dict[str, Any] = {"status": "none"}


def test_an_axis_that_is_not_to_be_corrected_is_well() -> None:
    axis = with_axis(compensation="off", table=BARE, configured={"compensation": "off"})
    found = model(axis, file=None)
    assert found["troubles"] == []
    assert found["axes"]["x"]["verdict"]["kind"] == "off"
    assert kinds(model(axis)) == [("warning", "off", "axis x")]  # its configuration names a table


def test_an_axis_without_a_table_is_not_to_be_switched_on() -> None:
    """``enable`` refuses it: what it needs is a table."""
    found = model(with_axis(compensation="off", table=BARE, configured={"compensation": "on"}), file=None)
    assert kinds(found) == [("warning", "no-table", "axis x")]
    assert "pitch-gateway enable" not in found["troubles"][0]["remedy"]


@pytest.mark.parametrize("compensation", ["blocked", "off"])
def test_a_rejected_file_does_not_hide_that_the_axis_is_not_corrected(compensation: str) -> None:
    found = model(with_axis(compensation=compensation), ReloadOutcome(rejected={"x": (REJECTED,)}))
    assert {kind for _, kind, _ in kinds(found)} == {"table-rejected", compensation}


NO_GAIN = {"forward": 0.0, "backward": 0.0}
HALF = {"forward": 0.5, "backward": 0.5}
WHOLE = {"forward": 1.0, "backward": 1.0}


def test_an_axis_that_is_off_by_its_gain_says_so() -> None:
    found = model(with_axis(compensation="off", gain=NO_GAIN, configured={"gain": NO_GAIN}))
    assert said(found, "warning", "off", "axis x") == "the gain is 0: positions pass uncorrected"


@pytest.mark.parametrize(
    ("gain", "configured", "what"),
    [
        (HALF, WHOLE, "the gain is 0.5; the configuration says 1"),
        (WHOLE, NO_GAIN, "the gain is 1; the configuration says 0"),
        (
            {"forward": 0.0, "backward": 1.0},
            WHOLE,
            "the gain is 0 forward and 1 backward; the configuration says 1",
        ),
    ],
)
def test_another_gain_than_the_configured_one_is_a_trouble(
    gain: dict[str, float], configured: dict[str, float], what: str
) -> None:
    found = model(with_axis(gain=gain, configured={"gain": configured}))
    assert said(found, "warning", "gain-differs", "axis x") == what
    assert found["axes"]["x"]["verdict"]["state"] == "warning"


def test_a_gain_that_is_configured_or_has_no_table_is_none() -> None:
    assert kinds(model(with_axis(gain=HALF, configured={"gain": HALF}))) == []
    without = {**AXIS["table"], "points": 0}
    assert kinds(model(with_axis(gain=HALF, configured={"gain": WHOLE}, table=without))) == []


def test_an_axis_that_started_without_its_record_is_not_healthy() -> None:
    found = model(with_axis(reads_uncorrected=True))
    assert "not corrected until its first target" in said(found, "warning", "record-not-used", "axis x")
    verdict = found["axes"]["x"]["verdict"]
    assert (verdict["state"], verdict["title"]) == ("warning", "Reads uncorrected")


def test_an_axis_whose_record_cannot_be_kept_is_not_healthy() -> None:
    found = model(with_axis(record_problem="axis-x.record: No space left on device"))
    assert said(found, "warning", "record-not-kept", "axis x") == (
        "axis-x.record: No space left on device: a restart begins without its record"
    )


@pytest.mark.parametrize("compensation", ["active", "blending"])
def test_an_axis_that_does_what_it_should_is_none(compensation: str) -> None:
    assert kinds(model(with_axis(compensation=compensation))) == []


def with_terms(**changes: Any) -> dict[str, Any]:
    """An axis whose sensor is heard and whose other axes are known, but for the changes."""
    thermal = {"state": "following", "is_silent": False, **changes.get("thermal", {})}
    cross = {"state": "following", "axes": ["y"], **changes.get("cross", {})}
    is_too_large = changes.get("is_too_large", False)
    return with_axis(terms={"is_too_large": is_too_large, "thermal": thermal, "cross": cross})


@pytest.mark.parametrize(
    ("terms", "trouble", "what"),
    [
        (
            {"thermal": {"state": "waiting", "is_silent": True}},
            "sensor-silent",
            "no temperature since the start: no thermal correction",
        ),
        (
            {"thermal": {"state": "held", "is_silent": True}},
            "sensor-silent",
            "the temperature sensor gives no value: the last one is held",
        ),
        (
            {"cross": {"state": "fading", "axes": ["y"]}},
            "other-axis-unknown",
            "the position of axis y is unknown; its correction returns to 0",
        ),
        (
            {"cross": {"state": "faded", "axes": ["y", "z"]}},
            "other-axis-unknown",
            "the position of one of the axes y, z is unknown; its correction is 0",
        ),
        (
            {"is_too_large": True},
            "term-too-large",
            "table, temperature and other axes together exceed max_correction; the last two no longer follow",
        ),
    ],
)
def test_terms_that_do_not_follow_are_a_warning(terms: dict[str, Any], trouble: str, what: str) -> None:
    found = model(with_terms(**terms))
    assert said(found, "warning", trouble, "axis x") == what
    assert begins_with_a_word(found["troubles"][0]["remedy"])


@pytest.mark.parametrize(
    "terms",
    [{}, {"thermal": {"state": "waiting"}}, {"cross": {"state": "waiting"}}, {"cross": {"state": "held"}}],
)
def test_terms_that_follow_or_have_just_begun_to_wait_are_none(terms: dict[str, Any]) -> None:
    assert kinds(model(with_terms(**terms))) == []


def test_an_axis_without_terms_has_no_trouble_with_them() -> None:
    assert kinds(model(with_axis(terms=None))) == []


def test_errors_come_first() -> None:
    snapshot = with_axis(compensation="unreferenced", latency={"is_over_budget": True, "budget_us": 500.0})
    snapshot["lines"]["xyz"] = {"state": "down", "drives": {"address": "a:1", "failure": "refused"}}
    found = model(snapshot)
    assert kinds(found) == [
        ("error", "line-down", "line xyz"),
        ("warning", "unreferenced", "axis x"),
        ("warning", "over-budget", "axis x"),
    ]
    assert found["troubles"][0]["what"] == "the drives at a:1 cannot be reached: refused"


def test_a_relay_that_is_gone_or_silent_is_an_error() -> None:
    gone = model(is_up=False, age_s=60.0)
    assert kinds(gone) == [("error", "relay-down", "gateway")]
    assert gone["gateway"]["relay"] == "down"
    assert gone["gateway"]["snapshot_age_s"] == 60.0
    assert kinds(model(age_s=STALE_S)) == []
    assert kinds(model(age_s=STALE_S + 0.1)) == [("error", "relay-silent", "gateway")]


def test_before_the_relay_was_reached_there_is_a_model_too() -> None:
    found = model(None, is_up=False, age_s=None)
    assert (found["lines"], found["axes"], found["gateway"]["name"]) == ({}, {}, "mill-1")
    assert kinds(found) == [("error", "relay-down", "gateway")]


@pytest.mark.parametrize(
    "where", ["configuration", "tables_folder", "state_folder", "http", "mqtt", "alarm_output"]
)
def test_what_troubles_the_supervisor_is_a_warning(where: str) -> None:
    found = model(supervisor={**WELL, where: {"problem": "it is so"}})
    assert said(found, "warning", where, where.replace("_", " ")) == "it is so"


def test_every_trouble_says_what_to_do() -> None:
    snapshot = with_axis(compensation="blocked", latency={"is_over_budget": True, "budget_us": 500.0})
    problems = {name: {"problem": "so"} for name in WELL}
    found = model(snapshot, is_up=False, supervisor=problems)
    assert len(found["troubles"]) == 7  # of a relay that is away nobody knows whether the axis is blocked
    assert all(trouble["remedy"] and trouble["what"] for trouble in found["troubles"])
    assert all(begins_with_a_word(trouble["remedy"]) for trouble in found["troubles"])


def with_unit_ids(heard: list[int], strangers: list[int], requests: dict[str, int]) -> dict[str, Any]:
    snapshot = deepcopy(SNAPSHOT)
    axes = {"x": 1, "y": 2}
    snapshot["lines"]["xyz"]["unit_ids"] = {
        "axes": axes,
        "heard": heard,
        "strangers": strangers,
        "requests": requests,
    }
    return snapshot


def test_a_unit_id_without_an_axis_beside_an_axis_that_hears_nothing_names_both() -> None:
    found = model(with_unit_ids([1, 17], [17], {"17": 5}))
    assert said(found, "warning", "wrong-unit-id", "line xyz") == (
        "controllers address unit id 17, which has no axis; axis y (unit_id 2) gets no requests"
    )


def test_a_unit_id_without_an_axis_is_a_trouble_until_it_is_named() -> None:
    found = model(with_unit_ids([1, 2, 17], [17], {"17": 5}))
    assert said(found, "warning", "unknown-unit", "line xyz") == (
        "controllers address unit id 17 (5 requests), which has no axis"
    )
    assert kinds(model(with_unit_ids([1, 2, 17], [], {}))) == []
    assert kinds(model(with_unit_ids([1, 2, 17], [17], {}))) == []  # another device on a wire


def test_an_axis_that_nobody_has_talked_to_yet_is_no_trouble() -> None:
    assert kinds(model(with_unit_ids([1], [], {}))) == []


def test_a_drive_that_answers_as_another_is_a_trouble() -> None:
    snapshot = deepcopy(SNAPSHOT)
    snapshot["lines"]["xyz"]["wrong_units"] = 3
    assert kinds(model(snapshot)) == [("warning", "answers-as-another", "line xyz")]


def test_an_adapter_that_returns_what_is_sent_is_named_and_not_its_damage() -> None:
    snapshot = with_drive({**ANSWERS, "damaged_minute": 12})
    snapshot["lines"]["xyz"]["minute"] = {"exchanges": 100, "damaged": 12}
    assert kinds(model(snapshot)) == [("warning", "drive-damaged", "line xyz, unit id 1")]
    snapshot["lines"]["xyz"]["drives"] |= {
        "address": "/dev/ttyUSB0",
        "echo": "set echo = true: the adapter returns what is sent",
    }
    found = model(snapshot)
    assert (
        said(found, "error", "adapter-echoes", "line xyz")
        == "/dev/ttyUSB0: set echo = true: the adapter returns what is sent"
    )


OTHER_ID: dict[str, Any] = {
    "silent_s": 12.4,
    "timeouts_in_a_row": 4,
    "other_ids_in_a_row": 4,
    "answers_with": "answers, with transaction id 0 (asked with 4)",
}


def test_a_drive_that_answers_with_another_transaction_id_is_not_called_silent() -> None:
    found = model(with_drive(OTHER_ID))
    assert said(found, "error", "other-transaction-id", "axis x") == (
        "its drive (unit id 1) answers, with transaction id 0 (asked with 4): no valid reply for 12 s"
    )
    assert kinds(model(with_drive(OTHER_ID, "7"))) == [
        ("error", "other-transaction-id", "line xyz, unit id 7")
    ]
    # It did so once, and has been off since.
    once = {**OTHER_ID, "timeouts_in_a_row": 40, "other_ids_in_a_row": 1}
    assert kinds(model(with_drive(once))) == [("error", "drive-silent", "axis x")]


ANSWERS: dict[str, Any] = {"answered_s": 0.1}
SILENT: dict[str, Any] = {**ANSWERS, "answered_s": 14.0, "silent_s": 12.4, "timeouts_in_a_row": 12}


def with_drive(drive: dict[str, Any], unit_id: str = "1", **axis: Any) -> dict[str, Any]:
    snapshot = with_unit_ids([1, 2], [], {})
    snapshot["axes"]["x"].update(axis)
    drives = {"1": ANSWERS, "2": ANSWERS, unit_id: drive}
    snapshot["lines"]["xyz"]["unit_ids"] |= {"drives": drives, "asked_by": {"cnc": [1, 2]}}
    return snapshot


def with_controller(**changes: Any) -> dict[str, Any]:
    snapshot = with_drive(ANSWERS)
    controller = {"name": "plc", "role": "motion", "address": "/dev/ttyS1", **changes}
    snapshot["lines"]["xyz"]["controllers"] = [controller]
    return snapshot


def test_a_silent_drive_is_said_with_its_axis_unit_id_and_time_and_hides_what_follows_from_it() -> None:
    found = model(with_drive(SILENT, compensation="unreferenced"))
    assert kinds(found) == [("error", "drive-silent", "axis x")]
    [trouble] = found["troubles"]
    assert trouble["what"] == "its drive (unit id 1) has not answered for 12 s"
    assert trouble["axes"] == ["x"]
    assert found["axes"]["x"]["trouble"] == {
        "kind": "drive-silent",
        "severity": "error",
        "title": "Drive silent",
        "cuts_off": True,
    }
    never = model(with_drive({**SILENT, "answered_s": None}))
    assert never["troubles"][0]["what"] == "its drive (unit id 1) has never answered in 12 s"


def test_another_drive_hides_nothing_of_this_axis() -> None:
    found = model(with_drive(SILENT, unit_id="2", compensation="unreferenced"))
    assert kinds(found) == [("error", "drive-silent", "axis y"), ("warning", "unreferenced", "axis x")]
    assert found["axes"]["x"]["trouble"]["kind"] == "unreferenced"


def test_one_lost_answer_is_no_silence() -> None:
    assert kinds(model(with_drive({**SILENT, "silent_s": 1.9, "timeouts_in_a_row": 1}))) == []


@pytest.mark.parametrize(
    ("damaged", "kind"), [(12, "drive-garbled"), (6, "drive-garbled"), (5, "drive-silent")]
)
def test_a_drive_of_which_half_the_answers_are_damaged_is_not_understood(damaged: int, kind: str) -> None:
    found = model(with_drive({**SILENT, "damaged_in_a_row": damaged}))
    assert kinds(found) == [("error", kind, "axis x")]
    if kind == "drive-garbled":
        assert found["troubles"][0]["what"] == (
            f"its drive (unit id 1) has sent no valid frame for 12 s: {damaged} of 12 replies were damaged"
        )


def test_a_line_that_is_down_hides_its_drives_and_a_silent_relay_everything_that_it_told() -> None:
    snapshot = with_drive(SILENT, compensation="blocked", table={**AXIS["table"]})
    snapshot["lines"]["xyz"] |= {"state": "down"}
    assert kinds(model(snapshot)) == [("error", "line-down", "line xyz")]
    found = model(snapshot, age_s=12.4)
    assert (
        said(found, "error", "relay-silent", "gateway")
        == "the relay has reported nothing for 12 s: the machine may not obey"
    )
    assert found["axes"]["x"]["trouble"]["title"] == "Relay silent"


def test_headers_that_cannot_be_are_a_trouble_of_their_line_while_they_come() -> None:
    snapshot = with_drive(ANSWERS)
    snapshot["lines"]["xyz"]["minute"] = {"exchanges": 100, "damaged": 0, "malformed": 7}
    found = model(snapshot)
    assert kinds(found) == [("error", "drive-malformed", "line xyz")]
    assert found["troubles"][0]["what"].startswith("7 replies of the drives at ")
    snapshot["lines"]["xyz"]["minute"] = {"exchanges": 100, "damaged": 0, "malformed": 0}
    assert kinds(model(snapshot)) == []


@pytest.mark.parametrize(
    ("damaged", "exchanges", "is_trouble"), [(3, 297, True), (3, 298, False), (2, 10, False), (30, 900, True)]
)
def test_one_damaged_answer_of_a_hundred_is_too_many(damaged: int, exchanges: int, is_trouble: bool) -> None:
    snapshot = with_drive({**ANSWERS, "damaged_minute": damaged})
    snapshot["lines"]["xyz"]["minute"] = {"exchanges": exchanges, "damaged": damaged}
    found = model(snapshot)
    assert [kind for _, kind, _ in kinds(found)] == (["drive-damaged"] if is_trouble else [])
    if is_trouble:
        assert found["troubles"][0]["what"] == (
            f"{damaged} replies of unit id 1 (axis x) were damaged in the last minute, "
            f"of {exchanges + damaged} on the line"
        )


def test_a_port_of_which_nothing_was_whole_is_said_with_its_count() -> None:
    minute = {"whole": 0, "damaged": 12}
    found = model(with_controller(whole=0, damaged=12, minute=minute))
    assert (
        said(found, "error", "controller-garbled", "line xyz, controller plc")
        == "all 12 frames from /dev/ttyS1 were damaged"
    )
    assert found["axes"]["x"]["verdict"]["state"] == "error"
    monitor = model(with_controller(whole=0, damaged=12, minute=minute, role="monitor"))
    assert monitor["axes"]["x"]["verdict"]["state"] == "healthy"  # it moves no axis
    some = model(with_controller(whole=188, damaged=12, minute={"whole": 188, "damaged": 12}))
    assert (
        said(some, "warning", "controller-damaged", "line xyz, controller plc")
        == "12 of 200 frames from /dev/ttyS1 were damaged in the last minute"
    )
    assert kinds(model(with_controller(whole=200, damaged=12, minute={"whole": 20, "damaged": 0}))) == []
    assert kinds(model(with_controller(whole=0, damaged=2, minute={"whole": 0, "damaged": 2}))) == []


def test_a_unit_id_without_an_axis_that_does_not_answer_costs_the_others_time() -> None:
    found = model(with_drive({**SILENT, "timeouts_in_a_row": 3}, unit_id="17"))
    assert kinds(found) == [("warning", "unit-silent", "line xyz, unit id 17")]
    assert kinds(model(with_drive({**SILENT, "timeouts_in_a_row": 2}, unit_id="17"))) == []  # looked for once


def test_a_motion_controller_that_no_axis_hears_is_named_and_a_monitor_is_not() -> None:
    snapshot = with_controller()
    unit_ids = snapshot["lines"]["xyz"]["unit_ids"]
    unit_ids |= {"heard": [1, 2, 17], "strangers": [17], "asked_by": {"cnc": [1, 2], "plc": [17]}}
    found = model(snapshot)
    assert said(found, "warning", "unheard-controller", "line xyz, controller plc") == (
        "it addresses only unit id 17, which has no axis; the axes are axis x (unit id 1), axis y (unit id 2)"
    )
    snapshot["lines"]["xyz"]["controllers"][0]["role"] = "monitor"
    assert kinds(model(snapshot)) == []


@pytest.mark.parametrize(
    ("refused", "changes", "counted"),
    [
        (7, 0, "7 requests were refused"),
        (0, 4, "control changed 4 times"),
        (1, 2, "1 requests were refused, control changed 2 times"),
        (2, 0, ""),
    ],
)
def test_two_writers_that_go_on_are_a_trouble(refused: int, changes: int, counted: str) -> None:
    rivals = {"writers": ["cnc", "panel"], "since_s": 20.0, "refused": refused, "changes": changes}
    found = model(with_axis(rivals=rivals))
    assert kinds(found) == ([("error", "two-writers", "axis x")] if counted else [])
    if counted:
        assert found["troubles"][0]["what"] == f"cnc and panel both try to move it: {counted} in 20 s"


def test_what_stands_in_the_list_is_what_axis_and_gateway_are_called() -> None:
    found = model(with_axis(latency={"is_over_budget": True, "budget_us": 500.0}))
    assert kinds(found) == [("warning", "over-budget", "axis x")]
    assert (found["verdict"]["state"], found["verdict"]["warnings"]) == ("warning", 1)
    assert words_of(found["axes"]["x"]) == ("warning", "over-budget", "")


def test_what_follows_from_a_trouble_never_hides_that() -> None:
    order = list(ALARMS.values())
    for cause, effects in HIDES.items():
        assert cause not in effects
        for effect in effects:
            assert cause not in HIDES.get(effect, ())
        assert set(effects) <= set(order)


GROUP = {"state": "open", "has_gone": False, "is_put_off": False, "is_skewed": False, "skew": None}


@pytest.mark.parametrize(
    ("group", "kind", "what"),
    [
        ({"is_skewed": True, "skew": 10.0}, "group-skewed", "the beam is skewed by +10 mm"),
        ({"is_skewed": True}, "group-skewed", "the beam is skewed by an unknown amount"),
        ({"is_put_off": True}, "group-held", "a change since then applies when all have moved"),
    ],
)
def test_a_beam_that_has_not_all_gone_is_a_trouble(group: dict[str, object], kind: str, what: str) -> None:
    found = model(with_axis(group=GROUP | group, units="mm"))
    trouble = next(each for each in found["troubles"] if each["kind"] == kind)
    assert trouble["axes"] == ["x"]
    assert what in trouble["what"]
    assert not [each for each in model(with_axis(group=GROUP))["troubles"] if "group" in each["kind"]]


def words_of(axis: dict[str, Any]) -> tuple[str, str, str]:
    return axis["verdict"]["state"], axis["verdict"]["kind"], axis["verdict"]["title"]


def test_a_gateway_of_which_nothing_is_wrong_is_healthy_and_says_since_when() -> None:
    found = model(with_controllers(cnc()))
    assert {**found["verdict"], "since": ""} == {"state": "healthy", "since": "", "errors": 0, "warnings": 0}
    assert datetime.fromisoformat(found["verdict"]["since"]) <= datetime.now(UTC)
    assert words_of(found["axes"]["x"]) == ("healthy", "active", "")


def cnc(asked_s: float | None = 0.2, **changes: Any) -> dict[str, Any]:
    """A motion controller on TCP that is connected."""
    connections = ["192.168.0.7:50000"]
    return {"name": "cnc", "role": "motion", "connections": connections, "asked_s": asked_s, **changes}


def plc(asked_s: float | None = 0.2, **changes: Any) -> dict[str, Any]:
    """A motion controller on a serial port that is open."""
    port = {"address": "/dev/ttyS1", "state": "up", "failure": ""}
    return {"name": "plc", "role": "motion", "asked_s": asked_s, **port, **changes}


def with_controllers(*controllers: dict[str, Any], uptime_s: float = 3600.0) -> dict[str, Any]:
    snapshot = with_drive(ANSWERS)
    snapshot["gateway"]["uptime_s"] = uptime_s
    snapshot["lines"]["xyz"]["controllers"] = list(controllers)
    return snapshot


@pytest.mark.parametrize(
    ("controller", "kind", "title", "what"),
    [
        (
            cnc(40.0, connections=[]),
            "controller-absent",
            "No controller",
            "no controller: it is not connected and has sent no request for 40 s",
        ),
        (
            cnc(None, connections=[]),
            "controller-absent",
            "No controller",
            (
                "no controller: it is not connected and has sent no request since the gateway was "
                "started 1 h 0 min ago"
            ),
        ),
        (
            cnc(40.0),
            "controller-silent",
            "Controller silent",
            "it is connected but has sent no request for 40 s",
        ),
        (
            plc(40.0),
            "controller-silent",
            "Controller silent",
            "its port is open but it has sent no request for 40 s",
        ),
    ],
)
def test_an_axis_that_no_controller_asks_for_is_not_healthy(
    controller: dict[str, Any], kind: str, title: str, what: str
) -> None:
    found = model(with_controllers(controller))
    [trouble] = found["troubles"]
    where = f"line xyz, controller {controller['name']}"
    assert (trouble["severity"], trouble["kind"], trouble["where"]) == ("warning", kind, where)
    assert trouble["what"] == what
    assert trouble["axes"] == ["x", "y"]
    assert begins_with_a_word(trouble["remedy"])
    # Since it was silent, and not since somebody looked.
    silent_s = controller["asked_s"] or 3600.0
    ago_s = (datetime.now(UTC) - datetime.fromisoformat(trouble["since"])).total_seconds()
    assert ago_s == pytest.approx(silent_s, abs=5.0)
    assert found["verdict"]["state"] == "warning"
    assert found["verdict"]["since"] == found["axes"]["x"]["verdict"]["since"] == trouble["since"]
    assert words_of(found["axes"]["x"]) == ("warning", kind, title)


@pytest.mark.parametrize(("asked_s", "is_missed"), [(4.8, False), (4.9, True)])
def test_a_line_is_without_a_controller_after_five_seconds(asked_s: float, *, is_missed: bool) -> None:
    # The snapshot is 0.1 s old: that is silence, too.
    assert bool(model(with_controllers(cnc(asked_s)))["troubles"]) == is_missed


def test_one_motion_controller_that_asks_is_enough_for_its_line() -> None:
    """The same program may listen on IPv4 and on IPv6, and a panel for setting up comes once a month."""
    assert kinds(model(with_controllers(cnc(), plc(4000.0)))) == []
    none = model(with_controllers(cnc(40.0, connections=[]), plc(90.0, state="up")))
    assert (
        said(none, "warning", "controller-silent", "line xyz")
        == "none of cnc, plc has sent a request for 40 s"
    )
    off = model(with_controllers(cnc(40.0, connections=[]), cnc(None, connections=[], name="spare")))
    assert said(off, "warning", "controller-absent", "line xyz") == (
        "no controller: none of cnc, spare is connected or has sent a request for 40 s"
    )


def test_monitors_and_operators_come_and_go() -> None:
    panel = cnc(None, name="panel", role="operator", connections=[])
    assert kinds(model(with_controllers(cnc(), panel))) == []
    assert model(with_controllers(panel))["verdict"]["state"] == "healthy"


@pytest.mark.parametrize(
    ("limit_s", "asked_s", "is_missed"),
    [(0.0, None, False), (0.0, 1e6, False), (90_000.0, 80_000.0, False), (90_000.0, 90_000.0, True)],
)
def test_a_controller_that_says_how_long_it_may_be_silent_is_held_to_that(
    limit_s: float, asked_s: float | None, *, is_missed: bool
) -> None:
    snapshot = with_controllers(cnc(asked_s, connections=[]))
    found = model(snapshot, silent_after_s={("xyz", "cnc"): limit_s})
    assert [kind for _, kind, _ in kinds(found)] == (["controller-absent"] if is_missed else [])
    assert found["verdict"]["state"] == ("warning" if is_missed else "healthy")


def test_a_controller_with_a_limit_of_its_own_is_missed_though_another_one_asks() -> None:
    found = model(with_controllers(cnc(), plc(12.0)), silent_after_s={("xyz", "plc"): 10.0})
    assert kinds(found) == [("warning", "controller-silent", "line xyz, controller plc")]


def test_until_a_controller_has_asked_for_the_first_time_its_axes_wait_and_are_not_healthy() -> None:
    found = model(with_controllers(cnc(None, connections=[]), uptime_s=3.0))
    assert kinds(found) == []
    assert found["verdict"]["state"] == "waiting"
    assert words_of(found["axes"]["x"]) == ("waiting", "controller-awaited", "Waiting for the controller")
    # Also where it may stay away for a day.
    rare = model(with_controllers(cnc(None)), silent_after_s={("xyz", "cnc"): 90_000.0})
    assert (kinds(rare), rare["verdict"]["state"]) == ([], "waiting")


def test_a_port_that_cannot_be_opened_hides_that_nobody_asks_on_it() -> None:
    found = model(with_controllers(plc(None, state="down", failure="no such device")))
    assert (
        said(found, "error", "controller-port-closed", "line xyz, controller plc")
        == "/dev/ttyS1 is not open: no such device"
    )
    assert words_of(found["axes"]["x"]) == ("error", "controller-port-closed", "No controller")


def test_a_relay_of_an_older_release_says_nothing_of_controllers_and_misses_none() -> None:
    old = {key: value for key, value in cnc().items() if key != "asked_s"}
    found = model(with_controllers(old))
    assert (kinds(found), found["verdict"]["state"]) == ([], "healthy")


def test_the_worst_trouble_decides_and_an_axis_that_it_does_not_name_stays_healthy() -> None:
    found = model(with_drive(SILENT, unit_id="2"), ReloadOutcome(rejected={"x": (REJECTED,)}))
    assert {**found["verdict"], "since": ""} == {"state": "error", "since": "", "errors": 2, "warnings": 0}
    assert words_of(found["axes"]["x"]) == ("error", "table-rejected", "Table rejected")
    only = model(supervisor={**WELL, "mqtt": {"problem": "refused"}})
    assert (only["verdict"]["state"], words_of(only["axes"]["x"])[0]) == ("warning", "healthy")


@pytest.mark.parametrize("part", ["configuration", "tables_folder", "state_folder"])
def test_an_axis_hangs_on_what_the_supervisor_needs_for_its_table(part: str) -> None:
    found = model(supervisor={**WELL, part: {"problem": "it is so"}})
    assert words_of(found["axes"]["x"]) == ("warning", part, "")


def test_without_a_supervisor_the_axes_are_not_healthy() -> None:
    found = model(supervisor=None)
    assert kinds(found) == [("warning", "supervisor-down", "supervisor")]
    assert found["axes"]["x"]["verdict"]["state"] == "warning"


def test_before_the_relay_was_heard_the_gateway_waits() -> None:
    assert model(None, age_s=None)["verdict"]["state"] == "waiting"
    assert model(None, is_up=False, age_s=None)["verdict"]["state"] == "error"


def positions(*snapshots: dict[str, Any], wait_s: float = 0.0) -> dict[str, Any]:
    """Return where axis x is called to be after these snapshots."""
    recent = RecentHistory()
    for snapshot in snapshots:
        recent.take(relay_model_of(snapshot), time.monotonic() - wait_s)
        wait_s = 0.0
    position: dict[str, Any] = model(snapshots[-1], recent=recent)["axes"]["x"]["position"]
    return position


READ = {"nominal_actual": 40.0, "corrected_actual": 40.25, "actual_age_s": 0.5}
UNREAD = {"nominal_actual": None, "corrected_actual": None, "actual_age_s": None}


def at(target: float | None, **changes: Any) -> dict[str, Any]:
    corrected = None if target is None else target + 0.25
    return with_axis(nominal_setpoint=target, corrected_setpoint=corrected, **changes)


@pytest.mark.parametrize("is_up", [True, False])
def test_ages_go_on_while_the_relay_reports_nothing(is_up: bool) -> None:
    thermal = {"state": "following", "celsius": 25.0, "age_s": 3.0}
    seen = {"nominal": 40.0, "corrected": 40.25, "age_s": 0.5}
    axis: dict[str, Any] = {**READ, "last_actual": seen, "terms": {"thermal": thermal}}
    snapshot = with_drive({"answered_s": 0.25}, **axis)
    snapshot["lines"]["xyz"]["controllers"] = [cnc(asked_s=0.125)]
    soon, late = model(snapshot, age_s=1.5, is_up=is_up), model(snapshot, age_s=1.75, is_up=is_up)
    axis = soon["axes"]["x"]
    assert (axis["nominal_actual"], axis["actual_age_s"]) == (40.0, 2.0)
    assert axis["last_actual"] == {**seen, "age_s": 2.0}
    assert axis["terms"]["thermal"]["age_s"] == 4.5
    assert soon["lines"]["xyz"]["unit_ids"]["drives"]["1"]["answered_s"] == 1.75
    [controller] = soon["lines"]["xyz"]["controllers"]
    assert (controller["asked_s"], controller["silent_s"]) == (1.625, 1.625)
    axis = late["axes"]["x"]  # 2.25 s: as old a reading is no position
    assert (axis["nominal_actual"], axis["corrected_actual"], axis["actual_age_s"]) == (None, None, None)
    assert axis["last_actual"]["age_s"] == 2.25


def test_where_an_axis_is_said_to_be_is_a_reading_or_says_what_else_and_how_old() -> None:
    now = positions(at(40.0, **READ))
    assert (now["of"], now["nominal"], now["corrected"]) == ("reading", 40.0, 40.25)
    assert now["age_s"] == pytest.approx(0.5, abs=0.3)
    # Nobody has read it for a minute; the target is older still.
    last = positions(at(40.0, **READ), at(40.0, **UNREAD), wait_s=60.0)
    assert (last["of"], last["nominal"], last["corrected"]) == ("last-reading", 40.0, 40.25)
    assert last["age_s"] == pytest.approx(60.5, abs=0.3)
    # A target that came after the last reading is nearer to the truth.
    target = positions(at(40.0, **READ), at(70.0, **UNREAD), wait_s=60.0)
    assert (target["of"], target["nominal"], target["corrected"]) == ("target", 70.0, 70.25)
    assert (target["age_s"], target["is_at_least"]) == (pytest.approx(0.0, abs=0.3), False)
    # A target that was there before anybody looked is as old as that, or older.
    first = positions(at(70.0, **UNREAD), at(70.0, **UNREAD), wait_s=60.0)
    assert (first["age_s"], first["is_at_least"]) == (pytest.approx(60.0, abs=0.3), True)
    assert positions(at(None, **UNREAD))["of"] is None


def test_in_shadow_mode_the_target_of_the_drive_is_that_of_the_controller() -> None:
    assert positions(at(70.0, compensation="shadow", **UNREAD))["corrected"] == 70.0


def test_what_a_silent_relay_read_last_is_no_reading() -> None:
    snapshot = at(40.0, **READ)
    assert model(snapshot)["axes"]["x"]["position"]["of"] == "reading"
    assert model(snapshot, age_s=STALE_S + 0.1)["axes"]["x"]["position"]["of"] == "last-reading"


def test_an_axis_that_is_well_again_is_healthy_since_then() -> None:
    hours = [9]
    recent = RecentHistory(lambda: datetime(2026, 5, 1, hours[0], tzinfo=UTC))

    def since(snapshot: dict[str, Any]) -> str:
        return str(model(snapshot, recent=recent)["axes"]["x"]["verdict"]["since"])

    assert since(with_drive(ANSWERS)) == "2026-05-01T09:00:00+00:00"
    hours[0] = 10
    assert since(with_drive(ANSWERS)) == "2026-05-01T09:00:00+00:00"
    since(with_drive(SILENT))
    hours[0] = 11
    assert since(with_drive(ANSWERS)) == "2026-05-01T11:00:00+00:00"
