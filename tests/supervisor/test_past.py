"""Since when something is wrong, and where axes were: for ten minutes, and for a day in the state folder."""

import os
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from gateway.catalogue.alarms import DRIVE_SILENT, RELAY_DOWN, TABLE_REJECTED, UNREFERENCED
from gateway.status.axis import Reading
from gateway.status.model import AcknowledgedBy, RelayModel
from gateway.supervisor import past as past_module
from gateway.supervisor.acknowledged import Acknowledged
from gateway.supervisor.active_alarms import Alarm
from gateway.supervisor.past import Past
from gateway.supervisor.recent_history import LastTarget, RecentHistory
from tests.support.status_models import relay_model_of

NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)


def silent(age_s: float) -> Alarm:
    return Alarm(DRIVE_SILENT, ("xyz", "1"), "axis x", f"silent for {age_s}", ("x",), age_s)


def snapshot(nominal: float | None, **changes: Any) -> RelayModel:
    corrected = None if nominal is None else nominal + 0.25
    axis = {"compensation": "active", "nominal_actual": nominal, "corrected_actual": corrected}
    return relay_model_of({"axes": {"x": {**axis, "correction": 0.125, "actual_age_s": 0.5, **changes}}})


def test_a_trouble_keeps_the_time_since_when_it_is_there() -> None:
    recent = RecentHistory()
    found = [silent(12.0), Alarm(UNREFERENCED, ("xyz", "2", "y"), "axis y", "not referenced", ("y",))]
    assert [each.since for each in recent.stamp(found, NOON)] == [
        "2026-05-01T11:59:48+00:00",
        "2026-05-01T12:00:00+00:00",
    ]
    later = [silent(72.4), found[1]]
    assert [each.since for each in recent.stamp(later, NOON + timedelta(minutes=1))] == [
        "2026-05-01T11:59:48+00:00",
        "2026-05-01T12:00:00+00:00",
    ]
    assert recent.stamp([], NOON + timedelta(minutes=2)) == []
    [again] = recent.stamp([silent(3.0)], NOON + timedelta(minutes=3))
    assert again.since == "2026-05-01T12:02:57+00:00"


def test_two_drives_that_are_silent_have_each_their_own_time() -> None:
    recent = RecentHistory()
    other = Alarm(DRIVE_SILENT, ("xyz", "2"), "axis y", "silent", ("y",), 2.0)
    assert [each.since for each in recent.stamp([silent(12.0), other], NOON)] == [
        "2026-05-01T11:59:48+00:00",
        "2026-05-01T11:59:58+00:00",
    ]


def test_the_last_place_of_an_axis_stays_with_its_age() -> None:
    recent = RecentHistory()
    assert recent.last("x", 100.0) is None
    recent.take(snapshot(40.0), 100.0)  # seen half a second before
    recent.take(snapshot(None, correction=None), 101.0)
    assert recent.last("x", 112.5) == Reading(nominal=40.0, corrected=40.25, age_s=13.0)


def test_a_snapshot_that_comes_no_more_makes_nothing_newer() -> None:
    recent = RecentHistory()
    frozen = snapshot(40.0)
    recent.take(frozen, 100.0)
    recent.take(frozen, 130.0)
    last = recent.last("x", 130.0)
    assert last is not None
    assert last.age_s == 30.5


def test_ten_minutes_are_kept_a_place_each_second() -> None:
    recent = RecentHistory()
    for number in range(5 * 700):  # 700 s, five snapshots in each
        recent.take(snapshot(float(number)), 1000.0 + number / 5)
    history = recent.history("x")
    assert history is not None
    assert len(history) == 600
    assert history[-1].nominal == 3495.0  # the first snapshot of the last second
    assert history[0].at_s == 1099.5
    assert history[-1].correction == 0.25
    assert recent.history("y") is None
    assert recent.newest() == {"x": history[-1]}


def test_where_nothing_is_known_there_is_a_gap_and_in_shadow_the_correction_is_what_would_be_added() -> None:
    recent = RecentHistory()
    recent.take(snapshot(None, correction=None), 100.0)
    recent.take(snapshot(40.0, compensation="shadow"), 102.0)
    history = recent.history("x")
    assert history is not None
    assert [seen.nominal for seen in history] == [None, 40.0]
    assert [seen.correction for seen in history] == [None, 0.125]
    assert [seen.compensation for seen in history] == ["active", "shadow"]


def test_an_axis_that_is_gone_is_forgotten() -> None:
    recent = RecentHistory()
    recent.take(snapshot(40.0), 100.0)
    recent.take(RelayModel(), 101.0)
    assert recent.history("x") is None
    assert recent.last("x", 101.0) is None


