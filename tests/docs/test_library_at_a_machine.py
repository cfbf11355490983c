"""The page on using the gateway as a library, at a machine: each block is typed in the folder of one."""

import asyncio
import os
import sys
from pathlib import Path

import pytest

from tests.docs.pages import ROOT, blocks_by_section
from tests.docs.test_library import AT_A_MACHINE
from tests.listen.lines import Frames, Registers, SimulatedLine
from tests.measure.site import SECONDS, Gauge, Machine, gateway

PROBE, LISTEN, MEASURE, CAPTURE, SIGN_TEST = (
    block.text for block in blocks_by_section("library.md")[AT_A_MACHINE]
)


async def assert_types(block: str, folder: Path) -> None:
    """Assert that a block, typed in a folder, gives what it shows."""
    page = folder / "page.txt"
    page.write_text(block)
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "doctest", page.name,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )  # fmt: skip
    said, _ = await asyncio.wait_for(process.communicate(), SECONDS)
    assert process.returncode == 0, said.decode()
    assert not said, said.decode()


def unheard_of() -> Frames:
    """Unit 7: a drive that nobody knows, low word first."""
    return Registers(0x7606, 0x7520, is_low_first=True).goes(7, (10000, -2500, 71234, 1))


async def test_the_drives_are_probed(tmp_path: Path) -> None:
    async with Machine(tmp_path):
        await assert_types(PROBE, tmp_path)


async def test_a_line_is_listened_to(tmp_path: Path) -> None:
    with SimulatedLine(9600, unheard_of) as line:
        (tmp_path / "line").symlink_to(line.path)
        await assert_types(LISTEN, tmp_path)


@pytest.mark.timeout(300)
async def test_the_axis_is_measured_its_frames_are_taken_and_its_table_tested(tmp_path: Path) -> None:
    async with Machine(tmp_path) as machine:
        machine.configure('compensation = "off"\n')
        with Gauge(machine) as gauge:
            (tmp_path / "gauge").symlink_to(gauge.path)
            async with gateway(machine):
                await assert_types(MEASURE, tmp_path)
                await assert_types(CAPTURE, tmp_path)
        machine.configure('table = "x.csv"\n')
        await assert_types(SIGN_TEST, tmp_path)
