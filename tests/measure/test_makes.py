"""Drives that wait for a trigger, as their manuals have them: each target is run once, in order."""

from pathlib import Path

import pytest

from gateway.simulator.ledger import MoveKind
from tests.measure.site import Gauge, Machine, gateway, measuring

FEW = ("--from", "0", "--to", "10", "--step", "10", "--runs", "1", "--dwell", "0", "--yes", "--json")
AXIS = """
referenced = "absolute"
compensation = "off"
drive = "{drive}"
"""
ENABLING = {"kinco-fd": bytes.fromhex("10 3100 0001 02 000F")}
"""What its controller writes before the first move, in CiA 402's control word."""
CYCLE = [-10_000, 0, 100_000, 110_000, 100_000, 0]
"""1 mm below 0, up to 10 mm, 1 mm above, and down again; 10 000 counts each."""


@pytest.mark.parametrize("make", ["delta-asda", "kinco-fd", "oriental-az", "leadshine-pr"])
async def test_a_staged_target_is_started_once_and_the_drive_goes_there(tmp_path: Path, make: str) -> None:
    async with Machine(tmp_path, axis=AXIS.format(drive=make), make=make) as machine:
        if make in ENABLING:
            assert machine.drive.answer(ENABLING[make], machine.clock()) == ENABLING[make][:5]
        with Gauge(machine) as gauge:
            async with (
                gateway(machine),
                measuring(machine, *FEW, "--gauge", gauge.path, "--readings", "r.csv") as typed,
            ):
                assert await typed.end() == 0, typed.stderr
        assert machine.drive.ledger.moves_of(1) == [(MoveKind.ABSOLUTE, counts) for counts in CYCLE]


async def test_a_drive_that_is_not_enabled_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    async with Machine(tmp_path, axis=AXIS.format(drive="kinco-fd"), make="kinco-fd") as machine:
        async with gateway(machine), measuring(machine, *FEW, "--csv", "none") as typed:
            assert await typed.end() == 1
        assert not machine.drive.ledger.writes
    assert "register 0x3100 holds 0x0000; writing 0x0010 there would also stop" in typed.stderr
