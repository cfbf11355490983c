"""Recipes, the lead-in of a walk, and what a walk makes."""

from pathlib import Path

import pytest

from gateway.commissioning.measure.axis_link import DriveRecipe, recipe_of
from gateway.commissioning.measure.checks import Compensation, axis_of, controller_of
from gateway.commissioning.measure.errors import AxisError, InstrumentError, UndrivableError
from gateway.commissioning.measure.instruments import Lines
from gateway.commissioning.measure.measuring import instrument_of, plan_of
from gateway.commissioning.measure.options import Grid, InstrumentOptions, Pace
from gateway.commissioning.measure.session import AxisRoute, StartConditions, endpoint_of, preview
from gateway.compensation.units import Units
from gateway.config.load import load
from gateway.drives.library import names
from gateway.drives.motion import Action
from gateway.exchange.plan import AxisPlan
from gateway.metrology.cycle import bidirectional_cycle
from gateway.metrology.gauge_kinds import GaugeKind
from gateway.metrology.lead import lead_warnings, periods_of
from gateway.simulator.ledger import MoveKind
from tests.measure.site import REGISTERS, Gauge, Machine, gateway, measuring, written_alone
from tests.support.config import Keys, axis, registers, section

OTHER: Keys = {"line": "main", "unit_id": 2}
# What starts a move, and what stops one: register and value, as the profiles have them from the manuals.
DRIVEN = {
    "applied-motion-16": ("register 0x007c = 0x67", "register 0x007c = 0xd8"),
    "applied-motion-32": ("register 0x007c = 0x67", "register 0x007c = 0xd8"),
    "delta-asda": ("register 0x050e = 0x1", "register 0x050e = 0x3e8"),
    "festo-cmmt-111": ("register 0x0000 = 0x40", "None"),
    "iai-robo-cylinder": ("None", "None"),
    "kinco-fd": ("register 0x3100 = 0x10", "None"),
    "leadshine-el7": ("register 0x6002 = 0x10", "register 0x6002 = 0x40"),
    "leadshine-pr": ("register 0x6002 = 0x10", "register 0x6002 = 0x40"),
    "oriental-az": ("register 0x0067 = 0x1", "register 0x007d = 0x20"),
    "oriental-blv-r": ("register 0x0067 = 0x1", "None"),
    "smc-lec": ("register 0x9100 = 0x100", "None"),
    "stepperonline-ess-rs": ("register 0x0027 = 0x5", "register 0x0027 = 0x100"),
    "tl-r": ("register 0x004e = 0x3", "register 0x004e = 0x20"),
}
REFUSED = {
    "festo-cmmo-fhpp": "the frame of its target also contains the mode",
    "igus-dryve-d1": "CANopen objects",
    "jmc-rc": "writing its mode starts an action",
    "kollmorgen-akd2g": "no trigger register has a value that starts it",
    "makerbase-servo42d": "part of a longer command",
    "mitsubishi-mr-je-c": "CANopen objects",
}


def _recipe(tmp_path: Path, axis: str) -> DriveRecipe:
    return recipe_of(load(written_alone(tmp_path, axis)).plan.lines[0].axes[0])


def _axis(drive: str) -> str:
    return f'referenced = "absolute"\ncompensation = "off"\ndrive = "{drive}"\n'


def test_every_drive_that_comes_along_is_either_driven_or_refused() -> None:
    assert sorted({**DRIVEN, **REFUSED}) == sorted(names())


@pytest.mark.parametrize("drive", DRIVEN)
def test_a_drive_is_started_and_stopped_by_the_values_of_its_map(tmp_path: Path, drive: str) -> None:
    recipe = _recipe(tmp_path, _axis(drive))
    assert (str(recipe.start), str(recipe.stop)) == DRIVEN[drive]


@pytest.mark.parametrize("drive", REFUSED)
def test_a_drive_that_needs_more_than_its_map_says_is_refused(tmp_path: Path, drive: str) -> None:
    with pytest.raises(UndrivableError, match=REFUSED[drive]):
        _recipe(tmp_path, _axis(drive))


def test_a_plain_axis_moves_when_its_target_is_written(tmp_path: Path) -> None:
    recipe = _recipe(tmp_path, REGISTERS)
    assert (recipe.start, recipe.stop, recipe.mode) == (None, None, None)


def test_an_axis_that_follows_a_stream_would_jump_and_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UndrivableError, match="stream of setpoints"):
        _recipe(tmp_path, 'setpoints = "stream"\ncompensation = "off"' + REGISTERS)


def test_an_axis_of_a_group_is_not_moved_alone(tmp_path: Path) -> None:
    other = axis(
        "x2", registers(command=0x0100, actual=0x0200), **OTHER, travel=[-5.0, 105.0], compensation="off"
    )
    group = section("[group.gantry]", {"axes": ["x", "x2"]})
    path = written_alone(tmp_path, f'compensation = "off"\n{REGISTERS}{other}{group}')
    with pytest.raises(AxisError, match="belongs to a group with x2"):
        axis_of(load(path).plan.lines, "x")


