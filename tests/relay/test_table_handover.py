"""Tables handed to a relay that runs: how they come into force, and what is refused."""

import asyncio
import os
import struct
import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from gateway.compensation.settings import Setpoints
from gateway.compensation.units import Units
from gateway.exchange.commands import ClearTable, Disable, Enable, SetGain, SetLimits
from gateway.ipc.client import ask
from gateway.ipc.messages import Done, GetStatus, Status
from gateway.ipc.sealed_memory import seal
from gateway.recording.writer import Recorder
from gateway.state.tables import HEADER_BYTES, compiled, digest_of
from tests.relay.handover_site import STEEPER, descriptors_open, machine, table_of, without_actual
from tests.support.recordings import HEADER, replayed
from tests.support.relay import Bench, eventually
from tests.support.status_models import plain


async def test_a_table_is_in_force_with_the_next_different_target(bench: Bench, tmp_path: Path) -> None:
    mill = await machine(bench, tmp_path, without_actual())
    assert await mill.move(50_000) == 50_050
    done = await mill.give(("x", STEEPER))
    assert done == Done(changed=("x",), comes={"x": "next-target"})
    assert len(mill.told) == 1  # nothing moves by itself
    assert await mill.move(50_000) == 50_050  # the same target, the same words
    assert await mill.move(50_001) == 50_101  # 0.2 % of 50.001 mm are 100.002 counts
    assert await mill.move(50_000) == 50_100
    reply = await asyncio.to_thread(ask, mill.socket, GetStatus())
    assert isinstance(reply, Status)
    table = reply.status.axes["x"].table
    assert table.compiled == digest_of(compiled(STEEPER))
    assert (table.file, table.sha256, table.points) == ("new.tab", "f" * 64, 2)
    await eventually(lambda: "table-activated" in [note.event for note in bench.notes])
    [note] = [note for note in bench.notes if note.event == "table-activated"]
    assert (note.fields["axis"], note.fields["comes"], note.fields["points"]) == ("x", "next-target", 2)
    assert (note.fields["sha256"], note.fields["pid"]) == ("f" * 64, os.getpid())


async def test_a_stream_never_steps_by_more_than_the_blend_allows(bench: Bench, tmp_path: Path) -> None:
    """From 20 to 60 counts over 10 mm in setpoints of 0.1 mm.

    sin² over D adds (π/2)·d/D of slope at most: (π/2)·0.04/10 = 0.0063, that is 0.63 counts on each setpoint
    of 100 counts. Rounded to whole counts a step is 100 or 101 counts, and never 102.
    """
    axis = without_actual()
    settings = replace(axis.settings, setpoints=Setpoints.STREAM, reload_distance=10.0)
    mill = await machine(bench, tmp_path, replace(axis, settings=settings, table=table_of(0.02, 0.02)))
    for counts in range(10_000, 22_000, 100):
        await mill.move(counts)
    assert mill.told[-1] == (1, 21_900 + 20)
    done = await mill.give(("x", table_of(0.06, 0.06)))
    assert done.comes == {"x": "blended"}
    before = len(mill.told)
    for counts in range(22_000, 34_000, 100):
        await mill.move(counts)
    positions = [position for _, position in mill.told[before - 1 :]]
    steps = {after - position for position, after in pairwise(positions)}
    assert steps == {100, 101}
    offsets = [position - (21_900 + 100 * number) for number, position in enumerate(positions)]
    assert offsets[0] == offsets[1] == 20  # the blend begins where the axis is
    # 5 mm later half of 40 counts are there, and all of them after 10 mm.
    assert offsets[1 + 50] == 40
    assert offsets[1 + 100 :] == [60] * 20
    assert offsets[1 + 99] in (59, 60)


async def test_the_same_corrections_in_another_file_only_change_its_sum(bench: Bench, tmp_path: Path) -> None:
    """From 20 to 60 counts over 10 mm; after 5 mm half of it is there. A blend anew would begin at 40."""
    axis = without_actual()
    settings = replace(axis.settings, setpoints=Setpoints.STREAM, reload_distance=10.0)
    mill = await machine(bench, tmp_path, replace(axis, settings=settings, table=table_of(0.02, 0.02)))
    for counts in range(10_000, 22_000, 100):
        await mill.move(counts)
    await mill.give(("x", table_of(0.06, 0.06)))
    for counts in range(22_000, 27_100, 100):
        told = await mill.move(counts)
    assert told == 27_000 + 40
    assert (await mill.give(("x", table_of(0.06, 0.06)), sha256="e" * 64)).changed == ("x",)
    assert mill.relay.status().axes["x"].table.sha256 == "e" * 64
    for counts in range(27_100, 32_100, 100):
        told = await mill.move(counts)
    assert told == 32_000 + 60