def test_a_supervisor_that_comes_late_has_the_last_reading_from_the_relay() -> None:
    recent = RecentHistory()
    told = {"nominal": 40.0, "corrected": 40.25, "age_s": 30.0}
    recent.take(snapshot(None, correction=None, last_actual=told), 100.0)
    assert recent.last("x", 101.0) == Reading(nominal=40.0, corrected=40.25, age_s=31.0)
    # What it has seen itself counts more: the relay's is on the map of now.
    recent.take(snapshot(50.0), 102.0)
    recent.take(snapshot(None, correction=None, last_actual=told), 103.0)
    last = recent.last("x", 103.0)
    assert last is not None
    assert last.nominal == 50.0


def test_the_age_of_a_target_is_known_once_it_was_seen_to_come() -> None:
    recent = RecentHistory()
    recent.take(snapshot(None, nominal_setpoint=40.0), 100.0)
    assert recent.target("x", 130.0) == LastTarget(30.0, is_at_least=True)
    recent.take(snapshot(None, nominal_setpoint=50.0), 140.0)
    recent.take(snapshot(None, nominal_setpoint=50.0), 150.0)
    assert recent.target("x", 155.0) == LastTarget(15.0, is_at_least=False)
    recent.take(snapshot(None, nominal_setpoint=None), 160.0)
    assert recent.target("x", 160.0) is None


# A day of the axes in the state folder: bounded in bytes and in time, and never in anybody's way.


NOON_S = datetime(2026, 5, 1, 12, tzinfo=UTC).timestamp()


def snapshot_past(nominal: float | None) -> dict[str, Any]:
    corrected = None if nominal is None else nominal + 0.25
    axis = {"compensation": "active", "nominal_actual": nominal, "corrected_actual": corrected}
    return {"axes": {"x": {**axis, "correction": None, "actual_age_s": 0.0}}}


def say(*_event: object, **_fields: object) -> None:
    pass


class Keeping:
    """A past with a clock of its own: 0 s is noon."""

    def __init__(self, state: Path) -> None:
        self.recent = RecentHistory()
        self.past = Past(state, self.recent, say)

    async def at(self, second: float, nominal: float | None) -> None:
        self.recent.take(relay_model_of(snapshot_past(nominal)), second)
        await self.past.write_new(second, NOON_S + second)

    async def of(self, span_s: float, second: float) -> list[tuple[float, float | None]]:
        found = await self.past.of("x", span_s, second, NOON_S + second)
        assert found is not None
        return [(noted.wall_s - NOON_S, noted.nominal) for noted in found]


async def test_a_place_every_ten_seconds_outlives_the_process(tmp_path: Path) -> None:
    before = Keeping(tmp_path)
    for second in range(100):
        await before.at(second, -float(second))
    [file] = (tmp_path / "history").iterdir()
    assert file.name == "20260501T120000Z.csv"
    assert file.read_text().splitlines()[:3] == [
        "time,axis,nominal,correction,compensation",
        "2026-05-01T12:00:00Z,x,-0.000000,0.2500000,active",
        "2026-05-01T12:00:10Z,x,-10.000000,0.2500000,active",
    ]
    assert (tmp_path / "history").stat().st_mode & 0o777 == 0o700
    after = Keeping(tmp_path)
    await after.at(120, -5.0)
    await after.at(121, None)
    expected = [(10.0 * n, -10.0 * n) for n in range(10)]
    assert await after.of(600, 121) == [*expected, (120.0, -5.0), (121.0, None)]
    assert await after.of(60, 121) == [*expected[7:], (120.0, -5.0), (121.0, None)]
    assert await after.past.of("y", 600, 121, NOON_S + 121) is None


async def test_a_relay_that_says_nothing_leaves_a_gap(tmp_path: Path) -> None:
    keeping = Keeping(tmp_path)
    await keeping.at(0, 1.0)
    for second in (10, 20, 30):
        await keeping.past.write_new(second, NOON_S + second)
    [file] = (tmp_path / "history").iterdir()
    assert len(file.read_text().splitlines()) == 2


async def test_what_is_older_than_a_day_goes(tmp_path: Path) -> None:
    keeping = Keeping(tmp_path)
    for second in range(0, 30 * 3600, 60):
        await keeping.at(second, 1.0)
    files = sorted(file.name for file in (tmp_path / "history").iterdir())
    assert files[0] == "20260501T170000Z.csv"  # it is 17:59 of the next day: 25 hours before was 16:59
    assert files[-1] == "20260502T170000Z.csv"
    assert len(files) == 25
    found = await keeping.of(86_400, 30 * 3600)
    assert min(second for second, _ in found) == 6 * 3600.0


