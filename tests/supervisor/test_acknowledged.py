"""An acknowledgement belongs to one occurrence of an alarm: it ends with it, and not before."""

from datetime import UTC, datetime, timedelta

from gateway.catalogue.troubles import DRIVE_SILENT, RELAY_DOWN, TABLE_REJECTED
from gateway.status.model import AcknowledgedBy
from gateway.supervisor.acknowledged import Acknowledged
from gateway.supervisor.chronicle import Chronicle
from gateway.supervisor.trouble import Trouble

NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)
SILENT = Trouble(DRIVE_SILENT, ("xyz", "1"), "axis x", "its drive has not answered for 12 s", ("x",), 12.0)
BAD = Trouble(TABLE_REJECTED, ("xyz", "1", "x"), "axis x", "cnc10x.tab:3: no number", ("x",))
DOWN = Trouble(RELAY_DOWN, (), "gateway", "the relay is not running", ("x",))
BY = AcknowledgedBy(by="shift", at="2026-05-01T12:00:00+00:00")


def seen(chronicle: Chronicle, *found: Trouble, second: float) -> list[AcknowledgedBy | None]:
    chronicle.acknowledged.follow(found, second)
    return [each.acknowledged for each in chronicle.stamp(found, NOON + timedelta(seconds=second))]


def acknowledged_at_noon() -> Chronicle:
    chronicle = Chronicle()
    assert seen(chronicle, SILENT, BAD, second=0) == [None, None]
    done = chronicle.acknowledge("drive-silent", "axis x", "2026-05-01T11:59:48+00:00", "shift", NOON)
    assert done is not None
    assert done.as_data() == {"by": BY.by, "at": BY.at}
    return chronicle


def test_it_is_of_one_alarm_and_the_first_who_saw_it_stays() -> None:
    chronicle = acknowledged_at_noon()
    assert seen(chronicle, SILENT, BAD, second=1) == [BY, None]
    again = chronicle.acknowledge("drive-silent", "axis x", "2026-05-01T11:59:48+00:00", "late", NOON)
    assert again is not None
    assert again.by == "shift"


def test_an_alarm_that_is_another_one_by_now_is_not_acknowledged() -> None:
    chronicle = Chronicle()
    seen(chronicle, SILENT, second=0)
    for kind, where, since in (
        ("drive-silent", "axis x", "2026-05-01T11:00:00+00:00"),
        ("drive-silent", "axis y", "2026-05-01T11:59:48+00:00"),
        ("line-down", "axis x", "2026-05-01T11:59:48+00:00"),
    ):
        assert chronicle.acknowledge(kind, where, since, "shift", NOON) is None
    assert seen(chronicle, SILENT, second=1) == [None]


def test_it_ends_with_the_alarm() -> None:
    chronicle = acknowledged_at_noon()
    assert seen(chronicle, BAD, second=1) == [None]
    assert seen(chronicle, SILENT, BAD, second=2) == [None, None]


def test_it_stays_while_a_worse_one_hides_the_alarm() -> None:
    chronicle = acknowledged_at_noon()
    assert seen(chronicle, DOWN, second=1) == [None]
    assert seen(chronicle, SILENT, second=2) == [BY]
    told = chronicle.stamp([SILENT], NOON)
    assert told[0].since == "2026-05-01T11:59:48+00:00"


def test_after_a_restart_it_waits_thirty_seconds_for_its_alarm() -> None:
    kept = acknowledged_at_noon().acknowledged.encoded()
    chronicle = Chronicle()
    chronicle.acknowledged.restore(kept, 1000.0)
    assert seen(chronicle, second=1029.9) == []
    assert seen(chronicle, SILENT, second=1029.95) == [BY]
    assert seen(chronicle, second=1029.99) == []
    assert seen(chronicle, SILENT, second=1030) == [BY]
    assert seen(chronicle, second=1031) == []
    assert seen(chronicle, SILENT, second=1032) == [None]


def test_they_are_bounded() -> None:
    acknowledged = Acknowledged()
    for number in range(300):
        trouble = Trouble(DRIVE_SILENT, ("xyz", str(number)), f"axis {number}", "silent")
        acknowledged.add(trouble, "", "shift", NOON)
    assert acknowledged["drive-silent", ("xyz", "43")] is None
    assert acknowledged["drive-silent", ("xyz", "44")] is not None
