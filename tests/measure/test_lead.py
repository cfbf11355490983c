"""The lead of the screw, as key and option: targets over it, and a warning of those that do not show it."""

from pathlib import Path

import pytest

from gateway.commissioning.measure.errors import InstrumentError
from gateway.commissioning.measure.instruments import Lines
from gateway.commissioning.measure.measuring import instrument_of, plan_of
from gateway.commissioning.measure.options import Grid, InstrumentOptions
from gateway.compensation.units import Units
from gateway.config.load import load
from gateway.exchange.plan import AxisPlan
from gateway.metrology.gauge_kinds import GaugeKind
from gateway.metrology.lead import lead_warnings, periods_of
from tests.measure.site import REGISTERS, written_alone


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