async def test_a_table_that_goes_takes_its_correction_along(bench: Bench, tmp_path: Path) -> None:
    mill = await machine(bench, tmp_path, without_actual())
    assert await mill.move(50_000) == 50_050
    assert await mill.say(ClearTable(axes=("x",))) == Done(changed=("x",), comes={"x": "next-target"})
    assert await mill.move(50_000) == 50_050
    assert await mill.move(60_000) == 60_000
    assert mill.relay.status().axes["x"].compensation == "no-table"
    [note] = [note for note in bench.notes if note.event == "table-removed"]
    assert note.fields["detail"] == "its file is gone, or the configuration names none"
    assert await mill.say(ClearTable(axes=("x",))) == Done()  # nothing to take away
    assert (await mill.give(("x", STEEPER))).changed == ("x",)
    assert await mill.move(50_000) == 50_100


async def test_another_gain_is_in_force_with_the_next_target(bench: Bench, tmp_path: Path) -> None:
    mill = await machine(bench, tmp_path, without_actual())
    done = await mill.say(SetGain(forward=0.5, backward=1.0))
    assert done == Done(changed=("x",), comes={"x": "next-target"})
    await mill.move(10_000)  # on a branch that nobody knows yet
    assert await mill.move(50_000) == 50_025  # forward: half of 50 counts
    assert await mill.move(40_000) == 40_040  # backward: all of 40
    assert await mill.say(SetGain(forward=0.5, backward=1.0)) == Done()


async def test_other_limits_hold_from_now_on(bench: Bench, tmp_path: Path) -> None:
    mill = await machine(bench, tmp_path, without_actual())
    too_much = ("x", table_of(0.0, 0.6))
    assert "more than max_correction = 0.5" in (await mill.give(too_much)).problems[0]
    wider = SetLimits(axis="x", max_correction=0.7, max_slope=0.02, travel_margin=0.7, budget_us=300.0)
    assert await mill.say(wider) == Done(changed=("x",))
    assert (await mill.give(too_much)).changed == ("x",)
    assert await mill.say(wider) == Done()  # nothing changes
    assert mill.relay.status().axes["x"].latency.budget_us == 300.0


async def test_a_table_for_an_axis_that_is_off_waits(bench: Bench, tmp_path: Path) -> None:
    mill = await machine(bench, tmp_path, without_actual())
    await mill.say(Disable())
    assert (await mill.give(("x", STEEPER))).comes == {"x": "not-in-force"}
    assert await mill.move(50_000) == 50_000
    await mill.say(Enable())
    assert await mill.move(50_001) == 50_101


async def test_of_a_group_all_axes_get_their_tables_or_none(bench: Bench, tmp_path: Path) -> None:
    y1 = without_actual(name="y1")
    y2 = without_actual(name="y2", unit_id=2)
    mill = await machine(bench, tmp_path, y1, y2, groups=(("y1", "y2"),))
    done = await mill.give(("y1", STEEPER), ("y2", table_of(0.0, 0.6)))
    assert done.changed == ()
    assert "the table for axis y2 corrects by 0.6 mm" in done.problems[0]
    assert await mill.move(50_000, 1) == 50_050
    done = await mill.give(("y1", STEEPER), ("y2", STEEPER))
    assert done.comes == {"y1": "next-target", "y2": "next-target"}
    assert await mill.move(50_001, 1) == 50_101
    assert await mill.move(50_001, 2) == 50_101
    # One loses its table, both lose it; one alone does not get it back.
    assert (await mill.say(ClearTable(axes=("y1",)))).changed == ("y1", "y2")
    done = await mill.give(("y1", STEEPER))
    assert done.changed == ()
    assert "axis y2 of the group of y1 has no table" in done.problems[0]
    assert await mill.move(50_000, 1) == 50_000
    assert (await mill.give(("y1", STEEPER), ("y2", STEEPER))).changed == ("y1", "y2")
    assert "two tables for axis y1" in (await mill.give(("y1", STEEPER), ("y1", STEEPER))).problems[0]


async def test_a_command_sets_a_groups_gain_the_configuration_each_axis(bench: Bench, tmp_path: Path) -> None:
    y1 = without_actual(name="y1")
    y2 = without_actual(name="y2", unit_id=2)
    mill = await machine(bench, tmp_path, y1, y2, groups=(("y1", "y2"),))
    await mill.move(50_000, 2)
    await mill.move(50_000, 1)  # both have gone: nothing is put off (M11)

    def axes() -> Any:
        return plain(mill.relay.status().axes)

    half = SetGain(axes=("y1",), forward=0.5, backward=0.5, is_configured=True)
    assert (await mill.say(half)).changed == ("y1",)
    assert await mill.move(50_002, 1) == 50_027
    assert await mill.move(50_001, 2) == 50_051
    status = axes()
    assert status["y1"]["configured"]["gain"] == {"forward": 0.5, "backward": 0.5}
    assert status["y2"]["configured"]["gain"] == {"forward": 1.0, "backward": 1.0}
    none = SetGain(axes=("y1",), forward=0.0, backward=0.0)
    assert (await mill.say(none)).changed == ("y1", "y2")
    status = axes()
    assert status["y1"]["gain"] == status["y2"]["gain"] == {"forward": 0.0, "backward": 0.0}
    assert status["y1"]["configured"]["gain"] == {"forward": 0.5, "backward": 0.5}


