"""An acknowledgement belongs to one occurrence of an alarm: it ends with it, and not before."""

from datetime import UTC, datetime, timedelta

from gateway.catalogue.alarms import DRIVE_SILENT, RELAY_DOWN, TABLE_REJECTED
from gateway.status.model import AcknowledgedBy
from gateway.supervisor.acknowledged import Acknowledged
from gateway.supervisor.active_alarms import Alarm
from gateway.supervisor.recent_history import RecentHistory

NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)
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
