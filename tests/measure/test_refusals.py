"""What is refused before anything moves, with the reason and what to do."""

import asyncio
import contextlib
from pathlib import Path

import pytest

from gateway.modbus.mbap import encode_mbap
from tests.measure.site import Machine, gateway, measuring, run_command, supervisor_answers
from tests.support.commands import typed

FEW = ("--from", "0", "--to", "10", "--step", "10", "--runs", "1", "--dwell", "0", "--json")


async def _refused(machine: Machine, *arguments: str) -> str:
    """Run it in this process; nothing may be commanded. Returns what it says.

    In a thread, which cannot listen to signals: for what is refused before it would.
    """
    before = machine.commanded()
    with contextlib.chdir(machine.folder):
        done = await asyncio.to_thread(typed, "measure", str(machine.config), "--axis", "x", *arguments)
    assert done.returncode == 1
    assert machine.commanded() == before
    return done.stderr


async def _refused_apart(machine: Machine, *arguments: str) -> str:
    """As :func:`_refused`, in a process of its own, which listens to signals before it refuses."""
    before = machine.commanded()
    async with measuring(machine, *arguments) as process:
        assert await process.end() == 1
    assert machine.commanded() == before
    return process.stderr


def _leaves_no_file(machine: Machine) -> bool:
    return not list(machine.folder.glob("*.csv"))


REFUSED = [
    (
        ("--from", "0", "--to", "105", "--step", "105", "--yes"),
        "turn-around point (--overrun) 106 is outside",
    ),
    (
        ("--from", "0", "--to", "105", "--step", "105", "--yes"),
        "give --from -4 or more and --to 104 or less, or a smaller --overrun",
    ),
    (("--from", "-6", "--to", "4", "--step", "10", "--yes"), "-7 is outside travel = [-5, 105] mm"),
    (
        ("--from", "0", "--to", "10", "--step", "3", "--yes"),
        "--step 3 does not lead from 0 to 10: end at --to 9",
    ),
    (("--from", "0", "--to", "10", "--yes"), "give --step (even targets)"),
    (("--step", "10", "--yes"), "give --from and --to"),
    ((*FEW, "--yes", "--overrun", "0"), "--overrun 0: it must be greater than the lost motion"),
    ((*FEW, "--yes", "--controller", "panel"), "line main has no controller panel; it has cnc"),
    ((*FEW, "--yes", "--gauge", "/dev/null"), "/dev/null is not a serial port"),
    ((*FEW, "--yes", "--readings", "none.csv", "--csv", "none.txt"), "none.txt: No such file"),
    ((*FEW, "--yes", "--port", "/dev/ttyS0"), "reached by TCP"),
    ((*FEW, "--yes", "--out-format", "excel"), "--out-format excel: allowed are"),
    ((*FEW, "--yes", "--out", "gateway.toml"), "gateway.toml: a file of this name"),
    ((*FEW, "--yes", "--report", "report.pdf"), "end the name with .html, .png, .svg"),
    (
        (*FEW, "--yes", "--method", "block-walk", "--u-instrument", "1"),
        "block-walk: remove the options --u-..., and give --dial-error and --block-temperature-range",
    ),
    (FEW, "cannot ask for confirmation: stdin is not a terminal"),
    (
        ("--from", "0", "--to", "100", "--targets", "6", "--out", "x.tab", "--out-format", "centroid-3"),
        "cannot be written as centroid-3: ",
    ),
]
"""Options that do not fit, and what is said; all of them under one gateway, which takes long to start."""


async def test_options_that_do_not_fit_are_refused(machine: Machine) -> None:
    async with gateway(machine):
        said = [
            await (_refused_apart if {"--csv", "--gauge"} & {*arguments} else _refused)(machine, *arguments)
            for arguments, _ in REFUSED
        ]
    for (arguments, told), stderr in zip(REFUSED, said, strict=True):
        assert told in stderr, arguments
    assert _leaves_no_file(machine)


@pytest.fixture
async def machine(tmp_path: Path):  # type: ignore[no-untyped-def]
    async with Machine(tmp_path) as machine:
        machine.configure('compensation = "off"\n')
        yield machine


