"""What is read at a stop: typed on a terminal, appended to a file, sent by a gauge; what is no reading."""

import asyncio
import contextlib
import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from gateway.commissioning.measure.errors import BadReadingError, InstrumentError
from gateway.commissioning.measure.instruments import GrowingCsv
from gateway.simulator.pty import Pty
from gateway.simulator.screw import Screw
from gateway.transport.null_modem import NullModem
from tests.measure.site import COUNTS_PER_MM, SECONDS, Gauge, Machine, Typed, gateway, measuring
from tests.support.processes import press_ctrl_c_at_question

FEW = ("--from", "0", "--to", "10", "--step", "10", "--runs", "1", "--dwell", "0", "--yes")
STRAIGHT = Screw(length_mm=100.0, progressive_um_per_m=1000.0)
"""1 µm of error each millimetre: at 10 mm the nut is at 10.010."""
TRUE = [0.0, 10.01, 9.99 + 0.04, 0.02]
"""Where the nut is: forward at 0 and 10, backward at 10 and 0, 20 µm behind on the other flank."""


def _rows(machine: Machine) -> list[str]:
    return [row for row in (machine.folder / "r.csv").read_text().splitlines() if not row.startswith("#")]


async def test_a_csv_that_grows_gives_a_row_for_each_stop(tmp_path: Path) -> None:
    laser = tmp_path / "laser.csv"
    laser.write_text("time;position;temperature\n11:00;99.0;20.1\n")
    async with Machine(tmp_path, screw=STRAIGHT) as machine:
        machine.configure('compensation = "off"\n')

        def append(event: dict[str, object]) -> None:
            if event["event"] == "waiting":
                with laser.open("a") as stream:
                    stream.write(f"11:01;{machine.reading():.4f};")
                    stream.flush()
                    stream.write("20.2\r\n")

        csv = (
            "--csv",
            str(laser),
            "--column",
            "position",
            "--delimiter",
            ";",
            "--json",
            "--readings",
            "r.csv",
        )
        async with gateway(machine), measuring(machine, *FEW, *csv) as typed:
            result = await typed.until("result", append)
            assert await typed.end() == 0, typed.stderr
    assert _rows(machine) == [
        "target_mm,direction,run,measured_mm",
        "0.0,forward,1,0.0",
        "10.0,forward,1,10.01",
        "10.0,backward,1,10.03",
        "0.0,backward,1,0.02",
    ]
    # What is added is target less measured.
    assert result["table"]["forward"] == pytest.approx([0.0, -0.01])
    assert result["table"]["backward"] == pytest.approx([-0.02, -0.03])
    assert machine.commanded() == [-1.0, 0.0, 10.0, 11.0, 10.0, 0.0]


async def test_a_row_that_came_while_the_axis_moved_is_not_taken(tmp_path: Path) -> None:
    laser = tmp_path / "laser.csv"
    laser.write_text("position\n")
    async with Machine(tmp_path, screw=STRAIGHT) as machine:
        machine.configure('compensation = "off"\n')

        def append_too_early(event: dict[str, object]) -> None:
            if event == {"event": "going", "target": 0.0, "measure": True, "run": 1}:
                with laser.open("a") as stream:
                    stream.write("0.001\n")

        csv = ("--csv", str(laser), "--json", "--readings", "r.csv")
        async with gateway(machine), measuring(machine, *FEW, *csv) as typed:
            await typed.until("standing", append_too_early)
            (why,) = [event["error"] for event in typed.events if event["event"] == "stopping"]
            assert "1 rows came before the axis was at its target" in why
            assert await typed.end() == 1
    assert "1 rows came before the axis was at its target" in typed.stderr
    assert machine.commanded() == [-1.0, 0.0]
    assert not (tmp_path / "r.csv").exists()


async def test_what_came_of_a_row_before_the_axis_stood_is_no_reading(tmp_path: Path) -> None:
    laser = tmp_path / "laser.csv"
    laser.write_text("position\n1.5\n")
    csv = GrowingCsv(laser, "position")
    await csv.open()
    csv.arm()
    with laser.open("a") as stream:
        stream.write("2.")  # the axis moves on, and the rest of it comes when it stands
    with pytest.raises(BadReadingError, match=r"the beginning of a row, b'2\.', came before"):
        csv.arm()
    with laser.open("a") as stream:
        stream.write("5\n")
    with pytest.raises(BadReadingError, match="1 rows came before"):
        csv.arm()
    csv.arm()
    with laser.open("a") as stream:
        stream.write("3.5\n")
    assert await csv.read("next") == 3.5