async def test_the_bytes_are_bounded_and_the_oldest_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(past_module, "FILE_BYTES", 1000)
    monkeypatch.setattr(past_module, "MOST_BYTES", 4000)
    keeping = Keeping(tmp_path)
    for second in range(0, 5000, 10):
        await keeping.at(second, float(second))
        sizes = [file.stat().st_size for file in (tmp_path / "history").iterdir()]
        assert sum(sizes) <= 4000
        assert max(sizes) <= 1000
    newest = (await keeping.of(86_400, 5000))[-1]
    assert newest == (4990.0, 4990.0)


async def test_half_a_line_of_a_process_that_was_killed_spoils_nothing(tmp_path: Path) -> None:
    await Keeping(tmp_path).at(0, 1.0)
    [file] = (tmp_path / "history").iterdir()
    file.write_text(file.read_text() + "2026-05-01T12:00:10Z,x,-1")
    keeping = Keeping(tmp_path)
    await keeping.at(20, 2.0)
    await Keeping(tmp_path).at(30, 3.0)
    after = Keeping(tmp_path)
    await after.at(1000, 9.0)
    assert await after.of(86_400, 1000) == [(0.0, 1.0), (20.0, 2.0), (30.0, 3.0), (1000.0, 9.0)]


async def test_a_clock_that_is_set_back_costs_one_file(tmp_path: Path) -> None:
    keeping = Keeping(tmp_path)
    await keeping.at(7200, 1.0)
    for number in range(10):
        keeping.recent.take(relay_model_of(snapshot_past(2.0)), 7200 + 10 * (number + 1))
        await keeping.past.write_new(7200 + 10 * (number + 1), NOON_S + 10 * number)
    assert len(list((tmp_path / "history").iterdir())) == 2


def make_unwritable(state: Path) -> None:
    (state / "history").write_text("a file in its place")


def take_away(state: Path) -> None:
    state.rename(state.with_name("elsewhere"))


def fill(state: Path) -> None:
    full = Path("/dev/full")
    assert full.exists()
    (state / "history").mkdir()
    (state / "history" / "20260501T120000Z.csv").symlink_to(full)


@pytest.mark.parametrize("harm", [make_unwritable, take_away, fill])
async def test_what_cannot_be_kept_is_a_problem_and_no_end(
    tmp_path: Path, harm: Callable[[Path], None]
) -> None:
    state = tmp_path / "state"
    state.mkdir()
    harm(state)
    keeping = Keeping(state)
    await keeping.at(0, 1.0)
    assert keeping.past.problem is not None
    assert await keeping.of(600, 0) == [(0.0, 1.0)]
    assert not (tmp_path / "state" / "history" / "x").exists()


async def test_a_disk_with_little_room_is_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = os.statvfs(tmp_path)
    monkeypatch.setattr(past_module, "FREE_BYTES", disk.f_blocks * disk.f_frsize + 1)
    keeping = Keeping(tmp_path)
    await keeping.at(0, 1.0)
    assert "No space left on device; free space on its disk" in str(keeping.past.problem)
    assert list((tmp_path / "history").iterdir()) == []
    monkeypatch.setattr(past_module, "FREE_BYTES", 0)
    await keeping.at(10, 2.0)
    assert keeping.past.problem is None


async def test_an_acknowledgement_outlives_the_process_and_ends_with_its_alarm(tmp_path: Path) -> None:
    silent = Alarm(DRIVE_SILENT, ("xyz", "1"), "axis x", "silent", ("x",), 60.0)
    noon = datetime.fromtimestamp(NOON_S, UTC)
    before = Keeping(tmp_path)
    [told] = before.recent.stamp([silent], noon)
    assert told.acknowledged is None
    before.recent.acknowledge("drive-silent", "axis x", told.since, "shift", noon)
    await before.past.write_new(0, NOON_S)
    assert (tmp_path / "acknowledged.json").stat().st_mode & 0o777 == 0o600

    after = Keeping(tmp_path)
    await after.past.recall()
    [again] = after.recent.stamp([silent], datetime.fromtimestamp(NOON_S + 300, UTC))
    assert again.since == told.since == "2026-05-01T11:59:00+00:00"
    assert again.acknowledged == AcknowledgedBy(by="shift", at="2026-05-01T12:00:00+00:00")


