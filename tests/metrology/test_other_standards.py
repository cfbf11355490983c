"""VDI/DGQ 3441 and the uncertainty of A, worked out by hand."""

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.uncertainty import Known, budget_of, verdict
from gateway.metrology.vdi_3441 import vdi_3441

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
DEVIATIONS_UM = {
    (0.0, UP): (1.0, 2.0, 3.0),
    (0.0, DOWN): (5.0, 6.0, 7.0),
    (1000.0, UP): (8.0, 10.0, 12.0),
    (1000.0, DOWN): (12.0, 14.0, 16.0),
}
"""Means 2, 6, 10 and 14; s 1, 1, 2 and 2."""


def found(runs: int = 3) -> Evaluation:
    readings = [
        Reading(target, way, target + um / 1000, run)
        for (target, way), values in DEVIATIONS_UM.items()
        for run, um in enumerate(values[:runs], start=1)
    ]
    return evaluate(Survey(tuple(readings), Units.MM))


def test_vdi_3441_by_hand() -> None:
    results = vdi_3441(found())
    assert results is not None
    # x is 4 and 12, U is 4 at both, Ps is 6 and 12.
    assert results.positional_deviation * 1000 == pytest.approx(8)
    assert results.reversal * 1000 == pytest.approx(4)
    assert results.mean_reversal * 1000 == pytest.approx(4)
    assert results.scatter * 1000 == pytest.approx(12)
    assert results.mean_scatter * 1000 == pytest.approx(9)
    # 12 + (4 + 12) / 2 = 20, 4 - (4 + 6) / 2 = -1.
    assert results.positional_uncertainty * 1000 == pytest.approx(21)


def test_vdi_3441_needs_scatter_and_both_directions() -> None:
    assert vdi_3441(found(runs=1)) is None


def test_the_budget_by_hand() -> None:
    known = Known(
        instrument=0.001,
        misalignment=2.0,
        temperature_range=1.0,
        off_20=5.0,
        expansion_range=1e-6,
        environment=0.002,
    )
    parts = dict(budget_of(found(), known).parts)
    assert parts["instrument"] * 1000 == pytest.approx(1.0)
    # 0.6 × 2² / 2000 mm = 1.2 µm.
    assert parts["alignment"] * 1000 == pytest.approx(1.2)
    # 0.6 × 11.5 µm/m K × 1 m × 1 K = 6.9 µm; 0.6 × 5 K × 1 m × 1 µm/m K = 3 µm; 0.6 × 2 µm.
    assert parts["temperature"] * 1000 == pytest.approx(6.9)
    assert parts["expansion"] * 1000 == pytest.approx(3.0)
    assert parts["environment"] * 1000 == pytest.approx(1.2)
    # 2 × 2 µm / sqrt(3).
    assert parts["repeatability"] * 1000 == pytest.approx(4 / 3**0.5)
    squares = 1.0 + 1.44 + 47.61 + 9.0 + 1.44 + 16 / 3
    assert budget_of(found(), known).expanded * 1000 == pytest.approx(squares**0.5)


def test_a_limit_is_kept_only_beyond_the_uncertainty() -> None:
    assert [verdict(10.0, 2.0, limit) for limit in (12.0, 11.9, 8.0, 7.9)] == [
        "kept",
        "undecided",
        "undecided",
        "not kept",
    ]


def test_what_cannot_be_known_is_refused() -> None:
    with pytest.raises(ReadingsError, match="temperature range -1"):
        Known(temperature_range=-1.0)
    with pytest.raises(ReadingsError, match="instrument nan"):
        Known(instrument=float("nan"))
