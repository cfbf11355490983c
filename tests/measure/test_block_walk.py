"""One block and a dial: ``measure --method block-walk`` leads through the walk, and makes the table."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from gateway.commissioning.measure.errors import FileError
from gateway.commissioning.measure.readings_file import ReadingsFile, WalkPlan, facts_of, read_earlier
from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.formats.load import read_survey
from gateway.metrology.readings import Reading
from gateway.metrology.standard import Grade, Standard
from gateway.metrology.walk import Walk
from gateway.simulator.screw import Screw
from tests.measure.site import REGISTERS, Machine, Typed, gateway, measuring, written_alone
from tests.support.commands import typed as typed_here
from tests.support.config import tab

BENT = Screw(length_mm=100.0, progressive_um_per_m=150.0, bow_um=6.0)
"""15 µm of progressive error over 100 mm, and a bow of 6 µm: E is 20 µm and more with the lost motion."""
BLOCK = 20.0
WALK = ("--method", "block-walk", "--from", "0", "--to", "100", "--block", "20", "--dial-range", "3")
PLACEMENTS = 8
FEW = (
    *WALK,
    "--placements",
    str(PLACEMENTS),
    "--block-uncertainty",
    "0.02",
    "--lead",
    "5",
    "--dwell",
    "0",
    "--yes",
)
OFF = 'compensation = "off"\n'


@dataclass
class Person:
    """What a person with a dial and a block does: types what the dial shows, and Enter when asked to act."""

    machine: Machine
    typed: Typed
    zero: float = 0.0
    is_block_in: bool = False
    said: dict[tuple[str, int], str] = field(default_factory=dict)
    """What to type once in place of what is asked for: by what is asked, and the placement."""

    def answer(self, event: dict[str, Any]) -> None:
        """Do what an event asks for."""
        if event["event"] == "hands":
            self._act(event["do"], event["placement"])
        elif event["event"] == "waiting":
            other = self.said.pop(("reading", event["run"]), None)
            dial = self.machine.reading() - self.zero - (BLOCK if self.is_block_in else 0.0)
            self.type(f"{dial:.4f}" if other is None else other)

    def _act(self, what: str, placement: int) -> None:
        if what == "place":
            self.zero, self.is_block_in = self.machine.reading() - 0.1, False
        elif what == "insert":
            self.is_block_in = True
        else:
            self.is_block_in = False
            self.type(self.said.pop((what, placement), ""))

    def type(self, line: str) -> None:
        assert self.typed.process.stdin is not None
        self.typed.process.stdin.write(f"{line}\n".encode())


async def _walked(machine: Machine, *more: str, said: dict[tuple[str, int], str] | None = None) -> Typed:
    arguments = (*FEW, "--json", "--readings", "walk.csv", *more)
    async with gateway(machine), measuring(machine, *arguments, stdin=asyncio.subprocess.PIPE) as typed:
        person = Person(machine, typed, said=dict(said or {}))
        for _ in range(4 * PLACEMENTS):
            await typed.until("reading", person.answer)
        await typed.until("result", person.answer)
        assert await typed.end() == 0, typed.stderr
    return typed


@pytest.mark.timeout(600)
async def test_a_block_of_20_mm_and_a_dial_make_the_table_of_a_bent_screw(tmp_path: Path) -> None:
    """The dial shows 0.1 µm. A placement slipped, and is taken back at the next one.

    The table leaves what 8 placements of 20 mm show of a bow of 6 µm, and counts of 0.1 µm.
    """
    async with Machine(tmp_path, screw=BENT) as machine:
        machine.configure(OFF)
        said = {("clear", 4): "b"}
        walked = await _walked(machine, "--out", "x.csv", "--out-format", "csv", said=said)
    assert "how good      E of " in walked.stderr
    [promised] = walked.of("promise")
    # 0.02 µm (k = 2) for each 20 mm of 100: 0.05 µm as a standard deviation, 1.645 of them for nine of ten.
    assert promised["by_block_um"] == pytest.approx(1.645 * 0.05)
    assert walked.of("taken-back") == [{"event": "taken-back", "placement": 3, "readings": 4}]
    # Placement 3 was measured twice.
    assert len(walked.of("reading")) == 4 * (PLACEMENTS + 1)
    survey = read_survey(tmp_path / "walk.csv")
    assert [sum(each.run == run for each in survey.readings) for run in range(1, 9)] == [4] * PLACEMENTS
    [result] = walked.of("result")
    table = result["table"]
    forward = dict(zip(table["positions"], table["forward"], strict=True))
    first, last = min(forward), max(forward)
    # 150 µm a metre too far: 15 µm less at 100 mm than at 0.
    assert 1000 * (forward[last] - forward[first]) == pytest.approx(-15.0, abs=0.5)
    middle = min(forward, key=lambda x: abs(x - 50.0))
    line = forward[first] + (forward[last] - forward[first]) * middle / 100.0
    assert 1000 * (forward[middle] - line) == pytest.approx(-6.0, abs=0.5)
    # 20 µm of lost motion: forward so much more is added than backward.
    reversal = [f - b for f, b in zip(table["forward"], table["backward"], strict=True)]
    assert 1000 * sum(reversal) / len(reversal) == pytest.approx(20.0, abs=0.3)
    assert (tmp_path / "x.csv").read_text()


async def test_a_walk_that_was_stopped_goes_on_with_its_next_placement(tmp_path: Path) -> None:
    async with Machine(tmp_path, screw=BENT) as machine:
        machine.configure(OFF)
        arguments = (*FEW, "--placements", "5", "--json", "--readings", "walk.csv")
        async with gateway(machine):
            async with measuring(machine, *arguments, stdin=asyncio.subprocess.PIPE) as typed:
                person = Person(machine, typed, said={("remove", 2): "q"})
                await typed.until("standing", person.answer)
                assert await typed.end() == 1
            assert "7 readings are in walk.csv; continue with the same instrument" in typed.stderr
            on = ("--method", "block-walk", "--resume", "walk.csv", "--dwell", "0", "--yes", "--json")
            async with measuring(machine, *on, stdin=asyncio.subprocess.PIPE) as typed:
                person = Person(machine, typed)
                await typed.until("result", person.answer)
                assert await typed.end() == 0, typed.stderr
    # Placement 2 had three readings: its zero is lost, and it is measured again.
    assert [event["run"] for event in typed.of("reading")][:5] == [2, 2, 2, 2, 3]
    runs = [each.run for each in read_survey(tmp_path / "walk.csv").readings]
    assert runs == [run for run in range(1, 6) for _ in range(4)]


async def test_a_dial_that_counts_down_is_named_at_the_first_block(tmp_path: Path) -> None:
    """The first placement moves by the block and the range of the dial: 3 mm, which it shows as -3."""
    async with Machine(tmp_path, screw=BENT) as machine:
        machine.configure(OFF)
        async with (
            gateway(machine),
            measuring(machine, *FEW, "--readings", "w.csv", stdin=asyncio.subprocess.PIPE) as typed,
        ):
            assert typed.process.stdin is not None
            typed.process.stdin.write(b"\n0.1\n-2.9\nq\n")
            assert await typed.end() == 1
    assert "from what the first reading of this placement leads to" in typed.stderr
    assert "--reversed: it counts down while the gap opens" in typed.stderr
    assert machine.commanded() == [-1.0, 0.0, 23.0]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (WALK, "block-walk: the block: give either its grade"),
        ((*WALK, "--block-grade", "1", "--block-uncertainty", "0.1"), "block-walk: the block: give either"),
        ((*WALK, "--block-grade", "1", "--step", "5"), "remove --step and --targets: a block-walk has"),
        (WALK[:-2], "block-walk: give --block, the length of the block, and --dial-range"),
        (WALK[:2], "give --from and --to: the ends of the walk"),
        ((*WALK[:5], "30", *WALK[6:], "--block-grade", "1"), "the range must be at least twice the block"),
        (("--from", "0", "--to", "10", "--step", "5", "--block", "20"), "need --method block-walk"),
    ],
)
def test_options_that_make_no_walk_are_refused(tmp_path: Path, arguments: tuple[str, ...], told: str) -> None:
    config = written_alone(tmp_path, OFF + REGISTERS)
    done = typed_here("measure", str(config), "--axis", "x", *arguments)
    assert done.returncode == 1
    assert told in done.stderr


async def test_a_block_is_not_walked_with_a_table_in_use(tmp_path: Path) -> None:
    async with Machine(tmp_path) as machine:
        (tmp_path / "x.tab").write_text(tab(0.0, (-0.02, -0.04), (-0.04, -0.06)))
        machine.configure('table = "x.tab"\n')
        async with gateway(machine), measuring(machine, *FEW) as typed:
            assert await typed.end() == 1
    assert "a block is walked without a table: first type pitch-gateway disable" in typed.stderr
    assert machine.commanded() == []


PLAN = WalkPlan(Walk(0.0, 100.0, 20.0, 5, 3.0, closes=True), Standard(Grade.ONE), 1.0, Units.MM)


def _written(path: Path, count: int) -> list[Reading]:
    stops = [each for each in PLAN.stops if each.measure][:count]
    readings = [Reading(s.nominal, s.direction, s.block - 0.125, s.run, block=s.block) for s in stops]
    file = ReadingsFile(path, Units.MM, -1.0)
    file.create(facts_of(PLAN, "x", "off", Units.MM))
    for each in readings:
        file.append(each)
    file.close()
    return readings


def test_the_file_of_a_walk_comes_back_and_loses_what_is_taken_back(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    readings = _written(path, 7)
    earlier = read_earlier(path, Units.MM)
    assert (earlier.plan, list(earlier.readings)) == (PLAN, readings)
    assert PLAN.left(7)[0].run == 2
    file = ReadingsFile(path, Units.MM, -1.0)
    file.go_on()
    file.take_back(3)
    file.append(readings[4])
    file.take_back(1)
    file.append(readings[5])
    file.close()
    assert list(read_earlier(path, Units.MM).readings) == [*readings[:4], readings[5]]
    # The dial counts up while the gap opens: here while the axis moves backward.
    assert path.read_text().splitlines()[-1].endswith(",20.0,0.125")


def test_a_closing_gap_is_walked_from_the_upper_end_of_each_block() -> None:
    first = PLAN.stops[:6]
    up, down = Direction.FORWARD, Direction.BACKWARD
    assert [(each.nominal, each.direction, each.block) for each in first] == [
        (24.0, up, 0.0), (23.0, down, 0.0), (0.0, down, -20.0),
        (-1.0, down, 0.0), (0.0, up, -20.0), (23.0, up, 0.0),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda text: text.replace("# block: 20.0\n", ""), "do not state the walk .'block'."),
        (
            lambda text: text.replace("# block_grade: 1\n", ""),
            "do not state the walk .the block: give either",
        ),
        (
            lambda text: text.replace("-20.0", "x").replace(",20.0,", ",x,"),
            "as in 50.0,forward,1,50.0,0.0123",
        ),
    ],
)
def test_a_changed_file_of_a_walk_is_not_gone_on_with(
    tmp_path: Path, change: Callable[[str], str], told: str
) -> None:
    path = tmp_path / "walk.csv"
    _written(path, 4)
    path.write_text(change(path.read_text()))
    with pytest.raises(FileError, match=told):
        read_earlier(path, Units.MM)
