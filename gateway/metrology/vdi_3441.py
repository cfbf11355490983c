"""VDI/DGQ 3441: the same readings as P, Ps, Pa and U, still required by many acceptance sheets.

At each position, with the means of both directions and their standard deviations (n - 1)::

    x    = (mean forward + mean backward) / 2             s   = (s forward + s backward) / 2
    U_j  = |mean forward - mean backward|, reversal       Ps_j = 6 s, positional scatter
    Pa   = max x - min x, positional deviation
    P    = max (x + (U_j + Ps_j) / 2) - min (x - (U_j + Ps_j) / 2), positional uncertainty

``U`` and ``Ps`` are reported as the largest and as the mean over the positions. Source: the names of the
results are those of a maker's laser program (the interface of Keysight's E1733A); the formulas are the usual
ones in teaching. No public text with them was found, and the guideline itself was not available.
"""

from dataclasses import dataclass
from statistics import fmean

from gateway.metrology.evaluation import Evaluation
from gateway.metrology.readings import small_unit
from gateway.plain import JsonObject


@dataclass(frozen=True, slots=True)
class Vdi3441:
    """The results, in the units of the readings."""

    positional_uncertainty: float
    """P"""
    positional_deviation: float
    """Pa"""
    scatter: float
    """Ps, the largest"""
    mean_scatter: float
    reversal: float
    """U, the largest"""
    mean_reversal: float


def vdi_3441(found: Evaluation) -> Vdi3441 | None:
    """Return the results; None if a target lacks an approach or has only one run."""
    rows = []
    for each in found.targets:
        forward, backward = each.forward, each.backward
        if forward is None or backward is None or forward.s is None or backward.s is None:
            return None
        x, s = (forward.mean + backward.mean) / 2, (forward.s + backward.s) / 2
        rows.append((x, abs(forward.mean - backward.mean), 6 * s))
    return Vdi3441(
        positional_uncertainty=max(x + (u + ps) / 2 for x, u, ps in rows)
        - min(x - (u + ps) / 2 for x, u, ps in rows),
        positional_deviation=max(x for x, _, _ in rows) - min(x for x, _, _ in rows),
        scatter=max(ps for _, _, ps in rows),
        mean_scatter=fmean(ps for _, _, ps in rows),
        reversal=max(u for _, u, _ in rows),
        mean_reversal=fmean(u for _, u, _ in rows),
    )


def vdi_line(found: Evaluation) -> str:
    """Return the results of VDI/DGQ 3441 in one line."""
    results, small = vdi_3441(found), small_unit(found.units)
    if results is None:
        return "VDI/DGQ 3441: measure both directions and two runs at every target"
    return (
        f"VDI/DGQ 3441: P {small.text(results.positional_uncertainty)}, "
        f"Pa {small.text(results.positional_deviation)}, Ps {small.text(results.scatter)} "
        f"(mean {small.text(results.mean_scatter)}), U {small.text(results.reversal)} "
        f"(mean {small.text(results.mean_reversal)})"
    )


def vdi_json(found: Evaluation) -> JsonObject | None:
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