async def test_what_was_handed_over_is_in_a_recording_and_replayed(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    mill = await machine(bench, tmp_path / "state", without_actual(), recorder=Recorder(path, HEADER))
    await mill.move(50_000)
    await mill.give(("x", STEEPER))
    await mill.give(("x", table_of(0.0, 0.6)))  # refused, then and now
    assert await mill.move(50_001) == 50_101
    await mill.say(SetGain(forward=0.5, backward=0.5))
    assert await mill.move(50_002) == 50_052
    limits = SetLimits(axis="x", max_correction=0.7, max_slope=0.02, travel_margin=0.7, budget_us=300.0)
    await mill.say(limits)
    await mill.give(("x", table_of(0.0, 0.6)))  # accepted now, and in the replay
    assert await mill.move(50_004) == 50_154
    await mill.say(ClearTable(axes=("x",)))
    assert await mill.move(50_003) == 50_003
    plan = mill.relay._plan
    await mill.relay.stop()
    result = replayed(plan, path)
    assert (result.different, result.is_truncated) == (0, False)
    assert result.outputs >= 8  # four requests, four answers


# === refused, or replaced: the relay is unharmed, and nothing stays open =================================


def a_file() -> int:
    with tempfile.TemporaryFile() as file:
        file.write(compiled(STEEPER))
        file.flush()
        return os.dup(file.fileno())


def unsealed() -> int:
    descriptor = os.memfd_create("table", os.MFD_ALLOW_SEALING)
    os.write(descriptor, compiled(STEEPER))
    return descriptor


def of(change: Callable[[bytes], bytes]) -> Callable[[], int]:
    return lambda: seal(change(compiled(STEEPER)), "table")


@pytest.mark.parametrize(
    "case",
    [
        ("q", of(lambda data: data), "axis q: there is none of that name; there are x"),
        ("x", a_file, "the table for axis x: the descriptor is not a memfd"),
        ("x", unsealed, "the table for axis x: the memory is not sealed"),
        ("x", of(lambda data: data[:-8]), "bytes for 2 points, which take"),
        ("x", of(lambda data: data[:40]), "40 bytes are no compiled table"),
        ("x", of(lambda data: b"PGtable\r" + data[8:]), "it begins with b'PGtable"),
        ("x", of(lambda data: data[:8] + struct.pack("=I", 9) + data[12:]), "of version 9; this release"),
        (
            "x",
            of(lambda data: data[:40] + b"\x01" + data[41:]),
            "the header of the compiled table is damaged",
        ),
        ("x", of(lambda data: data[: HEADER_BYTES - 1] + b"\0" + data[HEADER_BYTES:]), "is damaged"),
        (
            "x",
            of(lambda data: data[:-8] + struct.pack("=d", -50.0)),
            "the table for axis x: the points of the compiled table are damaged",
        ),
        (
            "x",
            of(lambda data: data[:-8] + struct.pack("=d", float("nan"))),
            "the table for axis x: the points of the compiled table are damaged",
        ),
        (
            "x",
            lambda: seal(compiled(table_of(0.0, 0.001, units=Units.INCH)), "table"),
            "the table for axis x is in inch, not mm",
        ),
        (
            "x",
            lambda: seal(compiled(table_of(0.0, 0.51)), "table"),
            "corrects by 0.51 mm, more than max_correction = 0.5",
        ),
    ],
)
async def test_a_bad_table_is_refused(
    bench: Bench, tmp_path: Path, case: tuple[str, Callable[[], int], str]
) -> None:
    axis, make, said = case
    mill = await machine(bench, tmp_path, without_actual())
    assert await mill.move(50_000) == 50_050
    before = descriptors_open()
    for _ in range(20):
        done = await mill.give_descriptors([axis], [make()])
        assert done.changed == ()
        [problem] = done.problems
        assert said in problem
    await eventually(lambda: descriptors_open() == before)
    assert await mill.move(60_000) == 60_060  # the old table
    await mill.relay.stop()
    # Once, not twenty times.
    refused = [str(note.fields["detail"]) for note in bench.notes if note.event == "table-refused"]
    assert refused == [problem]


async def test_tables_that_are_replaced_leave_no_descriptors_behind(bench: Bench, tmp_path: Path) -> None:
    mill = await machine(bench, tmp_path, without_actual())
    counts = []
    for number in range(12):
        await mill.give(("x", table_of(0.0, 0.1 + number / 100)))
        # At 50 mm: 50 counts and 5 more for each of them; then somewhere else, that the next differs.
        assert await mill.move(50_000) == 50_050 + 5 * number
        await mill.move(60_000)
        counts.append(descriptors_open())
    # The table in force keeps one, and at times the one before, for a reading that is still fading.
    # Were one left behind by each, the last nine would have nine more than the third.
    assert max(counts[2:]) - min(counts[2:]) <= 1
