"""VDI/DGQ 3441 and the uncertainty of A, worked out by hand."""

import numpy as np
import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate
from gateway.metrology.formats import ReadingsContext, Runs, parse_survey
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.uncertainty import UncertaintyInputs, budget_of, verdict
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
    inputs = UncertaintyInputs(
        instrument=0.001,
        misalignment=2.0,
        temperature_range=1.0,
        off_20=5.0,
        expansion_range=1e-6,
        environment=0.002,
    )
    parts = dict(budget_of(found(), inputs).parts)
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
    assert budget_of(found(), inputs).expanded * 1000 == pytest.approx(squares**0.5)


def test_a_limit_is_kept_only_beyond_the_uncertainty() -> None:
    assert [verdict(10.0, 2.0, limit) for limit in (12.0, 11.9, 8.0, 7.9)] == [
        "kept",
        "undecided",
        "undecided",
        "not kept",
    ]


def test_what_cannot_be_known_is_refused() -> None:
    with pytest.raises(ReadingsError, match="temperature range -1"):
        UncertaintyInputs(temperature_range=-1.0)
    with pytest.raises(ReadingsError, match="instrument nan"):
        UncertaintyInputs(instrument=float("nan"))


DISPLACEMENT_ACCURACY = {
    # Means of two laser files in public, in 0.000001 inch, and what the laser's program prints below them as
    # "Displacement Accuracy" of ASME B5.54-1992.
    145: [
        *(-55, -47, -75, -52, 2, -34, -76, -38, -53, -15, -46, -53, 11, 38, 31),
        *(8, -15, 8, 15, 53, 8, 15, 15, 53, 38, 69, 31),
    ],
    1125: [33, -178, -145, -195, -29, -88, -408, -633, -542, -637, -210, -324, -229, -244, 488, 8, 23, 168],
}


@pytest.mark.parametrize("printed", DISPLACEMENT_ACCURACY)
def test_displacement_accuracy_of_b5_54_is_e_of_one_direction(printed: int) -> None:
    means = DISPLACEMENT_ACCURACY[printed]
    text = "API Linear Error Compensation Table\nPosition   \tUnidirectional Avg Error\n"
    text += "".join(f"{5.0 * at:.6f}\t{mean / 1e6:.6f}\n" for at, mean in enumerate(means))
    told = ReadingsContext(units=Units.INCH, runs=Runs.FORWARD)
    found = evaluate(parse_survey(text.encode(), "x.pos", told)).systematic_forward
    assert found is not None
    assert found * 1e6 == pytest.approx(printed)


def test_vdi_3441_against_sums_over_arrays() -> None:
    """The same results from other code: arrays instead of rows, over 40 random measurements."""
    random = np.random.default_rng(3441)
    for _ in range(40):
        targets, runs = int(random.integers(2, 30)), int(random.integers(2, 8))
        errors = random.normal(0.0, 0.01, (2, targets, runs)) + random.normal(0.0, 0.02, (2, targets, 1))
        readings = [
            Reading(float(10 * i), way, 10.0 * i + float(errors[w, i, j]), j + 1)
            for w, way in enumerate((UP, DOWN))
            for i in range(targets)
            for j in range(runs)
        ]
        results = vdi_3441(evaluate(Survey(tuple(readings), Units.MM)))
        assert results is not None
        middle, scatter = errors.mean(axis=(0, 2)), 6.0 * errors.std(axis=2, ddof=1).mean(axis=0)
        reversal = np.abs(np.diff(errors.mean(axis=2), axis=0))[0]
        half = (reversal + scatter) / 2.0
        assert results.positional_uncertainty == pytest.approx(np.ptp([*(middle + half), *(middle - half)]))
        assert results.positional_deviation == pytest.approx(np.ptp(middle))
        assert (results.scatter, results.mean_scatter) == pytest.approx((scatter.max(), scatter.mean()))
        assert (results.reversal, results.mean_reversal) == pytest.approx((reversal.max(), reversal.mean()))
