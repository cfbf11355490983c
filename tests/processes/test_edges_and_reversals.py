"""Beyond the ends of a table and at a reversal the gateway does what each control did, as it is told to."""

from collections.abc import Iterator

import pytest

from tests.processes.workshop import Workshop, workshop_in
from tests.support.config import axis, tab

MINT = """DIM fwd(5) = 10.02, 20.01, 30.00, 40.01, 50.01
PRECISIONTABLE(0, fwd)
PRECISIONINCREMENT.0 = 10
PRECISIONOFFSET.0 = 0
"""
TABLES = {
    "bow.tab": tab(0.0, 0.05, 0.0),
    "ramp.tab": tab(0.0, 0.05, 0.1),
    "lost.tab": tab((0.01, -0.01), (0.01, -0.01), (0.01, -0.01)),
    "fwd.mnt": MINT,
    "flat.tab": tab(0.0, 0.05, 0.05),
}
STREAM = 'setpoints = "stream"\n'
ALONE = 'backlash = { width = 0.2, kind = "homed-forward" }'
AXES = {
    "mint": ("bow.tab", 'outside = "zero"'),
    "isg": ("ramp.tab", 'outside = "hold"'),
    "wmx": ("ramp.tab", "outside = { fade = 20.0 }"),
    "off": ("fwd.mnt", 'outside = { fade = 4.0 }\ntable_options.file_units = "mm"'),
    "refusing": ("ramp.tab", 'outside = "refuse"'),
    "cycles": ("lost.tab", STREAM + "reversal = { cycles = 4 }"),
    "jump": ("lost.tab", STREAM + 'reversal = "step"'),
    "backlash": (
        "flat.tab",
        STREAM + 'backlash = { width = 0.02, kind = "homed-forward" }\nreversal = { cycles = 2 }',
    ),
    "alone": (None, ALONE),
    "interval": (None, f"{STREAM}{ALONE}\nreversal = {{ cycles = 2 }}"),
}
UNIT_IDS = {name: unit_id for unit_id, name in enumerate(AXES, start=1)}


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workshop]:
    axes = [
        axis(
            name,
            more=f"{settings}\n",
            unit_id=UNIT_IDS[name],
            travel=[-50.0, 150.0],
            compensation="on",
            table=table,
        )
        for name, (table, settings) in AXES.items()
    ]
    with workshop_in(tmp_path_factory.mktemp("workshop"), axes, TABLES) as workshop:
        yield workshop


def told(workshop: Workshop, name: str, *targets: int) -> list[int]:
    """Send targets to an axis, in counts; returns what its drive is told."""
    with workshop.master(UNIT_IDS[name]) as master:
        return [master.move(target) for target in targets]


def test_backlash_needs_no_table(workshop: Workshop) -> None:
    """Mint 3.4.1. Homed forward: forward 100 goes out as it is, backward 90 by 0.2 mm further back."""
    assert told(workshop, "alone", 0, 100_000, 90_000, 80_000)[1:] == [100_000, 89_800, 79_800]
    assert told(workshop, "alone", 80_001, -50_000, 150_000) == [80_001, -50_200, 150_000]


def test_backlash_without_a_table_is_distributed_over_cycles(workshop: Workshop) -> None:
    """Mint's BACKLASHINTERVAL: as many setpoints as it takes."""
    assert told(workshop, "interval", 10_000, 60_000, 70_000)[-1] == 70_000
    # of two setpoints: half after the first, sin²(45°)
    assert told(workshop, "interval", 69_000, 68_000, 67_000) == [68_900, 67_800, 66_800]


def test_zero_switches_the_correction_off_beyond_the_ends_and_on_again_inside(workshop: Workshop) -> None:
    assert told(workshop, "mint", 50_000, 120_000, 75_000, -10_000) == [50_050, 120_000, 75_025, -10_000]


def test_hold_keeps_the_value_of_the_end(workshop: Workshop) -> None:
    assert told(workshop, "isg", 50_000, 120_000, -10_000, 150_000) == [50_050, 120_100, -10_000, 150_100]


def test_a_fade_leads_to_zero_over_its_length(workshop: Workshop) -> None:
    # 10 of 20 mm beyond the end: half of 0.1 mm
    assert told(workshop, "wmx", 110_000, 120_000, 150_000) == [110_050, 120_000, 150_000]


def test_a_fade_switches_the_table_of_mints_guide_off_beyond_its_end(workshop: Workshop) -> None:
    # it ends at 50.01 with 50 - 50.01 = -0.01 mm; half of it 2 of 4 mm further, none at 55
    assert told(workshop, "off", 50_010, 52_010, 55_000, 60_000) == [50_000, 52_005, 55_000, 60_000]


def test_refuse_answers_with_an_exception(workshop: Workshop) -> None:
    with workshop.master(UNIT_IDS["refusing"]) as master:
        assert master.move(100_000) == 100_100
        assert master.is_refused(100_001)


def test_a_reversal_over_cycles_is_a_sine_squared_of_as_many_setpoints(workshop: Workshop) -> None:
    assert told(workshop, "cycles", 10_000, 20_000, 30_000, 35_000, 40_000)[-1] == 40_010
    # of 20 counts: sin² of an eighth, a quarter, three eighths of a turn of 180 degrees, then all of it
    assert told(workshop, "cycles", 39_990, 39_980, 39_970, 39_960, 39_950) == [
        39_997,  # + 10 - 20 * 0.146 = + 7.07
        39_980,  # half way: no correction
        39_963,  # - 7.07
        39_950,
        39_940,
    ]
    # and a reversal that is interrupted goes back the way it came
    assert told(workshop, "cycles", 39_960, 39_970, 39_960, 39_950) == [39_953, 39_970, 39_953, 39_940]


def test_a_setpoint_that_stands_still_is_no_cycle(workshop: Workshop) -> None:
    assert told(workshop, "cycles", 60_000, 61_000, 62_000, 63_000, 64_000)[-1] == 64_010
    assert told(workshop, "cycles", 63_990, 63_990, 63_990, 63_980) == [63_997, 63_997, 63_997, 63_980]


def test_step_takes_the_other_branch_at_once(workshop: Workshop) -> None:
    assert told(workshop, "jump", 10_000, 20_000, 40_000)[-1] == 40_010
    assert told(workshop, "jump", 39_990, 39_980) == [39_980, 39_970]


def test_lost_motion_is_taken_up_against_the_direction_of_homing(workshop: Workshop) -> None:
    assert told(workshop, "backlash", 10_000, 60_000, 70_000)[-1] == 70_050
    # forward: the table alone, + 50; backward 20 less, half of it after the first of two setpoints
    assert told(workshop, "backlash", 69_000, 68_000) == [69_040, 68_030]
