"""The sentence for the customer, and what keeps an axis from being told."""

from dataclasses import replace

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.metrology.lead import Period
from gateway.metrology.readings import Reading, Survey
from gateway.metrology.residue import LeftOut
from gateway.report.errors import ReportError
from gateway.report.findings import FIGURES, about_readings, find, sentence
from gateway.report.html import results_table
from tests.report.stories import axis_data, survey


def said(**changes: object) -> str:
    return sentence(find(axis_data(**changes))).replace("\N{NO-BREAK SPACE}", " ")


def test_a_customer_reads_what_it_was_and_what_it_is() -> None:
    # A = (12 + 4 sqrt 2) - -4 = 21.657 µm, and a tenth of it.
    assert said() == "Axis x was accurate to 21.7 µm and is now accurate to 2.2 µm: 10 times better."


def test_a_prediction_is_called_one() -> None:
    # Without a ratio: the readings that a table was made of vanish in its prediction.
    words = "Axis x was accurate to 21.7 µm and is predicted to be accurate to 2.2 µm at the targets."
    assert said(is_predicted=True) == words


def test_what_is_left_between_the_targets_comes_before_the_nothing_at_them() -> None:
    """A table that is made of the readings leaves 0 at their targets, which says nothing of the axis."""
    known = said(after=survey(1e-13), is_predicted=True, left_out=LeftOut(0.00087, 0.0004, 0.0021))
    assert known == (
        "Axis x was accurate to 21.7 µm. With the table it is predicted to leave a systematic deviation E of "
        "0.87 µm between the targets, in nine of ten cases between 0.40 µm and 2.1 µm. At the targets "
        "themselves it is predicted to be accurate to 0.00 µm."
    )
    unseen = LeftOut(None, 0.00087, None, (Period(5.0, "lead 5"),))
    at_least = said(after=survey(1e-13), is_predicted=True, left_out=unseen)
    assert "With the table it leaves a systematic deviation E of at least 0.87 µm between" in at_least
    assert at_least.index("0.87 µm") < at_least.index("0.00 µm")


@pytest.mark.parametrize("is_predicted", [True, False])
def test_nothing_left_is_not_so_many_times_better(is_predicted: bool) -> None:
    now = "is predicted to be" if is_predicted else "is now"
    where = " at the targets" if is_predicted else ""
    words = f"Axis x was accurate to 21.7 µm and {now} accurate to 0.00 µm{where}."
    assert said(after=survey(1e-13), is_predicted=is_predicted) == words


def test_a_part_of_the_axis_does_not_compare_with_the_whole() -> None:
    half = [replace(each, target=each.target / 2, measured=each.measured / 2) for each in survey().readings]
    found = find(axis_data(after=Survey(tuple(half), Units.MM)))
    words = "accurate to 10.8 µm, but over 0 to 50 mm instead of 0 to 100 mm, so they cannot be compared."
    assert sentence(found).replace("\N{NO-BREAK SPACE}", " ").endswith(words)
    assert results_table(found).count("<td>–</td>") == len(FIGURES)
    moved = [
        replace(each, target=each.target + 10, measured=each.measured + 10) for each in survey().readings
    ]
    assert find(axis_data(after=Survey(tuple(moved), Units.MM))).other_stretch == ""


def test_an_axis_without_a_name_has_none() -> None:
    assert said(axis="").startswith("The axis was accurate to 21.7 µm")
    assert said(axis="", before=None, after=None).startswith("The table of the axis changes")


def test_an_axis_that_became_worse_is_told_so() -> None:
    words = "Axis x was accurate to 2.2 µm and is now accurate to 21.7 µm: it is not better."
    assert said(before=survey(0.1), after=survey()) == words


def test_readings_of_one_run_have_no_accuracy_so_the_means_are_told() -> None:
    # E of the first runs: 10 - -4 = 14 µm
    words = "Axis x is on average within a band of 14.0 µm, as measured."
    assert said(before=survey(runs=1), after=None) == words


def test_before_and_after_are_told_in_the_same_number() -> None:
    # before: the means of both runs, 12 - -4 = 16 µm; after: a tenth of the first runs
    words = "Axis x was on average within a band of 16.0 µm and is now on average within a band of 1.4 µm"
    assert said(after=survey(0.1, runs=1)).startswith(words)


def test_inches_are_told_in_micrometres() -> None:
    inches = survey(units=Units.INCH)
    words = "Axis z is accurate to 21.7 µm, as measured."
    assert said(axis="z", units=Units.INCH, table=None, before=inches, after=None) == words


def test_a_table_alone_tells_what_it_changes() -> None:
    words = "The table of axis x changes a position by up to 20.0 µm; the two directions differ by up to"
    assert said(before=None, after=None) == f"{words} 20.0 µm."
    one = make_table([0, 90], [0.0, 0.001], [0.0, 0.001], Units.DEGREE)
    words = "The table of axis x changes a position by up to 3.6 arcsec, the same in both directions."
    assert said(table=one, units=Units.DEGREE, before=None, after=None) == words


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"table": None, "before": None, "after": None}, "axis x: give a table or readings"),
        (
            {"after": survey(units=Units.INCH)},
            "convert its readings after first: they are in inch, but the axis is in mm",
        ),
        ({"before": Survey((), Units.MM)}, "axis x: no readings"),
        (
            {"before": Survey((Reading(0.0, Direction.FORWARD, float("nan")),), Units.MM)},
            "axis x: reading 1: target 0.0, measured nan",
        ),
    ],
)
def test_what_cannot_be_told_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ReportError, match=words):
        find(axis_data(**changes))


def test_fewer_runs_than_the_standard_asks_for_are_named() -> None:
    found = find(axis_data())
    assert found.before is not None
    words = (
        "2 targets, 2 runs in each direction; not a test after ISO 230-2: 2 targets, 5 are required on "
        "this length; 2 runs in each direction, 5 are required"
    )
    assert about_readings(found.before) == words
    one_sided = tuple(each for each in survey().readings if each.direction is Direction.FORWARD)
    found = find(axis_data(before=Survey(one_sided * 3, Units.MM)))
    assert found.before is not None
    assert about_readings(found.before) == (
        "2 targets, 6 runs forward only; not a test after ISO 230-2: 2 targets, 5 are required on this "
        "length; one direction only, both are required"
    )
    gap = tuple(each for each in survey().readings if (each.target, each.run) != (0.0, 1))
    gap = tuple(each for each in gap if each.direction is Direction.FORWARD or each.target != 0.0)
    found = find(axis_data(before=Survey(gap, Units.MM)))
    assert found.before is not None
    words = "2 targets, 1 to 2 runs in each direction; some targets were approached from one side only"
    assert about_readings(found.before).startswith(words)