async def test_a_file_that_is_written_anew_gives_no_old_row_for_a_new_one(tmp_path: Path) -> None:
    laser = tmp_path / "laser.csv"
    laser.write_text("position\n1.5\n")
    csv = GrowingCsv(laser, "position")
    await csv.open()
    csv.arm()
    laser.write_text("position\n1.51\n2.5\n")
    with pytest.raises(InstrumentError, match="another program wrote it again"):
        await csv.read("next")


@pytest.mark.parametrize("push_mm", [0.3, -0.3])
async def test_an_axis_that_was_pushed_away_after_it_arrived_is_not_read(
    tmp_path: Path, push_mm: float
) -> None:
    async with Machine(tmp_path, screw=STRAIGHT) as machine:
        machine.configure('compensation = "off"\n')
        dwells = tuple("1" if before == "--dwell" else each for before, each in pairwise(("", *FEW)))
        with Gauge(machine) as gauge:
            serial = ("--gauge", gauge.path, "--json", "--readings", "r.csv")
            async with gateway(machine), measuring(machine, *dwells, *serial) as typed:
                async with asyncio.timeout(SECONDS):
                    while len(machine.commanded()) < 2 or not machine.mechanics.is_done:
                        machine.mechanics.advance(machine.clock())
                        await asyncio.sleep(0.01)
                    await asyncio.sleep(0.5)  # of the second for which it lets the axis settle
                machine.mechanics.command(push_mm * COUNTS_PER_MM, machine.clock())
                assert await typed.end() == 1
            assert gauge.asked == 0
    assert f"axis x is at {push_mm:g} and has left 0" in typed.stderr
    assert machine.commanded() == [-1.0, 0.0]


async def test_a_listener_on_a_serial_port_is_reached_at_the_other_end_of_its_cable(tmp_path: Path) -> None:
    with contextlib.closing(NullModem()) as cable:
        async with Machine(tmp_path, screw=STRAIGHT) as machine:
            machine.controller = f'rtu = "{cable.near}"\nbaudrate = 115200'
            machine.configure('compensation = "off"\n')
            with Gauge(machine) as gauge:
                async with gateway(machine):
                    from_gauge = (*FEW, "--gauge", gauge.path, "--readings", "r.csv")
                    async with measuring(machine, *from_gauge) as typed:
                        assert await typed.end() == 1
                    assert "give this computer's port with --port" in typed.stderr
                    async with measuring(machine, *from_gauge, "--port", cable.far) as typed:
                        assert await typed.end() == 0, typed.stderr
    assert [float(row.split(",")[3]) for row in _rows(machine)[1:]] == pytest.approx(TRUE)


BAD_LINES: list[tuple[Callable[[float], bytes], str]] = [
    (lambda value: b"ERR1\r", "the gauge reports 'ERR1'"),
    (lambda value: f"{value:+.3f}\r".replace(".", ",").encode(), "is not a reading of a sylvac gauge"),
    (lambda value: f"{value:+.3f}\r{value:+.3f}\r".encode(), "several lines for one stop"),
    (lambda value: b"+25.400\r", "more than 1 (--largest-deviation)"),
    (lambda value: b"+12.", "no reading within 0.5 s"),
]


async def test_a_bad_line_of_a_gauge_is_shown_and_never_asked_for_again(tmp_path: Path) -> None:
    async with Machine(tmp_path, screw=STRAIGHT) as machine:
        machine.configure('compensation = "off"\n')
        async with gateway(machine):
            for answer, told in BAD_LINES:
                machine.drive.ledger.writes.clear()
                with Gauge(machine, answer) as gauge:
                    more = ("--gauge", gauge.path, "--gauge-timeout", "0.5", "--json")
                    async with measuring(machine, *FEW, *more) as typed:
                        await typed.until("standing")
                        assert await typed.end() == 1
                    assert gauge.asked == 1
                assert told in typed.stderr
                assert machine.commanded() == [-1.0, 0.0]


