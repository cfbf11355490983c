"""Tables handed to a relay that runs and refused, or replaced: it is unharmed, and nothing stays open."""

import os
import struct
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.compensation.units import Units
from gateway.ipc.sealed_memory import seal
from gateway.state.tables import HEADER_BYTES, compiled
from tests.relay.handover_site import STEEPER, descriptors_open, machine, table_of, without_actual
from tests.support.relay import Bench, eventually


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
