"""The effect of a table at one position, and its reasons."""

from enum import Enum

from msgspec import Struct

from gateway.options import OptionError
from gateway.plain import JsonObject
from gateway.tabfile.decoded import BRANCHES, LoadedTable, SourceRow
from gateway.tabfile.options import MAX_POSITION


class TableSide(Enum):
    """The side of the table on which a position lies."""

    BELOW = "below"
    ABOVE = "above"


class DirectionExplained(Struct, frozen=True):
    """One direction of travel at one position; lengths in the units of the table.

    ``file_value`` is interpolated between the two points, in the unit of the file. ``counts`` is the command
    for a drive at ``counts_per_unit`` (zero at machine 0, no offsets), ``nominal_counts`` the same without
    correction.
    """

    low: SourceRow
    high: SourceRow
    file_value: float
    correction: float
    corrected: float
    rule: str
    nominal_counts: int | None
    counts: int | None


class PositionExplanation(Struct, frozen=True):
    """Both directions; ``outside`` is None on the table. Outside, the corrections are those of ``hold``."""

    loaded: LoadedTable
    at: float
    outside: TableSide | None
    forward: DirectionExplained
    backward: DirectionExplained

    def as_data(self) -> JsonObject:
        """Return it as plain data; corrections in ``units``."""
        loaded = self.loaded
        return {
            "file": loaded.file,
            "format": loaded.format,
            "sha256": loaded.sha256,
            "at": self.at,
            "units": loaded.table.units.value,
            "outside": self.outside.value if self.outside else None,
            "policy": "hold" if self.outside else None,
            "file_unit": loaded.source.value_unit,
            "forward": _direction_data(self.forward, is_forward=True),
            "backward": _direction_data(self.backward, is_forward=False),
            "decisions": list(loaded.source.decisions),
            "behaves_as": list(loaded.source.behaves_as),
            "lints": [lint.as_data() for lint in loaded.lints],
        }


def explain(loaded: LoadedTable, at: float, counts_per_unit: float | None = None) -> PositionExplanation:
    """Explain a machine position ``at``, in the units of the table; ``counts_per_unit`` is the drive's.

    Raises:
        OptionError: ``at`` is no machine position.
    """
    if not abs(at) < MAX_POSITION:
        raise OptionError("at", f"found {at}; allowed: a machine position")
    table = loaded.table
    rows = loaded.source.rows
    if at < table.first:
        outside, low, high = TableSide.BELOW, rows[0], rows[0]
    elif at > table.last:
        outside, low, high = TableSide.ABOVE, rows[-1], rows[-1]
    else:
        index = table.segment(at)
        outside, low, high = None, rows[index], rows[index + 1]
    forward, backward = (_direction(loaded, branch, (low, high), at, counts_per_unit) for branch in BRANCHES)
    return PositionExplanation(loaded, at, outside, forward, backward)


def _direction(
    loaded: LoadedTable, branch: str, segment: tuple[SourceRow, SourceRow], at: float, scale: float | None
) -> DirectionExplained:
    low, high = segment
    is_forward = branch == "forward"
    share = (at - low.position) / (high.position - low.position) if high is not low else 0.0
    correction = _between(
        *((low.forward, high.forward) if is_forward else (low.backward, high.backward)), share
    )
    values = (
        (low.forward_value, high.forward_value) if is_forward else (low.backward_value, high.backward_value)
    )
    return DirectionExplained(
        low,
        high,
        _between(*values, share),
        correction,
        at + correction,
        loaded.source.forward_rule if is_forward else loaded.source.backward_rule,
        None if scale is None else round(at * scale),
        None if scale is None else round((at + correction) * scale),
    )


def _between(low: float, high: float, share: float) -> float:
    return low * (1 - share) + high * share


def _direction_data(direction: DirectionExplained, *, is_forward: bool) -> JsonObject:
    return {
        "correction": direction.correction,
        "corrected": direction.corrected,
        "file_value": direction.file_value,
        "sign_rule": direction.rule,
        "segment": [_point_data(row, is_forward=is_forward) for row in (direction.low, direction.high)],
        "nominal_counts": direction.nominal_counts,
        "counts": direction.counts,
    }


def _point_data(row: SourceRow, *, is_forward: bool) -> JsonObject:
    return {
        "position": row.position,
        "correction": row.forward if is_forward else row.backward,
        "file_value": row.forward_value if is_forward else row.backward_value,
        "line": row.forward_line if is_forward else row.backward_line,
    }