async def test_a_gauge_whose_button_sends_and_that_counts_down_from_another_zero(tmp_path: Path) -> None:
    """Mitutoyo's lines; the instrument shows 0 at 10 mm, and counts down where the axis counts up."""
    async with Machine(tmp_path, screw=STRAIGHT) as machine:
        machine.configure('compensation = "off"\n')
        with Gauge(machine) as gauge:

            def press(event: dict[str, object]) -> None:
                if event["event"] == "waiting":
                    gauge.send(f"01A{10.0 - machine.reading():+09.3f}\r".encode())

            kind = ("--gauge", gauge.path, "--gauge-kind", "mitutoyo", "--reversed", "--zero-at", "10")
            async with (
                gateway(machine),
                measuring(machine, *FEW, *kind, "--json", "--readings", "r.csv") as typed,
            ):
                await typed.until("result", press)
                assert await typed.end() == 0, typed.stderr
    assert [float(row.split(",")[3]) for row in _rows(machine)[1:]] == pytest.approx(TRUE)


class Terminal:
    """A person at a terminal: reads what is asked, types."""

    def __init__(self, typed: Typed, pty: Pty) -> None:
        self._typed = typed
        self._pty = pty

    async def sees(self, text: str) -> None:
        """Wait until a text is shown."""
        assert self._typed.process.stderr is not None
        async with asyncio.timeout(SECONDS):
            shown = b""
            while not shown.endswith(text.encode()):
                more = await self._typed.process.stderr.read(1)
                assert more, shown.decode()
                shown += more
        self._typed.stderr += shown.decode()

    def types(self, text: str) -> None:
        """Type a line."""
        os.write(self._pty.master_fd, text.encode() + b"\n")


async def test_a_person_confirms_reads_and_types(tmp_path: Path) -> None:
    pty = Pty()
    slave = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
    try:
        async with Machine(tmp_path, screw=STRAIGHT) as machine:
            machine.configure('compensation = "off"\n')
            asked = tuple(each for each in FEW if each != "--yes")
            async with (
                gateway(machine),
                measuring(machine, *asked, "--readings", "r.csv", stdin=slave) as typed,
            ):
                person = Terminal(typed, pty)
                await person.sees("WILL MOVE between -1 and 11 mm.")
                await person.sees("may the axis move? [y/N]:")
                assert machine.commanded() == []
                person.types("y")
                await person.sees("0 mm forward, run 1: reading (q stops): ")
                person.types("0,001")
                await person.sees("write a decimal point\n")
                await person.sees("reading (q stops): ")
                person.types("100.01")
                await person.sees("r reads again, q stops\n")
                person.types("r")
                for value in TRUE:
                    await person.sees("reading (q stops): ")
                    person.types(f"{value:.3f}")
                assert await typed.end() == 0, typed.stderr
    finally:
        os.close(slave)
        pty.close()
    assert [float(row.split(",")[3]) for row in _rows(machine)[1:]] == pytest.approx(TRUE)
    # B is the mean forward less the mean backward: 10.01 - 10.03 at one, 0 - 0.02 at the other.
    (row,) = [row for row in typed.stdout.splitlines() if "reversal, largest" in row]
    assert "0.02000" in row


async def test_a_person_who_says_no_moves_nothing_and_q_ends_it(tmp_path: Path) -> None:
    pty = Pty()
    slave = os.open(pty.path, os.O_RDWR | os.O_NOCTTY)
    try:
        async with Machine(tmp_path, screw=STRAIGHT) as machine:
            machine.configure('compensation = "off"\n')
            async with gateway(machine):
                asked = tuple(each for each in FEW if each != "--yes")
                async with measuring(machine, *asked, stdin=slave) as typed:
                    await Terminal(typed, pty).sees("may the axis move? [y/N]:")
                    os.write(pty.master_fd, b"n\n")
                    assert await typed.end() == 1
                async with measuring(machine, *asked, stdin=slave) as typed:
                    await Terminal(typed, pty).sees("may the axis move? [y/N]:")
                    press_ctrl_c_at_question(typed.process.pid)
                    assert await typed.end() == 130
                    assert "nothing was moved" in typed.stderr
                assert machine.commanded() == []
                async with measuring(machine, *FEW, stdin=slave) as typed:
                    await Terminal(typed, pty).sees("reading (q stops): ")
                    os.write(pty.master_fd, b"q\n")
                    assert await typed.end() == 1
                assert machine.commanded() == [-1.0, 0.0]
    finally:
        os.close(slave)
        pty.close()
    assert "q on the keyboard" in typed.stderr
