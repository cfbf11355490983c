"""ISO 230-2 against published raw readings, and against small cases worked out by hand."""

from math import sqrt

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate
from gateway.metrology.readings import Reading, Survey
from tests.metrology.iso230_readings import REPORTS
from tests.metrology.iso230_results import PRINTED, RIGHT, named

UP, DOWN = Direction.FORWARD, Direction.BACKWARD
ORACLE = "bifrost slits 11358 axis 1 (2021-11-03)"


def survey(name: str) -> Survey:
    readings = [
        Reading(target, way, measured, run)
        for way, column in ((UP, "forward"), (DOWN, "backward"))
        for target, runs in REPORTS[name][column].items()
        for run, measured in enumerate(runs, start=1)
    ]
    return Survey(tuple(readings), Units.MM)


def results(found: Evaluation) -> dict[str, float | None]:
    return {
        "B": found.reversal,
        "Bm": found.mean_reversal,
        "Rf": found.repeatability_forward,
        "Rb": found.repeatability_backward,
        "R": found.repeatability,
        "Ef": found.systematic_forward,
        "Eb": found.systematic_backward,
        "E": found.systematic,
        "M": found.mean_systematic,
        "Af": found.accuracy_forward,
        "Ab": found.accuracy_backward,
        "A": found.accuracy,
    }


def test_the_published_raw_readings_give_the_right_results_to_the_last_digit() -> None:
    found = {name: round(value or 0.0, 5) for name, value in results(evaluate(survey(ORACLE))).items()}
    assert found == named(
        *(0.00456, 0.00070, 0.00750, 0.00388, 0.00835, 0.01505),
        *(0.01485, 0.01599, 0.01495, 0.01807, 0.01654, 0.01857),
    )


@pytest.mark.parametrize("name", REPORTS)
def test_every_published_report_is_recomputed(name: str) -> None:
    assert results(evaluate(survey(name))) == pytest.approx(RIGHT[name], abs=6e-9)


@pytest.mark.parametrize("name", PRINTED)
def test_what_a_report_prints_too_small_can_be_seen_in_it(name: str) -> None:
    """R below its own worst target, and E below E of one direction: the right ones never are."""
    right, printed = RIGHT[name], PRINTED[name]
    assert right["R"] >= max(right["Rf"], right["Rb"]) >= 0
    assert right["E"] >= max(right["Ef"], right["Eb"])
    assert right["A"] >= max(right["Af"], right["Ab"], right["E"])
    assert printed["E"] < right["E"]


def test_two_targets_and_two_runs_by_hand() -> None:
    # Deviations in µm. At 0: forward 0 and 2 (mean 1, s = sqrt 2), backward 4 and 4 (mean 4, s = 0).
    # At 10: forward -3 and -5 (mean -4, s = sqrt 2), backward 1 and 3 (mean 2, s = sqrt 2).
    um = 1e-3
    found = evaluate(
        Survey(
            (
                *(Reading(0, UP, x * um, run) for run, x in enumerate((0, 2), 1)),
                *(Reading(0, DOWN, x * um, run) for run, x in enumerate((4, 4), 1)),
                *(Reading(10, UP, 10 + x * um, run) for run, x in enumerate((-3, -5), 1)),
                *(Reading(10, DOWN, 10 + x * um, run) for run, x in enumerate((1, 3), 1)),
            ),
            Units.MM,
        )
    )
    s = sqrt(2)
    right = {
        "B": 6,  # |1 - 4| = 3, |-4 - 2| = 6
        "Bm": -4.5,
        "Rf": 4 * s,
        "Rb": 4 * s,
        "R": 2 * s + 2 * s + 6,
        "Ef": 5,  # 1 - -4
        "Eb": 2,  # 4 - 2
        "E": 8,  # 4 - -4
        "M": 3.5,  # means 2.5 and -1
        "Af": (1 + 2 * s) - (-4 - 2 * s),
        "Ab": (2 + 2 * s) - (2 - 2 * s),  # 4 without scatter lies below 2 + 2s
        "A": (2 + 2 * s) - (-4 - 2 * s),
    }
    assert results(found) == pytest.approx({name: value * um for name, value in right.items()}, abs=1e-12)


def test_one_run_has_no_scatter_and_one_direction_no_reversal() -> None:
    found = evaluate(Survey((Reading(0, UP, 0.001), Reading(10, UP, 10.004)), Units.MM))
    given = {name for name, value in results(found).items() if value is not None}
    assert given == {"Ef"}
    assert found.systematic_forward == pytest.approx(0.003)


def test_a_target_that_lacks_one_way_takes_the_results_that_need_both() -> None:
    readings = [Reading(x, UP, x + e, run) for x in (0.0, 10.0) for run, e in ((1, 0.0), (2, 0.002))]
    readings += [Reading(0.0, DOWN, e, run) for run, e in ((1, 0.004), (2, 0.004))]
    found = evaluate(Survey(tuple(readings), Units.MM))
    assert found.repeatability is None
    assert found.reversal == pytest.approx(0.003)  # known at 0 only: mean 1 µm forward, 4 µm backward
    assert found.repeatability_forward == pytest.approx(4e-3 * sqrt(2))


def test_readings_that_are_none_are_refused() -> None:
    with pytest.raises(ReadingsError, match="no readings"):
        evaluate(Survey((), Units.MM))
    with pytest.raises(ReadingsError, match="measured nan"):
        evaluate(Survey((Reading(0, UP, float("nan")),), Units.MM))
