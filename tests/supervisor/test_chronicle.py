"""Since when something is wrong, and where axes were: kept for ten minutes, bounded."""

from datetime import UTC, datetime, timedelta
from typing import Any

from gateway.catalogue.alarms import DRIVE_SILENT, UNREFERENCED
from gateway.status.axis import Reading
from gateway.status.model import RelayModel
from gateway.supervisor.active_alarms import Alarm
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
