"""Results of one axis: ISO 230-2 before and after, and one sentence about them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation, evaluate, missing_line
from gateway.metrology.readings import Survey
from gateway.report.axis_data import AxisData
from gateway.report.errors import ReportError
from gateway.report.words import NONE, Scale, clean, scale_of, shortest, truncated

SAME_STRETCH: Final = 0.8
"""Share of a measured length that must be measured again before two results are comparable."""
LEAST_LEFT: Final = 0.005
"""A value that is displayed as 0.00 is not used as a divisor."""
_NAME_CHARACTERS: Final = 24


@dataclass(frozen=True, slots=True)
class AxisResults:
    """One axis, evaluated. All lengths in the units of the axis; ``scale`` says how to display them."""

    axis_data: AxisData
    scale: Scale
    before: Evaluation | None
    after: Evaluation | None

    @property
    def axis(self) -> str:
        """Name of the axis, cleaned and shortened for a page."""
        return truncated(clean(self.axis_data.axis), _NAME_CHARACTERS)

    @property
    def named(self) -> str:
        """The axis inside a sentence; some files of readings do not name it."""
        return f"axis {self.axis}" if self.axis else "the axis"

    @property
    def subject(self) -> str:
        """The same at the beginning of a sentence."""
        return self.named[0].upper() + self.named[1:]

    @property
    def other_stretch(self) -> str:
        """Why the readings after do not compare with those before; empty if they do."""
        return other_stretch(self.before, self.after) if self.before and self.after else ""

    @property
    def before_word(self) -> str:
        """Word for the first readings: "before" only if there are others after them."""
        return "measured" if self.after is None else "before"

    @property
    def after_word(self) -> str:
        """Word for the readings after, so that a prediction is not taken for a measurement."""
        return "predicted" if self.axis_data.is_predicted else "measured"


class Figure(NamedTuple):
    """One number of the standard."""

    symbol: str
    name: str
    direction: str
    of: Callable[[Evaluation], float | None]


FIGURES: Final = (
    Figure("A", "accuracy", "both", lambda found: found.accuracy),
    Figure("A", "accuracy", "forward", lambda found: found.accuracy_forward),
    Figure("A", "accuracy", "backward", lambda found: found.accuracy_backward),
    Figure("R", "repeatability", "both", lambda found: found.repeatability),
    Figure("R", "repeatability", "forward", lambda found: found.repeatability_forward),
    Figure("R", "repeatability", "backward", lambda found: found.repeatability_backward),
    Figure("E", "systematic deviation", "both", lambda found: found.systematic),
    Figure("E", "systematic deviation", "forward", lambda found: found.systematic_forward),
    Figure("E", "systematic deviation", "backward", lambda found: found.systematic_backward),
    Figure("M", "mean systematic deviation", "both", lambda found: found.mean_systematic),
    Figure("B", "largest reversal", "both", lambda found: found.reversal),
    Figure("B̄", "mean reversal", "both", lambda found: found.mean_reversal),
)

_HEADLINES: Final = (
    (FIGURES[0], "accurate to"),
    (FIGURES[1], "accurate in forward direction to"),
    (FIGURES[2], "accurate in backward direction to"),
    (FIGURES[6], "on average within a band of"),
    (FIGURES[7], "in forward direction on average within a band of"),
    (FIGURES[8], "in backward direction on average within a band of"),
)
"""Subjects of the sentence: the first that all readings have is used."""


def find(axis_data: AxisData) -> AxisResults:
    """Evaluate the readings of one axis.

    Raises:
        ReportError: there are no data, units are mixed, or readings cannot be evaluated.
    """
    if axis_data.table is None and axis_data.before is None and axis_data.after is None:
        raise ReportError(
            f"axis {axis_data.axis or NONE}: give a table or readings: without them there is nothing to show"
        )
    parts = (
        ("table", axis_data.table),
        ("readings before", axis_data.before),
        ("readings after", axis_data.after),
    )
    for name, part in parts:
        if part is not None and part.units is not axis_data.units:
            raise ReportError(
                f"axis {axis_data.axis or NONE}: convert its {name} first: they are in {part.units.value}, "
                f"but the axis is in {axis_data.units.value}"
            )
    before, after = (_evaluated(axis_data.axis, survey) for survey in (axis_data.before, axis_data.after))
    return AxisResults(axis_data, scale_of(axis_data.units), before, after)


def _evaluated(axis: str, survey: Survey | None) -> Evaluation | None:
    if survey is None:
        return None
    try:
        return evaluate(survey)
    except ReadingsError as error:
        raise ReportError(f"axis {axis or NONE}: {error}") from error


def sentence(found: AxisResults) -> str:
    """Return the result in one sentence for a customer."""
    before, after, show = found.before, found.after, found.scale.rounded
    stages = [each for each in (before, after) if each is not None]
    for figure, words in _HEADLINES:
        numbers = [number for each in stages if (number := figure.of(each)) is not None]
        if not stages or len(numbers) < len(stages):
            continue
        if before is not None and after is not None:
            if left := _left_between(found):
                return _predicted(found, words, left, numbers[0], numbers[1])
            return _change(found, words, numbers[0], numbers[1])
        if before is not None:
            return f"{found.subject} is {words} {show(numbers[0])}, as measured."
        where = " at the targets" if found.axis_data.is_predicted else ""
        now = f"{_is(found)}{words} {show(numbers[0])}{where}"
        return f"{found.subject} is {now}, with the correction active."
    return _about_table(found)


def _left_between(found: AxisResults) -> str:
    """Return what a table will leave between the measured targets; empty if unknown."""
    left_out = found.axis_data.left_out
    if left_out is None or not found.axis_data.is_predicted:
        return ""
    show = found.scale.rounded
    if left_out.unsettled:
        return f"the error between the targets is {left_out.unknown}"
    if left_out.e is None or left_out.high is None:
        return (
            f"it leaves a systematic deviation E of at least {show(left_out.low)} between the targets; its "
            f"full size is {left_out.unknown}"
        )
    return (
        f"it is predicted to leave a systematic deviation E of {show(left_out.e)} between the targets, in "
        f"nine of ten cases between {show(left_out.low)} and {show(left_out.high)}"
    )


def _predicted(found: AxisResults, words: str, left: str, before: float, after: float) -> str:
    """Return the sentence for a prediction.

    First what remains between the targets: at them, a table made from them leaves almost nothing.
    """
    show = found.scale.rounded
    return (
        f"{found.subject} was {words} {show(before)}. With the table {left}. At the targets "
        f"themselves it is predicted to be {words} {show(after)}."
    )


def _is(found: AxisResults) -> str:
    return "predicted to be " if found.axis_data.is_predicted else ""


def _change(found: AxisResults, words: str, before: float, after: float) -> str:
    """Return the value before and after; the ratio only of two measurements over the same range."""
    show = found.scale.rounded
    now = "is predicted to be" if found.axis_data.is_predicted else "is now"
    first = f"{found.subject} was {words} {show(before)} and {now} {words} {show(after)}"
    if found.axis_data.is_predicted:
        first += " at the targets"
    if found.other_stretch:
        return f"{first}, but {found.other_stretch}."
    if after >= before:
        return f"{first}: it is not better."
    if found.axis_data.is_predicted or found.scale.of(after) < LEAST_LEFT or before / after < 1.05:
        return f"{first}."
    ratio = before / after
    return f"{first}: {ratio:.0f} times better." if ratio >= 9.5 else f"{first}: {ratio:.1f} times better."


def other_stretch(before: Evaluation, after: Evaluation) -> str:
    """Return a remark that two sets of readings cover different ranges; empty if they do not.

    A measurement over a part of the axis looks better than the axis is. Targets at slightly other positions,
    such as random ones, do not make another range.
    """
    (low, high), (low_now, high_now) = (
        (each.targets[0].target, each.targets[-1].target) for each in (before, after)
    )
    if min(high, high_now) - max(low, low_now) >= SAME_STRETCH * max(high - low, high_now - low_now):
        return ""
    was, now = (f"{shortest(one)} to {shortest(two)}" for one, two in ((low, high), (low_now, high_now)))
    unit = scale_of(before.units).position
    return f"over {now} {unit} instead of {was} {unit}, so they cannot be compared"


def _about_table(found: AxisResults) -> str:
    table, show = found.axis_data.table, found.scale.rounded
    if table is None:
        return f"{found.subject} was not measured often enough for a result."
    first = f"The table of {found.named} changes a position by up to {show(table.max_correction())}"
    if table.is_unidirectional:
        return f"{first}, the same in both directions."
    return f"{first}; the two directions differ by up to {show(table.max_reversal())}."


def runs_of(evaluation: Evaluation) -> tuple[int, int]:
    """Return the smallest and the largest number of readings at a target in a direction."""
    counts = [
        len(approach.deviations)
        for target in evaluation.targets
        for approach in (target.forward, target.backward)
        if approach is not None
    ]
    return min(counts), max(counts)


def about_readings(evaluation: Evaluation) -> str:
    """Return the number of readings, and whether it meets the standard."""
    missing = missing_line(evaluation)
    return f"{count_of_readings(evaluation)}; {missing}" if missing else count_of_readings(evaluation)


def count_of_readings(evaluation: Evaluation) -> str:
    """Return the number of readings in words."""
    fewest, most = runs_of(evaluation)
    runs = f"{fewest}" if fewest == most else f"{fewest} to {most}"
    targets = evaluation.targets
    one_sided = any(target.forward is None or target.backward is None for target in targets)
    ways = {
        way: any(approach is not None for approach in approaches)
        for way, approaches in (
            ("forward", [target.forward for target in targets]),
            ("backward", [target.backward for target in targets]),
        )
    }
    only = [way for way, is_there in ways.items() if is_there]
    where = "in each direction" if len(only) > 1 else f"{only[0]} only"
    words = f"{len(targets)} targets, {runs} run{'s' if most > 1 else ''} {where}"
    if one_sided and len(only) > 1:
        words += "; some targets were approached from one side only"
    return words
