"""What readings lead to, as plain data and in sentences.

Results of ISO 230-2 and VDI/DGQ 3441, whether a limit is kept, and what a table leaves between its points.
"""

from typing import TYPE_CHECKING, Final

from gateway.compensation.units import Units
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation
from gateway.metrology.readings import Small, small_unit
from gateway.metrology.shapes import LeftOut
from gateway.metrology.standard_asks import missing_of
from gateway.metrology.uncertainty import Budget, Known, verdict
from gateway.metrology.vdi_3441 import vdi_3441

if TYPE_CHECKING:  # it brings numpy, which most of the program does without
    from gateway.metrology.fitting import Evidence

NOT_JUDGED: Final = "not known from these readings: too few targets, or more than tell anything"
NAMES: Final = (
    ("A", "accuracy"),
    ("R", "repeatability"),
    ("E", "systematic error"),
    ("M", "mean systematic error"),
    ("B", "reversal, largest"),
    ("Bm", "reversal, mean"),
)
"""Results of ISO 230-2, and what they are called."""


def values_of(found: Evaluation) -> dict[str, tuple[float | None, float | None, float | None]]:
    """Return forward, backward and both of each result."""
    return {
        "A": (found.accuracy_forward, found.accuracy_backward, found.accuracy),
        "R": (found.repeatability_forward, found.repeatability_backward, found.repeatability),
        "E": (found.systematic_forward, found.systematic_backward, found.systematic),
        "M": (None, None, found.mean_systematic),
        "B": (None, None, found.reversal),
        "Bm": (None, None, found.mean_reversal),
    }


def results_json(found: Evaluation) -> dict[str, object]:
    """Return the results as plain data, in the units of the readings; null where the readings carry none."""
    values = values_of(found)
    return {
        "units": found.units.value,
        "is_iso_230_2": not missing_of(found),
        "missing": list(missing_of(found)),
        "forward": {name: values[name][0] for name in ("A", "R", "E")},
        "backward": {name: values[name][1] for name in ("A", "R", "E")},
        "both": {name: values[name][2] for name, _ in NAMES},
        "targets": [
            {
                "target": each.target,
                "runs": [len(way.deviations) if way else 0 for way in (each.forward, each.backward)],
                "mean": [way.mean if way else None for way in (each.forward, each.backward)],
                "s": [way.s if way else None for way in (each.forward, each.backward)],
                "reversal": each.reversal,
            }
            for each in found.targets
        ],
    }


def left_out_json(units: Units, left_out: LeftOut | None, when: str = "") -> dict[str, object]:
    """Return E between the targets, predicted by leaving out, and its bounds.

    Null is what the readings do not tell, with the reason, and the lengths, in the units of the readings, of
    what repeats unseen.
    """
    small = small_unit(units)
    names = (f"left_out_e{when}", f"left_out_e_low{when}", f"left_out_e_high{when}")
    numbers: tuple[float | None, ...] = (None,) * len(names)
    if left_out is not None and not left_out.unsettled:
        numbers = (left_out.e, left_out.low, left_out.high)
    return {
        f"{name}_{small.key}": None if number is None else number * small.factor
        for name, number in zip(names, numbers, strict=True)
    } | {
        f"left_out_unknown{when}": (NOT_JUDGED if left_out is None else left_out.unknown) or None,
        f"left_out_unseen_periods{when}": [each.length for each in left_out.unseen] if left_out else [],
    }


def predicted_json(predicted: Evaluation, left_out: LeftOut | None) -> dict[str, object]:
    """Return E as predicted at the targets, and between them."""
    small = small_unit(predicted.units)
    at_targets = None if predicted.systematic is None else predicted.systematic * small.factor
    return {f"e_{small.key}": at_targets, **left_out_json(predicted.units, left_out)}


def evidence_json(evidence: "Evidence") -> dict[str, object]:
    """Return why a table follows what it follows, as plain data."""
    chosen = evidence.chosen
    small = small_unit(chosen.table.units)
    return {
        "follows": chosen.shape.value,
        "step": chosen.step,
        "points_where_the_nut_stood": chosen.at_nut,
        "candidates": [
            {
                "follows": each.shape.value,
                "points": len(each.table.positions),
                f"left_out_rms_{small.key}": each.misses * small.factor,
                f"left_out_e_{small.key}": each.left_out * small.factor if evidence.is_told else None,
            }
            for each in evidence.candidates
        ],
        "harmonics": [
            {
                "name": each.period.name,
                "period": each.period.length,
                f"amplitude_{small.key}": None if each.amplitude is None else each.amplitude * small.factor,
                "phase_deg": each.phase_deg,
                "p": each.significance,
            }
            for each in evidence.harmonics
        ],
        "warnings": list(evidence.warnings),
    }


