"""How each drive that comes with the gateway is driven, or why it is not; from its register map alone."""

from pathlib import Path

import pytest

from gateway.commissioning.measure.axis_link import DriveRecipe, recipe_of
from gateway.commissioning.measure.checks import Compensation, axis_of, controller_of
from gateway.commissioning.measure.errors import AxisError, UndrivableError
from gateway.commissioning.measure.options import Pace
from gateway.commissioning.measure.session import AxisRoute, StartConditions, endpoint_of, preview
from gateway.config.load import load
from gateway.drives.library import names
from gateway.drives.motion import Action
from gateway.metrology.cycle import bidirectional_cycle
from tests.measure.site import REGISTERS, written_alone
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
