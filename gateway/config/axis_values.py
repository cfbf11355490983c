"""Settings of an axis that are a word, a number or a small table."""

from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any

from pydantic import BeforeValidator

from gateway.compensation.settings import Gain, Outside, OutsideKind, Reversal, ReversalKind
from gateway.config.values import LARGEST_LENGTH

GAIN_RULE = "allowed: a number from 0 to 1, or { forward = 0..1, backward = 0..1 }"
OUTSIDE_RULE = 'allowed: "hold", "zero", "refuse" or { fade = LENGTH } with a length above 0'
REVERSAL_RULE = (
    'allowed: "step", { distance = LENGTH }, { time_ms = MILLISECONDS } or { cycles = WHOLE NUMBER }, '
    "each above 0"
)


def _is_number(raw: object, low: float, high: float) -> bool:
    if isinstance(raw, bool) or not isinstance(raw, int | float):
        return False
    return low <= raw <= high and (isinstance(raw, int) or isfinite(raw))


def read_gain(raw: object) -> Gain:
    """Read one gain for both directions, or one for each.

    Raises:
        ValueError: what is allowed.

    >>> read_gain({"forward": 1, "backward": 0.5})
    Gain(forward=1.0, backward=0.5)
    """
    if isinstance(raw, Gain):
        return raw
    both: Mapping[str, Any] = raw if isinstance(raw, Mapping) else {"forward": raw, "backward": raw}
    if set(both) != {"forward", "backward"} or not all(_is_number(g, 0.0, 1.0) for g in both.values()):
        raise ValueError(GAIN_RULE)
    return Gain(float(both["forward"]), float(both["backward"]))


def read_outside(raw: object) -> Outside:
    """Read the policy for positions outside the table.

    Raises:
        ValueError: what is allowed.
    """
    if isinstance(raw, Outside):
        return raw
    if isinstance(raw, str) and raw in {"hold", "zero", "refuse"}:
        return Outside(OutsideKind(raw))
    if isinstance(raw, Mapping) and set(raw) == {"fade"} and _is_positive(raw["fade"]):
        return Outside(OutsideKind.FADE, float(raw["fade"]))
    raise ValueError(OUTSIDE_RULE)


def read_reversal(raw: object) -> Reversal:
    """Read what advances a blend between the branches.

    Raises:
        ValueError: what is allowed.
    """
    if isinstance(raw, Reversal):
        return raw
    if raw == "step":
        return Reversal(ReversalKind.STEP)
    if isinstance(raw, Mapping) and len(raw) == 1:
        [(kind, amount)] = raw.items()
        is_whole = kind != "cycles" or isinstance(amount, int)
        if kind in {"distance", "time_ms", "cycles"} and _is_positive(amount) and is_whole:
            return Reversal(ReversalKind(kind), float(amount))
    raise ValueError(REVERSAL_RULE)


def _is_positive(raw: object) -> bool:
    return _is_number(raw, 0.0, LARGEST_LENGTH) and raw != 0


GainValue = Annotated[Gain, BeforeValidator(read_gain)]
OutsideValue = Annotated[Outside, BeforeValidator(read_outside)]
ReversalValue = Annotated[Reversal, BeforeValidator(read_reversal)]