def left_out_line(before: Evaluation, left_out: LeftOut) -> str:
    """Say what the table will leave where nobody measured."""
    small = small_unit(before.units)
    was = ""
    if before.systematic is not None:
        was = f"; at the targets it was {small.text(before.systematic)} before"
    return f"between its points the table will leave {left_out_text(small, left_out)}{was}"


def left_out_text(small: Small, left_out: LeftOut) -> str:
    """Say E between the targets with its bounds, and what is not in them."""
    if left_out.unsettled:
        return f"an E that is {left_out.unknown}"
    if left_out.e is None or left_out.high is None:
        return f"at least E = {small.text(left_out.low)}; how much it is, is {left_out.unknown}"
    return (
        f"E = {small.text(left_out.e)} (predicted by leaving out; {small.text(left_out.low)} to "
        f"{small.text(left_out.high)} in nine of ten cases)"
    )


def vdi_line(found: Evaluation) -> str:
    """Say the results of VDI/DGQ 3441 in one line."""
    results, small = vdi_3441(found), small_unit(found.units)
    if results is None:
        return "VDI/DGQ 3441: needs both directions and two runs at every target"
    return (
        f"VDI/DGQ 3441: P {small.text(results.positional_uncertainty)}, "
        f"Pa {small.text(results.positional_deviation)}, Ps {small.text(results.scatter)} "
        f"(mean {small.text(results.mean_scatter)}), U {small.text(results.reversal)} "
        f"(mean {small.text(results.mean_reversal)})"
    )


def vdi_json(found: Evaluation) -> dict[str, object] | None:
    """Return the same as plain data."""
    results, small = vdi_3441(found), small_unit(found.units)
    if results is None:
        return None
    numbers = {
        "p": results.positional_uncertainty,
        "pa": results.positional_deviation,
        "ps": results.scatter,
        "ps_mean": results.mean_scatter,
        "u": results.reversal,
        "u_mean": results.mean_reversal,
    }
    return {f"{name}_{small.key}": number * small.factor for name, number in numbers.items()}


def known_of(
    found: Evaluation, instrument_um: float, misalignment_mm: float, temperature: float, environment_um: float
) -> Known:
    """Return what was told, in the units of the readings.

    Raises:
        ReadingsError: a number below 0.
    """
    factor = small_unit(found.units).factor
    return Known(
        instrument=instrument_um / factor,
        misalignment=found.units.from_mm(misalignment_mm),
        temperature_range=temperature,
        environment=environment_um / factor,
    )


def limit_line(found: Evaluation, budget: Budget, limit_um: float) -> str:
    """Say whether A keeps a limit, with the budget.

    Raises:
        ReadingsError: the readings carry no A, or the limit is not above 0.
    """
    small = small_unit(found.units)
    parts = ", ".join(f"{name} {small.text(part)}" for name, part in budget.parts if part)
    accuracy = _accuracy(found, limit_um)
    said = verdict(accuracy, budget.expanded, limit_um / small.factor)
    return (
        f"A = {small.text(accuracy)} with U = {small.text(budget.expanded)} (k = 2; {parts}): the limit of "
        f"{limit_um:g} {small.name} is {said}"
    )


def limit_json(found: Evaluation, budget: Budget, limit_um: float) -> dict[str, object]:
    """Return the same as plain data. Raises ReadingsError: see :func:`limit_line`."""
    small = small_unit(found.units)
    accuracy = _accuracy(found, limit_um)
    return {
        f"limit_{small.key}": limit_um,
        f"a_{small.key}": accuracy * small.factor,
        f"u_{small.key}": budget.expanded * small.factor,
        "parts": {name: part * small.factor for name, part in budget.parts},
        "verdict": verdict(accuracy, budget.expanded, limit_um / small.factor),
    }


def _accuracy(found: Evaluation, limit_um: float) -> float:
    if not limit_um > 0.0:
        raise ReadingsError(f"--limit {limit_um:g}: it must be above 0")
    if found.accuracy is None:
        raise ReadingsError(
            "--limit: these readings carry no A of both directions: two runs and both approaches at every "
            "target"
        )
    return found.accuracy
