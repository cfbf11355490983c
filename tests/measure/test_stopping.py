"""However a measuring run ends, the axis stands, and what was read is kept."""

import asyncio
import os
import signal
from asyncio.subprocess import Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from gateway.simulator.ledger import MoveKind
from tests.measure.site import COUNTS_PER_MM, SECONDS, Gauge, Machine, Typed, gateway, measuring, run_command
from tests.support.config import tab

TABLE = tab(0.0, (-0.02, -0.04), (-0.04, -0.06))
WIDE = ("--from", "0", "--to", "100", "--step", "100", "--runs", "1", "--dwell", "0", "--yes", "--json")
FEW = ("--from", "0", "--to", "20", "--step", "10", "--runs", "1", "--dwell", "0", "--yes", "--json")
LEADSHINE = """
referenced = "drive-bit"
compensation = "off"
drive = "leadshine-pr"
"""


async def _on_the_way(machine: Machine, low: float, high: float) -> None:
    """Wait until the axis moves, somewhere between two positions."""
    async with asyncio.timeout(SECONDS):
        while True:
            machine.mechanics.advance(machine.clock())
            if machine.mechanics.is_moving and low < machine.mechanics.motor_mm < high:
                return
            await asyncio.sleep(0.002)


async def _until_going_to(typed: Typed, target: float) -> None:
    while (await typed.until("going"))["target"] != target:
        pass


@asynccontextmanager
async def _in_a_move(machine: Machine, low: float) -> AsyncIterator[tuple[Typed, Process]]:
    """A measuring run through a gateway, with the axis beyond ``low`` on its way to 100 mm."""
    with Gauge(machine) as gauge:
        async with (
            gateway(machine) as process,
            measuring(machine, *WIDE, "--gauge", gauge.path, "--readings", "r.csv") as typed,
        ):
            await _until_going_to(typed, 100.0)
            await _on_the_way(machine, low, 90.0)
            yield typed, process


def _rows(machine: Machine) -> list[str]:
    return [row for row in (machine.folder / "r.csv").read_text().splitlines() if row[0] not in "#t"]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
async def test_a_signal_in_the_middle_of_a_move_holds_the_axis(
    tmp_path: Path, number: signal.Signals, code: int
) -> None:
    async with Machine(tmp_path, speed_up=0.5) as machine:
        machine.configure('compensation = "off"\n')
        async with _in_a_move(machine, 30.0) as (typed, _):
            typed.process.send_signal(number)
            standing = await typed.until("standing")
            assert await typed.end() == code
        machine.mechanics.advance(machine.clock())
        *before, held = machine.commanded()
        assert before == [-1.0, 0.0, 100.0]
        assert 30.0 < held < 99.0
        assert not machine.mechanics.is_moving
        assert machine.mechanics.motor_mm == pytest.approx(held, abs=1 / COUNTS_PER_MM)
        assert f"commanded back to {held:.6g}" in standing["text"]
    assert "--resume r.csv" in typed.stderr
    assert _rows(machine) == ["0.0,forward,1,0.0"]


async def test_a_drive_with_a_stop_of_its_own_gets_it(tmp_path: Path) -> None:
    async with Machine(tmp_path, speed_up=0.5, axis=LEADSHINE, make="leadshine-pr") as machine:
        async with _in_a_move(machine, 30.0) as (typed, _):
            typed.press_ctrl_c()
            standing = await typed.until("standing")
            assert await typed.end() == 130
        moves = machine.drive.ledger.moves_of(1)
        assert moves[:3] == [
            (MoveKind.ABSOLUTE, -10_000),
            (MoveKind.ABSOLUTE, 0),
            (MoveKind.ABSOLUTE, 1_000_000),
        ]
        assert [kind for kind, _ in moves[3:]] == [MoveKind.STOP]
        assert "stop command (register 0x6002 = 0x40)" in standing["text"]
        machine.mechanics.advance(machine.clock())
        assert not machine.mechanics.is_moving
        assert machine.mechanics.motor_mm < 100.0


