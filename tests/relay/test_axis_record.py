"""The file of a record: whatever is wrong with it, the relay starts, says so, and begins without it."""

import contextlib
import os
import resource
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.exchange.axis.record_layout import (
    RECORD_SIZE,
    SLOT_SIZE,
    SLOTS_AT,
    RecordSlots,
    Remembered,
    header,
)
from gateway.exchange.commands import SetTable, TableFor
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, CompensationMode, LineTiming
from gateway.modbus.mbap import encode_mbap
from gateway.relay.axis_record import AxisRecord, record_path
from gateway.relay.gateway import Relay
from gateway.state.plan import GatewayPlan, LinePlan
from tests.exchange.line_bench import (
    ACTUAL,
    COMMAND,
    LOST_MOTION,
    Link,
    Memory,
    axis_plan,
    read,
    stream_plan,
    write,
)
from tests.exchange.line_bench import Bench as LineBench
from tests.support.relay import TIMING, Bench, until_up


class Opened:
    """One axis with its record in a file."""

    def __init__(
        self, path: Path, mode: CompensationMode = CompensationMode.ON, *, is_used: bool = True
    ) -> None:
        self.told: list[str] = []
        line = LineExchange([axis_plan(compensation=mode)], LineTiming(), Link(), lambda event: None)
        self.axis = line.axes[0]
        self.record = AxisRecord(self.axis, path)
        self.record.open(self.told.append, is_used=is_used)

    @property
    def saved(self) -> Remembered | None:
        return None if self.axis.recall.record is None else self.axis.recall.record.saved


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A record of an axis that was sent to 50 mm and then to 20 mm."""
    path = record_path(tmp_path, "x")
    records: list[AxisRecord] = []

    def attach(line: LineExchange) -> None:
        records.append(AxisRecord(line.axes[0], path))
        records[0].open(pytest.fail)

    bench = LineBench(axis_plan(), before_up=attach)
    bench.move(50_000)
    bench.move(20_000)
    records[0].close()
    assert path.stat().st_size == RECORD_SIZE
    assert path.stat().st_mode & 0o777 == 0o600
    return path


def test_a_good_file_is_recalled_and_stays_as_it_is_until_it_is_decided(path: Path) -> None:
    before = path.read_bytes()
    for _ in range(2):
        opened = Opened(path)
        assert opened.saved is not None
        assert (opened.saved.nominal_counts, opened.told) == (20_000, [])
        assert not opened.axis.recall.reads_uncorrected
        opened.record.close()
        assert path.read_bytes() == before


def _other_axis(path: Path) -> None:
    path.write_bytes(header("y") + path.read_bytes()[len(header("y")) :])


def _both_slots(path: Path) -> None:
    data = bytearray(path.read_bytes())
    for at in SLOTS_AT:
        data[at + SLOT_SIZE // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda path: path.write_bytes(b"garbage"), "it has 7 bytes and not 12288"),
        (lambda path: path.write_bytes(b"garbage!" * (RECORD_SIZE // 8)), "it is no record of an axis"),
        (lambda path: path.write_bytes(path.read_bytes() + b"!"), "it has 12289 bytes and not 12288"),
        (lambda path: path.write_bytes(path.read_bytes() * 3), "it has 36864 bytes and not 12288"),
        (_other_axis, "it belongs to axis y"),
        (_both_slots, "both of its copies are damaged"),
    ],
    ids=["short", "garbage", "long", "three times as long", "other", "both"],
)
def test_a_spoilt_file_is_made_anew_and_the_axis_goes_without(path: Path, spoil: object, why: str) -> None:
    assert callable(spoil)
    spoil(path)
    opened = Opened(path)
    assert opened.saved is None
    assert opened.axis.recall.record is not None
    assert opened.axis.recall.reads_uncorrected
    assert len(opened.told) == 1
    assert opened.told[0].startswith(f"{path}: {why}")
    assert opened.told[0].endswith("the axis starts without its record")
    opened.record.close()
    again = Opened(path)
    assert (again.saved, again.told) == (None, [])
    again.record.close()


def test_a_start_says_once_that_the_run_before_lost_sight_of_the_axis(tmp_path: Path) -> None:
    """After a lost link a target counts only by proof, which a reading of a monitor is not: a kill comes."""
    path = record_path(tmp_path, "x")
    told: list[str] = []

    def attach(line: LineExchange) -> None:
        AxisRecord(line.axes[0], path).open(told.append)

    bench = LineBench(axis_plan(), before_up=attach)
    bench.move(50_000, 20_000)
    bench.line.link_down(bench.now_ns)
    bench.wait(3_000)
    bench.line.link_up(bench.now_ns)
    bench.serve()
    assert bench.actual() == 20_000
    assert told == []
    opened = Opened(path)
    assert opened.saved is None
    assert opened.told == [
        f"{path}: the run before did not know any more where the axis was; the axis starts without its record"
    ]
    opened.record.close()
    assert Opened(path).told == []


def in_use(path: Path) -> tuple[LineBench, AxisRecord, list[str]]:
    """Return a line whose axis keeps its record in a file, and has moved; its record; what was reported."""
    told: list[str] = []
    records: list[AxisRecord] = []

    def attach(line: LineExchange) -> None:
        records.append(AxisRecord(line.axes[0], path))
        records[0].open(told.append)

    bench = LineBench(axis_plan(), before_up=attach)
    bench.memory.put(ACTUAL, 19_990)
    bench.move(30_000)
    return bench, records[0], told


@pytest.mark.parametrize("size", [0, 1, SLOTS_AT[1] - 1])
def test_a_file_that_is_cut_in_use_is_made_anew_and_holds_from_then_on(path: Path, size: int) -> None:
    """A store into what is no part of the file any more would end the process."""
    bench, record, told = in_use(path)
    os.truncate(path, size)
    bench.move(40_000)
    assert [line for line in told if "was cut" in line] == [
        f"{path} was cut while it was in use; it is made anew, and holds from now on"
    ]
    record.close()
    opened = Opened(path)
    assert opened.saved is not None
    assert opened.saved.nominal_counts == 40_000
    opened.record.close()


def _a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _a_link(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to(path.with_name("elsewhere"))


def _no_folder(path: Path) -> None:
    path.unlink()
    path.parent.rmdir()


@pytest.mark.parametrize("spoil", [_a_folder, _a_link, _no_folder])
def test_where_no_file_can_be_had_the_axis_runs_without_one(path: Path, spoil: object) -> None:
    assert callable(spoil)
    spoil(path)
    opened = Opened(path)
    assert opened.axis.recall.record is None
    [told] = opened.told
    assert told.startswith(f"{path}: ")
    assert told.endswith("no record is kept, and a restart begins without one")
    opened.record.close()


@contextlib.contextmanager
def full_disk() -> Iterator[None]:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_a_full_disk_is_found_at_the_start_and_not_in_the_middle_of_a_store(tmp_path: Path) -> None:
    """A limit on the size of files stands for the disk: the blocks cannot be had."""
    with full_disk():
        opened = Opened(record_path(tmp_path, "x"))
    assert opened.axis.recall.record is None
    assert "no record is kept" in opened.told[0]


def test_a_record_that_could_not_be_kept_is_kept_as_soon_as_there_is_room(tmp_path: Path) -> None:
    path = record_path(tmp_path, "x")
    told: list[str] = []
    record: list[AxisRecord] = []

    def attach(line: LineExchange) -> None:
        record.append(AxisRecord(line.axes[0], path))
        record[0].open(told.append)

    now_s = time.monotonic()
    with full_disk():
        bench = LineBench(axis_plan(), before_up=attach)
        bench.move(50_000)
        record[0].try_again(now_s + 1000.0)
        assert record[0].problem == f"{path}: File too large"
    record[0].try_again(now_s + 1.0)  # not due yet
    assert bench.line.axes[0].recall.record is None
    record[0].try_again(now_s + 1000.0)
    assert record[0].problem == ""
    assert told == [
        f"{path}: File too large: no record is kept, and a restart begins without one",
        f"{path} can be written again: it holds from now on",
    ]
    bench.memory.put(ACTUAL, 49_990)
    bench.move(30_000)
    record[0].close()
    opened = Opened(path)
    assert opened.saved is not None
    assert (opened.saved.nominal_counts, opened.told) == (30_000, [])
    opened.record.close()


def test_a_file_that_was_cut_on_a_full_disk_holds_again_as_soon_as_there_is_room(path: Path) -> None:
    bench, record, told = in_use(path)
    del told[:]
    os.truncate(path, 0)
    with full_disk():
        bench.move(40_000)
        assert record.problem == f"{path} was cut, and File too large"
    record.try_again(time.monotonic() + 1000.0)
    assert (record.problem, len(told)) == ("", 2)
    bench.move(10_000)
    record.close()
    opened = Opened(path)
    assert opened.saved is not None
    assert opened.saved.nominal_counts == 10_000
    opened.record.close()


def test_an_empty_file_says_that_the_run_before_kept_nothing(tmp_path: Path) -> None:
    path = record_path(tmp_path, "x")
    path.touch()
    opened = Opened(path)
    [told] = opened.told
    assert told.startswith(f"{path}: it is empty, because the run before could not write it; it is made anew")
    assert opened.axis.recall.reads_uncorrected
    opened.record.close()
    fresh = Opened(record_path(tmp_path, "new"))
    assert (fresh.told, fresh.axis.recall.reads_uncorrected) == ([], False)
    fresh.record.close()


def test_an_axis_in_shadow_mode_keeps_none_and_empties_what_there_is(path: Path) -> None:
    opened = Opened(path, CompensationMode.SHADOW)
    assert opened.axis.recall.record is None
    assert opened.told == [f"{path}: the axis is in shadow mode; the axis starts without its record"]
    opened.record.close()
    assert RecordSlots(memoryview(bytearray(path.read_bytes())), bytes(16)).read() is None
    fresh = record_path(path.parent, "z")
    Opened(fresh, CompensationMode.SHADOW)
    assert not fresh.exists()


@pytest.mark.parametrize("is_stream", [True, False])
def test_an_axis_whose_table_is_gone_needs_its_record_until_its_correction_has_faded_out(
    tmp_path: Path, is_stream: bool
) -> None:
    path, make = record_path(tmp_path, "x"), stream_plan if is_stream else axis_plan
    told: list[str] = []

    def run(plan: AxisPlan, *setpoints: int) -> bool:
        """Play one run of the gateway; return whether it had a record of the last one."""
        records: list[AxisRecord] = []

        def attach(line: LineExchange) -> None:
            records.append(AxisRecord(line.axes[0], path))
            records[0].open(told.append, find_table=lambda _: LOST_MOTION)

        memory.put(ACTUAL, memory.get(COMMAND))
        bench = LineBench(plan, memory=memory, before_up=attach)
        bench.move(*setpoints)
        records[0].close()
        return "restored" in bench.kinds()

    memory = Memory()
    run(make(), 10_000, 20_000, 30_000, 40_000)
    assert memory.get(COMMAND) == 40_010
    assert run(make(table=None), 40_000) is is_stream
    assert memory.get(COMMAND) == (40_010 if is_stream else 40_000)
    assert run(make(table=None), 40_000, 41_000, 42_000, 43_000) is is_stream
    assert memory.get(COMMAND) == 43_000
    assert not run(make(table=None), 43_000)
    assert told[-1:] == [f"{path}: the axis has no table; the axis starts without its record"]


def test_a_run_that_is_recorded_begins_with_nothing(path: Path) -> None:
    opened = Opened(path, is_used=False)
    assert opened.saved is None
    assert opened.axis.recall.record is not None
    assert "a recording begins with nothing" in opened.told[0]
    opened.record.close()


@pytest.mark.parametrize("has_table", [True, False], ids=["from the start", "its first table while it runs"])
async def test_a_clean_stop_and_a_new_start_go_on_where_the_axis_stands(
    bench: Bench, tmp_path: Path, *, has_table: bool
) -> None:
    memory = Memory()

    def script(data: bytes) -> bytes:
        reply = memory.answer(data[7:])
        if data[7] == 16:
            memory.put(ACTUAL, memory.get(COMMAND))
        return encode_mbap(int.from_bytes(data[:2], "big"), data[6], reply)

    _, where = await bench.drive("tcp", script)
    link, _ = bench.controller_link("tcp")

    async def run(pdu: bytes, answer: bytes, *, has_table: bool = True) -> None:
        plan = axis_plan() if has_table else axis_plan(table=None)
        line = LinePlan("line", where, (link,), (plan,), TIMING)
        relay = Relay(GatewayPlan("bench", (line,)), bench.notes.append, state=tmp_path)
        await relay.start()
        if not has_table:
            relay.command(SetTable(tables=(TableFor("x", "x.csv", "csv", ""),)), [LOST_MOTION])
        await until_up(relay)
        near = await bench.connect(relay.address("line", "cnc"))
        near.write(encode_mbap(1, 1, pdu))
        await near.receives(encode_mbap(1, 1, answer))
        await relay.stop()

    await run(write(COMMAND, 50_000), write(COMMAND, 50_000)[:5], has_table=has_table)
    assert memory.get(ACTUAL) == 50_010
    await run(read(ACTUAL), b"\x03\x04" + ACTUAL.pack(50_000))
    if has_table:
        [note] = [note for note in bench.notes if note.event == "restored"]
        assert note.severity.value == "info"
        assert note.fields["axis"] == "x"
        assert not [note for note in bench.notes if note.event == "record-not-used"]
