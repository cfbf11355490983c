"""What the supervisor notes in its journal of interventions, also where the disk is full."""

import asyncio
import contextlib
import fcntl
import os
import time
from collections.abc import AsyncIterator, Callable
from datetime import datetime
from pathlib import Path

import gateway
from gateway.catalogue.entry import EventEntry, Severity
from gateway.exchange.commands import (
    ClearTable,
    Disable,
    EndDryRun,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
    TableFor,
)
from gateway.ipc.messages import Happened
from gateway.state.interventions import Entry, files_in, locked
from gateway.status.axis import AxisStatus, Shares, TableStatus
from gateway.status.line import CertificateStatus
from gateway.status.model import GatewayStatus, JournalStatus, RelayModel
from gateway.supervisor.interventions import MOST_WAITING, Cause, Interventions
from tests.support.interventions import verified

LIMITS = {"max_correction": 1.0, "max_slope": 0.01, "travel_margin": 2.0, "budget_us": 500.0}
BY = Cause("mqtt", {"broker": "mqtt.example:1883"})


def ignore(event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
    pass


def model(compensation: str = "active", gain: float = 1.0, sha256: str | None = "a" * 64) -> RelayModel:
    axis = AxisStatus(
        compensation=compensation,
        gain=Shares(forward=gain, backward=gain),
        table=TableStatus(sha256=sha256),
        configured={"gain": {"forward": 1.0, "backward": 1.0}, "compensation": "on", **LIMITS},
    )
    return RelayModel(gateway=GatewayStatus(version="1.1.0"), axes={"x": axis})


@contextlib.asynccontextmanager
async def noting(state: Path, settled_s: float = 0.0) -> AsyncIterator[Interventions]:
    """A journal that is written to the end when the block ends."""
    interventions = Interventions(state, ignore, settled_s)
    await interventions.recall()
    running = asyncio.create_task(interventions.run())
    try:
        yield interventions
    finally:
        await asyncio.sleep(0)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


def entries_of(state: Path) -> list[Entry]:
    found, entries = verified(state / "interventions")
    assert found.problems == []
    return entries


def said(entries: list[Entry]) -> list[tuple[object, ...]]:
    return [tuple(one[key] for key in ("what", "axis", "before", "after", "via")) for one in entries]


def happened(event: str, pid: int = 1, **fields: object) -> Happened:
    return Happened(event=event, severity="info", fields={"user": 0, "pid": pid, **fields}, wall_s=0.0)


async def eventually(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(60.0):
        while not condition():  # noqa: ASYNC110 - it tells nobody
            await asyncio.sleep(0)


async def test_the_first_status_is_the_beginning_and_the_same_again_is_nothing(tmp_path: Path) -> None:
    async with noting(tmp_path) as interventions:
        for _ in range(3):
            interventions.compare(model(), ())
    one = {"forward": 1.0, "backward": 1.0}
    assert said(entries_of(tmp_path))[1:] == [
        ("table", "x", None, "a" * 64, "start"),
        ("gain", "x", None, one, "start"),
        ("compensation", "x", None, "on", "start"),
        ("mode", "x", None, "on", "start"),
        ("limits", "x", None, LIMITS, "start"),
        ("version", None, None, "1.1.0", "start"),
    ]


async def test_each_command_is_noted_with_what_was_before(tmp_path: Path) -> None:
    limits = {**LIMITS, "max_slope": 0.02}
    with_limits = SetLimits(axis="x", max_correction=1.0, max_slope=0.02, travel_margin=2.0, budget_us=500.0)
    async with noting(tmp_path) as interventions:
        interventions.compare(model(), ())
        table = TableFor("x", "new.tab", "centroid-3", "b" * 64)
        for command in (
            SetTable(tables=(table,)),
            SetGain(forward=0.5, backward=0.25),
            Disable(),
            EndDryRun(axes=("x",)),  # it is on already
            with_limits,
            SetReference(axis="x"),
            SetTemperature(axis="x", celsius=20.0),
            ClearTable(axes=("x",)),
        ):
            interventions.commanded(command, ("x",), BY)
    entries = entries_of(tmp_path)[7:]
    assert said(entries) == [
        ("table", "x", "a" * 64, "b" * 64, "mqtt"),
        ("gain", "x", {"forward": 1.0, "backward": 1.0}, {"forward": 0.5, "backward": 0.25}, "mqtt"),
        ("compensation", "x", "on", "off", "mqtt"),
        ("limits", "x", LIMITS, limits, "mqtt"),
        ("reference", "x", None, "declared", "mqtt"),
        ("table", "x", "b" * 64, None, "mqtt"),
    ]
    assert entries[0]["file"] == "new.tab"
    assert {one["who"]["broker"] for one in entries} == {"mqtt.example:1883"}


async def test_what_other_processes_do_is_noted_from_the_events_and_our_own_is_not(tmp_path: Path) -> None:
    async with noting(tmp_path) as interventions:
        interventions.compare(model(), ())
        interventions.happened(happened("enabled", pid=os.getpid(), axes=["x"]))
        interventions.happened(happened("line-up", line="xyz"))
        interventions.happened(happened("disabled", 7, axes=["x"], program="pitch-gateway", login=1000))
        interventions.happened(happened("gain-changed", 7, axes=["x"], forward=0.0, backward=0.5))
        interventions.happened(happened("limits-changed", 7, axes=["x"], **{**LIMITS, "budget_us": 1.0}))
        interventions.happened(
            happened("table-activated", 7, axis="x", table="n.tab", points=2, sha256="c" * 64)
        )
        interventions.happened(happened("referenced", 7, axes=["x"]))
        interventions.happened(happened("table-removed", 7, axes=["x"]))
    entries = entries_of(tmp_path)[7:]
    assert said(entries) == [
        ("compensation", "x", "on", "off", "socket"),
        ("gain", "x", {"forward": 1.0, "backward": 1.0}, {"forward": 0.0, "backward": 0.5}, "socket"),
        ("limits", "x", LIMITS, {**LIMITS, "budget_us": 1.0}, "socket"),
        ("table", "x", "a" * 64, "c" * 64, "socket"),
        ("reference", "x", None, "declared", "socket"),
        ("table", "x", "c" * 64, None, "socket"),
    ]
    who = entries[0]["who"]
    assert (who["user"], who["pid"], who["program"], who["login"]) == (0, 7, "pitch-gateway", 1000)


async def test_a_difference_that_nobody_noted_is_found_also_over_a_restart(tmp_path: Path) -> None:
    held = CertificateStatus(
        key="http.tls", file="page.pem", subject="CN=mill", ends="2027-01-01", sha256=["a" * 64]
    )
    async with noting(tmp_path) as interventions:
        interventions.compare(model(), (held,))
    begun = len(entries_of(tmp_path))
    renewed = CertificateStatus(
        key="http.tls", file="page.pem", subject="CN=mill", ends="2027-01-01", sha256=["b" * 64, "c" * 64]
    )
    async with noting(tmp_path) as interventions:
        interventions.compare(model("off", 0.5, None), (renewed,))
        interventions.compare(RelayModel(gateway=GatewayStatus(version="1.2.0")), ())  # without the axis
    assert said(entries_of(tmp_path))[begun + 1 :] == [
        ("table", "x", "a" * 64, None, "found"),
        ("gain", "x", {"forward": 1.0, "backward": 1.0}, {"forward": 0.5, "backward": 0.5}, "found"),
        ("compensation", "x", "on", "off", "found"),
        (
            "certificate",
            None,
            {"subject": "CN=mill", "ends": "2027-01-01", "sha256": ["a" * 64]},
            {"subject": "CN=mill", "ends": "2027-01-01", "sha256": ["b" * 64, "c" * 64]},
            "found",
        ),
        ("version", None, "1.1.0", "1.2.0", "found"),
        ("gain", "x", {"forward": 0.5, "backward": 0.5}, None, "found"),
        ("compensation", "x", "off", None, "found"),
        ("mode", "x", "on", None, "found"),
        ("limits", "x", LIMITS, None, "found"),
    ]


async def test_a_blocked_axis_and_a_gain_of_0_are_no_switch(tmp_path: Path) -> None:
    async with noting(tmp_path) as interventions:
        for state, is_on in (("off", False), ("blocked", False), ("active", True), ("off", True)):
            found = model(state)
            found.axes["x"].is_enabled = is_on
            interventions.compare(found, ())
    assert [one for one in said(entries_of(tmp_path)) if one[0] == "compensation"] == [
        ("compensation", "x", None, "off", "start"),
        ("compensation", "x", "off", "on", "found"),
    ]


async def test_each_further_file_begins_with_the_state_and_a_start_needs_no_older_one(tmp_path: Path) -> None:
    folder = tmp_path / "interventions"
    async with noting(tmp_path) as interventions:
        interventions.compare(model(), ())
        await eventually(lambda: not interventions._waiting)
        interventions._writer._file_bytes = 5000  # the seven are less, and twelve would be more
        for number in range(5):
            interventions.note("gain", BY, "x", None, number)
        await eventually(lambda: not interventions._waiting)
    first, second = files_in(folder)
    [state] = [one for one in entries_of(tmp_path) if one["what"] == "state"]
    assert second.read_bytes().splitlines()[0].count(b'"what":"state"') == 1
    assert ["table", "x", "a" * 64] in state["after"]
    first.write_bytes(first.read_bytes().replace(b'"before":null', b'"before":nul'))  # not looked at
    told: list[str] = []
    again = Interventions(tmp_path, lambda event, *_, **fields: told.append(event.name), 0.0)
    await again.recall()
    again.compare(model(gain=0.5), ())
    assert told == []
    found = [(one.what, one.before, one.via) for one in again._waiting]
    assert found == [("start", gateway.__version__, "start"), ("gain", 4, "found")]


async def test_the_status_is_not_compared_while_a_command_of_our_own_is_under_way(tmp_path: Path) -> None:
    """Its event comes before its result: what the status shows meanwhile has a cause that is noted soon."""
    async with noting(tmp_path, settled_s=1000.0) as interventions:
        interventions.compare(model(), ())
        interventions.happened(happened("disabled", pid=os.getpid(), axes=["x"]))
        interventions.compare(model("off"), ())
        interventions.commanded(Disable(), ("x",), BY)
    assert said(entries_of(tmp_path))[7:] == [("compensation", "x", "on", "off", "mqtt")]


async def test_entries_wait_for_a_disk_with_their_times_and_what_is_too_much_is_counted(
    tmp_path: Path,
) -> None:
    """A file in place of the folder stands for the disk that takes nothing."""
    (tmp_path / "interventions").write_bytes(b"")
    async with noting(tmp_path) as interventions:
        for number in range(MOST_WAITING + 5):
            interventions.note("reference", BY, f"axis{number}", None, "declared")
        await eventually(lambda: interventions.problem is not None)
        assert str(interventions.problem).startswith(f"{tmp_path / 'interventions'}: Not a directory")
        (tmp_path / "interventions").unlink()
        back_s = time.time()
        interventions.note("reference", BY, "last", None, "declared")
        await eventually(lambda: interventions.problem is None)
    entries = entries_of(tmp_path)
    # The start of the supervisor is the first that waits, so six find no place. The last one finds one if the
    # disk is faster.
    noted = [one for one in entries if one["what"] == "reference"]
    kept = [f"axis{number}" for number in range(MOST_WAITING - 1)]
    assert [one["axis"] for one in noted][: len(kept)] == kept
    [lost] = [one for one in entries if one["what"] == "lost"]
    assert (lost["after"] + len(noted), lost["via"]) == (MOST_WAITING + 6, "gateway")
    assert datetime.fromisoformat(noted[len(kept) - 1]["time"]).timestamp() < back_s


async def test_a_disk_that_does_not_answer_is_a_problem_and_holds_nothing_up(tmp_path: Path) -> None:
    folder = tmp_path / "interventions"
    folder.mkdir()
    with locked(folder, fcntl.LOCK_EX):
        interventions = Interventions(tmp_path, ignore, 0.0, late_s=0.1)
        async with asyncio.timeout(60):
            await interventions.recall()
        assert interventions.problem is not None
        assert interventions.problem.found == f"{folder}: does not answer"
        running = asyncio.create_task(interventions.run())
        interventions.problem = None
        await eventually(lambda: interventions.problem is not None)
    await eventually(lambda: interventions.problem is None)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert [one["what"] for one in entries_of(tmp_path)] == ["start"]


async def test_a_link_to_a_disk_that_is_not_there_is_a_problem(tmp_path: Path) -> None:
    (tmp_path / "interventions").symlink_to(tmp_path / "missing")
    async with noting(tmp_path) as interventions:
        await eventually(lambda: interventions.problem is not None)
        assert interventions.problem is not None
        assert interventions.problem.found == f"{tmp_path / 'interventions'}: Not a directory"


async def test_a_folder_with_the_name_of_the_next_file_is_a_problem_until_it_is_moved_away(
    tmp_path: Path,
) -> None:
    async with noting(tmp_path):
        pass
    stranger = tmp_path / "interventions" / "000002.jsonl"
    stranger.mkdir()
    async with noting(tmp_path) as interventions:
        await eventually(lambda: interventions.problem is not None)
        assert str(interventions.problem) == (
            f"{stranger}: is named as a file of the journal and is none; move it away; meanwhile the journal "
            "goes on"
        )
        stranger.rmdir()
        interventions.note("reference", BY, "x", None, "declared")
        await eventually(lambda: interventions.problem is None)
    assert [one["what"] for one in entries_of(tmp_path)] == ["start", "start", "reference"]


async def test_the_status_has_number_and_digest_of_the_newest_entry(tmp_path: Path) -> None:
    async with noting(tmp_path) as interventions:
        assert interventions.status == JournalStatus(seq=None, digest=None)
        await eventually(lambda: interventions.status.seq == 1)
        interventions.note("reference", BY, "x", None, "declared")
        await eventually(lambda: interventions.status.seq == 2)
        shown = interventions.status
        assert shown.digest == entries_of(tmp_path)[1]["digest"]
        assert await interventions.erase("mqtt.example:1883", "", BY) == 1
        assert interventions.status.seq == 3
    again = Interventions(tmp_path, ignore)
    await again.recall()
    assert again.status == JournalStatus(seq=3, digest=entries_of(tmp_path)[2]["digest"])


async def test_a_journal_that_was_changed_is_reported_with_its_first_fault(tmp_path: Path) -> None:
    told: list[tuple[str, dict[str, object]]] = []

    def log(event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        told.append((event.name, fields))

    async with noting(tmp_path) as interventions:
        interventions.compare(model(), ())
    [path] = files_in(tmp_path / "interventions")
    path.write_bytes(path.read_bytes().replace(b'"after":"on"', b'"after":"no"'))
    again = Interventions(tmp_path, log)
    await again.recall()
    [(event, fields)] = told
    assert (event, fields["count"]) == ("interventions-damaged", 2)
    assert str(fields["detail"]).startswith("000001.jsonl:4: entry 4 was changed")


async def test_a_person_is_a_whole_name_or_address_and_nothing_else_that_who_has(tmp_path: Path) -> None:
    by = Cause("http", {"user": 0})
    async with noting(tmp_path) as interventions:
        who = {"user": 1000, "pid": 77, "program": "anna", "login": 1001}
        interventions.note("acknowledged", Cause("socket", who), None, None, {})
        who = {"name": "anna", "address": "192.0.2.7"}
        interventions.note("acknowledged", Cause("http", who), None, None, {})
        interventions.note("acknowledged", BY, None, None, {})
        await eventually(lambda: interventions.status.seq == 4)
        for nobody in ("77", "ann", "Anna", "192.0.2.70", entries_of(tmp_path)[1]["who"]["salt"]):
            assert await interventions.erase(nobody, "", by) == 0
        entries = entries_of(tmp_path)
        assert [one["what"] for one in entries] == ["start", *3 * ["acknowledged"]]
        assert await interventions.erase("anna", "", by) == 1
        assert [one["who"] is None for one in entries_of(tmp_path)[1:4]] == [False, True, False]
        assert await interventions.erase("1001", "", by) == 1
        assert await interventions.erase("mqtt.example:1883", "", by) == 1


async def test_who_is_erased_by_name_or_by_day(tmp_path: Path) -> None:
    async with noting(tmp_path) as interventions:
        for name in ("anna", "bert"):
            interventions.note("acknowledged", Cause("http", {"name": name}), None, None, {})
        by = Cause("http", {"user": 0})
        assert await interventions.erase("anna", "", by) == 1
        assert await interventions.erase("", "2000-01-01", by) == 0
        assert await interventions.erase("", "9999-01-01", by) == 2  # bert, and who erased anna
    entries = entries_of(tmp_path)
    assert [one["what"] for one in entries] == ["start", "acknowledged", "acknowledged", "erasure", "erasure"]
    assert [one["who"] and one["who"].get("user") for one in entries] == [None, None, None, None, 0]
