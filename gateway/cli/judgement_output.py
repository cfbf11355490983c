"""Other standards beside ISO 230-2, and whether a limit is kept: for ``table evaluate``."""

from typing import Annotated

import typer

from gateway.metrology.deviation import small_unit
from gateway.metrology.errors import ReadingsError
from gateway.metrology.evaluation import Evaluation
from gateway.metrology.uncertainty import Budget, Known, verdict
from gateway.metrology.vdi_3441 import vdi_3441

VdiWanted = Annotated[bool, typer.Option("--vdi-3441", help="Show P, Ps, Pa and U after VDI/DGQ 3441 too.")]
Limit = Annotated[
    float | None,
    typer.Option("--limit", help="In µm (arcsec): say whether A keeps it, with the uncertainty."),
]
Instrument = Annotated[
    float, typer.Option("--u-instrument", help="Of the instrument over the length, k = 2, in µm (arcsec).")
]
Misalignment = Annotated[
    float, typer.Option("--u-alignment", help="How far beam or scale leave the axis over its length, in mm.")
]
Temperature = Annotated[
    float, typer.Option("--u-temperature", help="Range in which the temperature of the screw lies, in K.")
]
Environment = Annotated[
    float, typer.Option("--u-environment", help="What an hour of a drift test shows, in µm (arcsec).")
]


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