async def test_an_instrument_that_is_gone_ends_the_run_and_the_axis_stands(tmp_path: Path) -> None:
    async with Machine(tmp_path) as machine:
        machine.configure('compensation = "off"\n')
        with Gauge(machine) as gauge:
            async with (
                gateway(machine),
                measuring(machine, *FEW, "--gauge", gauge.path, "--readings", "r.csv") as typed,
            ):
                while (await typed.until("reading"))["target"] != 10.0:
                    pass
                gauge.unplug()
                assert await typed.end() == 1
        assert "unplugged" in typed.stderr
        assert machine.commanded() in ([-1.0, 0.0, 10.0], [-1.0, 0.0, 10.0, 20.0])
        assert len(_rows(machine)) == 2


async def test_a_gateway_that_is_gone_in_the_middle_of_a_move_is_said_loudly(tmp_path: Path) -> None:
    async with Machine(tmp_path, speed_up=0.5) as machine:
        machine.configure('compensation = "off"\n')
        async with _in_a_move(machine, 5.0) as (typed, process):
            os.kill(process.pid, signal.SIGTERM)
            await typed.until("stop-failed")
            assert await typed.end() == 1
        assert "THE AXIS MAY STILL BE MOVING: press the emergency stop" in typed.stderr
        assert machine.commanded() == [-1.0, 0.0, 100.0]
        assert _rows(machine) == ["0.0,forward,1,0.0"]


async def test_a_drive_that_answers_no_more_is_not_commanded_again(tmp_path: Path) -> None:
    """The move goes on in the drive: nobody can stop it over this wire, and it is said."""
    async with Machine(tmp_path, speed_up=0.5) as machine:
        machine.configure('compensation = "off"\n')
        async with _in_a_move(machine, 5.0) as (typed, _):
            await machine.lose_drive()
            assert await typed.end() == 1
        assert "THE AXIS MAY STILL BE MOVING" in typed.stderr
        assert machine.commanded() == [-1.0, 0.0, 100.0]


async def test_a_run_that_was_stopped_goes_on_where_it_was(tmp_path: Path) -> None:
    async with Machine(tmp_path) as machine:
        machine.configure('compensation = "off"\n')
        with Gauge(machine) as gauge:
            async with gateway(machine):
                where = ("--gauge", gauge.path, "--readings", "r.csv")
                async with measuring(machine, *FEW, *where) as typed:
                    for _ in range(4):
                        await typed.until("reading")
                    typed.press_ctrl_c()
                    assert await typed.end() == 130
                done = len(_rows(machine))
                machine.drive.ledger.writes.clear()
                on = ("--resume", "r.csv", "--gauge", gauge.path, "--dwell", "0", "--yes", "--json")
                async with measuring(machine, *on) as typed:
                    result = await typed.until("result")
                    assert await typed.end() == 0, typed.stderr
        # Readings 1 to 3 are forward at 0, 10 and 20; 4 to 6 come after the turn at 21.
        assert done in (4, 5)
        left = [20.0, 10.0, 0.0][done - 3 :]
        assert machine.commanded() == [21.0, *left]
        assert [row.split(",")[:2] for row in _rows(machine)] == [
            ["0.0", "forward"], ["10.0", "forward"], ["20.0", "forward"],
            ["20.0", "backward"], ["10.0", "backward"], ["0.0", "backward"],
        ]  # fmt: skip
        assert result["table"]["positions"] == [0.0, 10.0, 20.0]


async def test_a_switched_compensation_is_noticed_and_the_reading_not_taken(tmp_path: Path) -> None:
    """Readings with a table and without it never stand in one file."""
    async with Machine(tmp_path) as machine:
        (tmp_path / "x.tab").write_text(TABLE)
        machine.configure('table = "x.tab"\n')
        laser = tmp_path / "laser.csv"
        laser.write_text("position\n")
        async with (
            gateway(machine),
            measuring(machine, *FEW, "--csv", str(laser), "--readings", "r.csv") as typed,
        ):
            await typed.until("waiting")
            await run_command("disable", str(machine.config), "x")
            with laser.open("a") as stream:
                stream.write("0.0\n")
            assert await typed.end() == 1
    assert "changed from active" in typed.stderr
    assert not (tmp_path / "r.csv").exists()