@pytest.mark.parametrize(
    ("begin", "told"),
    [
        (lambda path: path.write_text('[{"kind": 1}]'), ["acknowledgements-lost"]),
        (lambda path: path.mkdir(), ["acknowledgements-lost"]),  # it is there and cannot be read
        (lambda path: None, []),
    ],
)
async def test_acknowledgements_that_cannot_be_restored_are_reported(
    tmp_path: Path, begin: Callable[[Path], object], told: list[str]
) -> None:
    begin(tmp_path / "acknowledged.json")
    said: list[str] = []
    past = Past(tmp_path, RecentHistory(), lambda event, *_, **fields: said.append(event.name))
    await past.recall()
    assert said == told


async def test_damaged_acknowledgements_are_written_anew_and_reported_once(tmp_path: Path) -> None:
    file = tmp_path / "acknowledged.json"
    file.write_text("[{")
    said: list[str] = []
    for _ in range(2):
        past = Past(tmp_path, RecentHistory(), lambda event, *_, **fields: said.append(event.name))
        await past.recall()
        await past.write_new(0.0, NOON_S)
        assert file.read_text() == "[]"
    assert said == ["acknowledgements-lost"]


# An acknowledgement belongs to one occurrence of an alarm: it ends with it, and not before.


SILENT = Alarm(DRIVE_SILENT, ("xyz", "1"), "axis x", "its drive has not answered for 12 s", ("x",), 12.0)
BAD = Alarm(TABLE_REJECTED, ("xyz", "1", "x"), "axis x", "cnc10x.tab:3: no number", ("x",))
DOWN = Alarm(RELAY_DOWN, (), "gateway", "the relay is not running", ("x",))
BY = AcknowledgedBy(by="shift", at="2026-05-01T12:00:00+00:00")


def seen(recent: RecentHistory, *found: Alarm, second: float) -> list[AcknowledgedBy | None]:
    recent.acknowledged.follow(found, second)
    return [each.acknowledged for each in recent.stamp(found, NOON + timedelta(seconds=second))]


def acknowledged_at_noon() -> RecentHistory:
    recent = RecentHistory()
    assert seen(recent, SILENT, BAD, second=0) == [None, None]
    done = recent.acknowledge("drive-silent", "axis x", "2026-05-01T11:59:48+00:00", "shift", NOON)
    assert done is not None
    assert done.as_data() == {"by": BY.by, "at": BY.at}
    return recent


def test_it_is_of_one_alarm_and_the_first_who_saw_it_stays() -> None:
    recent = acknowledged_at_noon()
    assert seen(recent, SILENT, BAD, second=1) == [BY, None]
    again = recent.acknowledge("drive-silent", "axis x", "2026-05-01T11:59:48+00:00", "late", NOON)
    assert again is not None
    assert again.by == "shift"


def test_an_alarm_that_is_another_one_by_now_is_not_acknowledged() -> None:
    recent = RecentHistory()
    seen(recent, SILENT, second=0)
    for kind, where, since in (
        ("drive-silent", "axis x", "2026-05-01T11:00:00+00:00"),
        ("drive-silent", "axis y", "2026-05-01T11:59:48+00:00"),
        ("line-down", "axis x", "2026-05-01T11:59:48+00:00"),
    ):
        assert recent.acknowledge(kind, where, since, "shift", NOON) is None
    assert seen(recent, SILENT, second=1) == [None]


def test_it_ends_with_the_alarm() -> None:
    recent = acknowledged_at_noon()
    assert seen(recent, BAD, second=1) == [None]
    assert seen(recent, SILENT, BAD, second=2) == [None, None]


def test_it_stays_while_a_worse_one_hides_the_alarm() -> None:
    recent = acknowledged_at_noon()
    assert seen(recent, DOWN, second=1) == [None]
    assert seen(recent, SILENT, second=2) == [BY]
    told = recent.stamp([SILENT], NOON)
    assert told[0].since == "2026-05-01T11:59:48+00:00"


def test_after_a_restart_it_waits_thirty_seconds_for_its_alarm() -> None:
    kept = acknowledged_at_noon().acknowledged.encoded()
    recent = RecentHistory()
    recent.acknowledged.restore(kept, 1000.0)
    assert seen(recent, second=1029.9) == []
    assert seen(recent, SILENT, second=1029.95) == [BY]
    assert seen(recent, second=1029.99) == []
    assert seen(recent, SILENT, second=1030) == [BY]
    assert seen(recent, second=1031) == []
    assert seen(recent, SILENT, second=1032) == [None]


def test_they_are_bounded() -> None:
    acknowledged = Acknowledged()
    for number in range(300):
        trouble = Alarm(DRIVE_SILENT, ("xyz", str(number)), f"axis {number}", "silent")
        acknowledged.add(trouble, "", "shift", NOON)
    assert acknowledged["drive-silent", ("xyz", "43")] is None
    assert acknowledged["drive-silent", ("xyz", "44")] is not None
