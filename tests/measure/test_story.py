"""The whole story: a worn machine is measured, its table built, used, judged, and refined."""

from bisect import bisect_right
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.measure.site import COUNTS_PER_MM, Gauge, Machine, Typed, gateway, measuring

NOISE_UM = 0.1
BUILD = ("--from", "0", "--to", "100", "--step", "2.5", "--runs", "2", "--u-instrument", "0.5")
JUDGE = ("--from", "0", "--to", "100", "--targets", "11", "--spread", "5", "--seed", "3", "--runs", "3")
QUICK = ("--dwell", "0", "--yes", "--json")


@pytest.mark.timeout(300)
async def test_a_worn_machine_becomes_accurate_and_a_refinement_keeps_it_so(tmp_path: Path) -> None:
    """Measured off, built, used, judged at targets that lie between the table's points, refined, judged.

    Before, the 40 µm of pitch error and the 20 µm of lost motion cannot make A less than 60 µm. After, there
    is left what a table of straight lines 2.5 mm apart leaves of a sine of 2 µm and 20 mm (0.15 µm), half a
    count twice (0.1 µm) and the noise of the laser: A has 2 s on either side, s being 0.1 µm in the mean and
    twice that where three readings happen to lie apart: about 1 µm. The refinement averages six readings at
    each target; that it makes nothing worse is asserted with 5 % for the noise, which the seeds fix.
    """
    async with Machine(tmp_path, noise_um=NOISE_UM) as machine:
        machine.configure('compensation = "off"\n')
        with Gauge(machine) as gauge:
            built = await _measured(machine, gauge, *BUILD, "--out", "x.tab")
            assert len(built.of("reading")) == gauge.asked == 41 * 2 * 2
            assert "# u_instrument: 0.5\n" in (tmp_path / "readings0.csv").read_text()
            assert_went_through_the_cycle(machine.commanded(), [2.5 * i for i in range(41)], runs=2)
            machine.drive.ledger.writes.clear()

            machine.configure('table = "x.tab"\n')
            report = ("--report", "report.html", "--before", "readings0.csv")
            judged = await _measured(machine, gauge, *JUDGE, "--out", "refined.tab", *report)
            table = built.of("result")[0]["table"]
            _assert_was_corrected(machine.commanded(), judged, table)
            assert judged.of("result")[0]["table"]["refined"] is True

            machine.configure('table = "refined.tab"\n')
            again = await _measured(machine, gauge, *JUDGE)
    before, after, refined = (each.of("result")[0]["results"]["both"]["A"] for each in (built, judged, again))
    assert (tmp_path / "report.html").read_text().startswith("<!DOCTYPE html>")
    assert before >= 0.060
    assert after <= 0.15 * before
    assert refined <= 1.05 * after


@pytest.mark.parametrize(
    ("cycle", "interval", "entries"),
    [
        (("--from", "2", "--to", "103", "--targets", "6", "--table-step", "5"), "5", 22),
        (("--from", "2", "--to", "102", "--step", "10"), "10", 11),
    ],
)
async def test_a_table_that_begins_at_home_is_made_though_home_is_the_end_of_travel(
    tmp_path: Path, cycle: tuple[str, ...], interval: str, entries: int
) -> None:
    """No reading is taken at 0, where the axis has no room to turn round: the grid reaches there."""
    async with Machine(tmp_path) as machine:
        machine.configure('compensation = "off"\n')
        machine.config.write_text(machine.config.read_text().replace("[-5.0, 105.0]", "[0.0, 105.0]"))
        with Gauge(machine) as gauge:
            built = await _measured(
                machine, gauge, *cycle, "--runs", "1", "--out", "x.tab", "--out-format", "centroid-3"
            )
    assert min(reading["target"] for reading in built.of("reading")) >= 2.0
    lines = (tmp_path / "x.tab").read_text().splitlines()
    assert lines[3:5] == [f"INTERVAL {interval}", f"ENTRIES {entries}"]
    assert lines[5].split()[:2] == ["+0.00000000", "+0.00000000"]  # homed forward: that column is 0 at home
    assert len(lines) == 5 + entries


async def _measured(machine: Machine, gauge: Gauge, *arguments: str) -> Typed:
    """One run under a gateway of its own; the readings file is called after what was there before."""
    number = len(list(machine.folder.glob("*.csv")))
    instrument = ("--gauge", gauge.path, *QUICK, "--readings", f"readings{number}.csv")
    async with gateway(machine), measuring(machine, *arguments, *instrument) as typed:
        await typed.until("result")
        assert await typed.end() == 0, typed.stderr
    return typed


def assert_went_through_the_cycle(commanded: list[float], targets: list[float], *, runs: int) -> None:
    """Up and down, 1 mm beyond both ends, nothing twice and nothing else."""
    once = [targets[0] - 1.0, *targets, targets[-1] + 1.0, *reversed(targets)]
    assert commanded == pytest.approx(once * runs, abs=1e-9)
    assert all(one != other for one, other in pairwise(commanded))


def _assert_was_corrected(commanded: list[float], judged: Typed, table: dict[str, Any]) -> None:
    """The drive got each target with the correction of its direction, to half a count of rounding twice."""
    going = [found["target"] for found in judged.of("going")]
    assert len(commanded) == len(going) == 3 * (2 * 11 + 2)
    for before, target, sent in zip(going, going[1:], commanded[1:], strict=False):
        way = "forward" if target > before else "backward"
        correction = _between(table["positions"], table[way], target)
        assert sent == pytest.approx(target + correction, abs=1.1 / COUNTS_PER_MM)


def _between(positions: list[float], values: list[float], place: float) -> float:
    """Straight between points, held outside."""
    if place <= positions[0] or place >= positions[-1]:
        return values[0] if place <= positions[0] else values[-1]
    right = bisect_right(positions, place)
    share = (place - positions[right - 1]) / (positions[right] - positions[right - 1])
    return values[right - 1] + share * (values[right] - values[right - 1])
