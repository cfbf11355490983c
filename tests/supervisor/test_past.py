"""A day of the axes in the state folder: bounded in bytes and in time, and never in anybody's way."""

import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from gateway.catalogue.alarms import DRIVE_SILENT
from gateway.status.model import AcknowledgedBy
from gateway.supervisor import past as past_module
from gateway.supervisor.active_alarms import Alarm
from gateway.supervisor.past import Past
from gateway.supervisor.recent_history import RecentHistory
from tests.support.status_models import relay_model_of

NOON_S = datetime(2026, 5, 1, 12, tzinfo=UTC).timestamp()


def snapshot(nominal: float | None) -> dict[str, Any]:
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
        self.recent.take(relay_model_of(snapshot(nominal)), second)
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
        keeping.recent.take(relay_model_of(snapshot(2.0)), 7200 + 10 * (number + 1))
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


async def test_a_file_of_acknowledgements_that_is_none_is_told(tmp_path: Path) -> None:
    (tmp_path / "acknowledged.json").write_text('[{"kind": 1}]')
    said: list[str] = []
    past = Past(tmp_path, RecentHistory(), lambda event, *_, **fields: said.append(event.name))
    await past.recall()
    assert said == ["acknowledgements-lost"]