def test_a_word_that_would_do_something_else_too_is_not_written(tmp_path: Path) -> None:
    """Kinco: bit 4 of 0x3100 starts; without the four enabling bits the same word stops."""
    recipe = _recipe(tmp_path, _axis("kinco-fd"))
    start = recipe.start
    assert start is not None
    assert (start.word(0x000F), start.rested(0x001F)) == (0x001F, 0x000F)
    recipe.check_words(0x3100, 0x001F, 0x000F, (Action.START,))
    with pytest.raises(UndrivableError, match="would also stop"):
        recipe.check_words(0x3100, 0x0016, 0x0006, (Action.START,))
    with pytest.raises(UndrivableError, match="would also start"):
        recipe.check_words(0x3100, 0x001F, 0x000F, ())


TERMS = """
table = "x.csv"
thermal = { alpha = 11.5e-6, reference = 22.0, source = { modbus = "127.0.0.1:5022", address = 0 } }
cross = [{ axis = "y", table = "x.csv" }]
"""


@pytest.mark.parametrize(
    ("compensation", "told"),
    [
        (Compensation("off"), ["will be valid at 22 °C", "move it to where x.csv is 0"]),
        (Compensation("active", "ab"), ["as for a screw at its reference", "without the effect of y"]),
    ],
)
def test_it_is_said_what_is_added_beside_the_table(
    tmp_path: Path, compensation: Compensation, told: list[str]
) -> None:
    """What thermal and cross take care of would count twice if it were measured into the table too."""
    (tmp_path / "x.csv").write_text("position_mm,correction_mm\n-5,0\n105,0.01\n")
    other = axis("y", registers(command=0x0100), **OTHER, compensation="on")
    path = written_alone(tmp_path, TERMS + REGISTERS + other)
    line, plan = axis_of(load(path).plan.lines, "x")
    link = controller_of(line, None)
    route = AxisRoute(line, recipe_of(plan), link, endpoint_of(link, None))
    stops = list(bidirectional_cycle([0.0, 10.0], 1.0))
    said = list(preview(route, StartConditions(compensation, 0.0, None), stops, "gauge", Pace(2.0, None)))
    (thermal,) = [text for text in said if text.startswith("  thermal")]
    (cross,) = [text for text in said if text.startswith("  cross")]
    assert told[0] in thermal
    assert told[1] in cross


# The lead of the screw, as key and option: targets over it, and a warning of those that do not show it.


def loaded(tmp_path: Path, more: str = "") -> tuple[AxisPlan, float | None]:
    found = load(written_alone(tmp_path, f"{more}{REGISTERS}"))
    plan = found.plan.lines[0].axes[0]
    return plan, found.sections.axes[plan.name].lead


def test_the_lead_is_a_key_of_the_axis(tmp_path: Path) -> None:
    assert loaded(tmp_path, "lead = 5.0\n")[1] == 5.0
    assert loaded(tmp_path)[1] is None


def test_random_targets_are_spread_over_the_lead(tmp_path: Path) -> None:
    axis, _ = loaded(tmp_path)
    targets = plan_of(Grid(0.0, 300.0, targets=13, lead=5.0), axis).targets
    # P_i = (i - 1) p + r with p = (300 - 5) / 12 and r from 0 to 5.
    offsets = [target - index * 295 / 12 for index, target in enumerate(targets)]
    assert min(offsets) >= 0.0
    assert 3.0 < max(offsets) <= 5.0
    assert plan_of(Grid(0.0, 300.0, targets=13, spread=5.0), axis).targets == targets


def test_a_lead_that_leaves_no_room_is_no_spread(tmp_path: Path) -> None:
    axis, _ = loaded(tmp_path)
    with_lead = plan_of(Grid(0.0, 100.0, targets=21, lead=5.0), axis).targets
    assert with_lead == plan_of(Grid(0.0, 100.0, targets=21), axis).targets


def test_the_first_recipe_of_the_page_shows_a_lead_of_5_and_its_old_one_did_not(tmp_path: Path) -> None:
    axis, _ = loaded(tmp_path)
    new = plan_of(Grid(0.0, 300.0, targets=26, lead=5.0), axis).targets
    assert lead_warnings(new, periods_of(5.0), Units.MM) == []
    old = plan_of(Grid(0.0, 300.0, step=25.0), axis).targets
    for lead in (5.0, 12.5, 25.0):
        (warning,) = lead_warnings(old, periods_of(lead), Units.MM)
        assert "(aliasing)" in warning


def test_a_pattern_belongs_to_its_kind_of_gauge() -> None:
    for reader in (
        InstrumentOptions(gauge="/dev/x", kind=GaugeKind.PATTERN),
        InstrumentOptions(gauge="/dev/x", pattern="(?P<value>.)"),
    ):
        with pytest.raises(InstrumentError, match="together, or neither"):
            instrument_of(reader, Lines())
    with pytest.raises(InstrumentError, match="a group with the name value"):
        instrument_of(InstrumentOptions(gauge="/dev/x", kind=GaugeKind.PATTERN, pattern="x"), Lines())


# Drives that wait for a trigger, as their manuals have them: each target is run once, in order.


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