async def test_without_a_gateway_nothing_is_asked_of_the_axis(machine: Machine) -> None:
    assert "no gateway runs" in await _refused(machine, *FEW, "--yes")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("counts_per_unit = 10000.0", "counts_per_unit = 100000.0"),
        ("travel = [-5.0, 105.0]", "travel = [-500.0, 1050.0]"),
        ("unit_id = 1", "unit_id = 2"),
    ],
)
async def test_a_configuration_that_the_gateway_was_not_started_with_moves_nothing(
    machine: Machine, old: str, new: str
) -> None:
    async with gateway(machine):
        text = machine.config.read_text()
        assert old in text
        machine.config.write_text(text.replace(old, new))
        said = await _refused(machine, *FEW, "--yes")
    assert "the configuration has changed since the gateway started" in said
    assert "restart the gateway" in said
    assert _leaves_no_file(machine)


async def test_a_file_to_go_on_with_stays_where_nothing_could_be_read(machine: Machine) -> None:
    begun = machine.folder / "begun.csv"
    text = "# axis: x\n# compensation: off\n# targets: 0.0 10.0\n# runs: 1\n# overrun: 1.0\n"
    begun.write_text(text + "target_mm,direction,run,measured_mm\n")
    async with gateway(machine):
        said = await _refused_apart(machine, "--resume", str(begun), "--csv", "none.txt", "--yes")
    assert "none.txt: No such file" in said
    assert begun.read_text().startswith(text)


async def test_a_table_that_the_configuration_now_reads_the_other_way_round_is_not_refined(
    machine: Machine,
) -> None:
    """The file is the same, and each correction the opposite."""
    (machine.folder / "x.txt").write_text("P001 X0 EX 0.001\nP002 X50 EX 0.002\nP003 X100 EX 0.003\n")
    lines = 'table = "x.txt"\ntable_options = {{ error_sense = "{}", file_units = "mm" }}\n'
    machine.configure(lines.format("actual_minus_command"))
    async with gateway(machine, has_supervisor=True):
        await supervisor_answers(machine.folder / "state")
        await run_command("reload", str(machine.config))  # at its start it has read the file once more
        machine.configure(lines.format("command_minus_actual"))
        said = await _refused(machine, *FEW, "--yes")
        assert "table_options of x.txt in CONFIG differ from those of the gateway" in said
        machine.configure(lines.format("actual_minus_command"))
        assert "cannot ask for confirmation" in await _refused(machine, *FEW)


async def test_an_axis_that_is_not_ready_is_not_moved(machine: Machine) -> None:
    async with gateway(machine):
        machine.mechanics.homed = False
        assert "axis x is not homed: home it first" in await _refused(machine, *FEW, "--yes")
        machine.mechanics.homed = True
        machine.mechanics.alarm = True
        assert "axis x reports an alarm" in await _refused(machine, *FEW, "--yes")


async def test_an_axis_that_somebody_else_moves_is_left_to_him(machine: Machine) -> None:
    async with gateway(machine):
        reader, writer = await asyncio.open_connection("127.0.0.1", machine.port)
        stopping = asyncio.Event()

        async def keep_moving() -> None:
            """Write 0 again and again, as a controller that holds the axis."""
            while not stopping.is_set():
                writer.write(encode_mbap(1, 1, bytes.fromhex("10 0100 0002 04 00000000")))
                await reader.readexactly(12)

        moving = asyncio.create_task(keep_moving())
        async with measuring(machine, *FEW, "--yes") as moving_too:
            assert await moving_too.end() == 1
        stopping.set()
        await moving
        writer.close()
    assert "axis x is moved by cnc (127.0.0.1): stop that program, wait" in moving_too.stderr
    assert set(machine.commanded()) == {0.0}


@pytest.mark.parametrize(
    ("rights", "told"),
    [
        ('role = "monitor"', "has 0 controllers that may move axes"),
        ("read_only = true", "controller cnc is read_only"),
    ],
)
async def test_a_listener_that_may_not_move_axes_is_refused(machine: Machine, rights: str, told: str) -> None:
    machine.controller += f"\n{rights}"
    machine.configure('compensation = "off"\n')
    async with gateway(machine):
        assert told in await _refused(machine, *FEW, "--yes")


async def test_a_command_that_is_refused_leaves_an_axis_that_stands_and_nobody_is_alarmed(
    machine: Machine, tmp_path: Path
) -> None:
    """The listener takes no FC16: the first target is refused, and so is what would hold the axis."""
    (tmp_path / "laser.txt").write_text("position\n")
    machine.controller += "\nfunction_codes = [3]"
    machine.configure('compensation = "off"\n')
    async with gateway(machine):
        told = await _refused_apart(machine, *FEW, "--yes", "--csv", "laser.txt")
    assert "the target -1: refused with exception 1 (illegal function)" in told
    assert "axis x is at standstill at 0 mm; its stop was refused" in told
    assert _leaves_no_file(machine)
    assert "EMERGENCY" not in told.upper()
