"""The curve of an axis as it is corrected: the table in force with its gain, on the controller's scale."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gateway.compensation.correction_spec import spec_of_table
from gateway.compensation.errors import SettingsError, TableError
from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import CorrectionTable
from gateway.files import FileRefusedError
from gateway.state.folder import read_state
from gateway.state.tables import WrongTableError, checked, table_path

FEWEST: Final = 10
MOST: Final = 10_000
DECIMALS: Final = 9
"""Of a length: below what a double holds of a metre in mm, above what subtracting an offset leaves behind."""


class NoCurveError(Exception):
    """There is no curve; why, in a sentence."""


@dataclass(frozen=True, slots=True)
class Curve:
    """Points of a table, none of them computed, with what is added there. Lengths in the axis's units."""

    positions: tuple[float, ...]
    """Nominal: on the controller's scale, as the positions of the status are."""
    forward: tuple[float, ...]
    backward: tuple[float, ...]
    indexes: tuple[int, ...]
    """Which points of the table they are, counted from 0."""
    table_points: int

    @property
    def is_whole(self) -> bool:
        """Whether every point of the table is there."""
        return len(self.positions) == self.table_points


def read_curve(state: Path, digest: str, axis: Mapping[str, Any], settings: AxisSettings, most: int) -> Curve:
    """Return at most ``most`` points of the compiled table ``digest``; blocks.

    ``axis`` is the part of the status model, which says what gain is in force.

    Raises:
        NoCurveError: the compiled table cannot be read, or is none.
    """
    try:
        table = checked(read_state(table_path(state, digest)))
        in_force = spec_of_table(table, settings).curve
    except (FileRefusedError, WrongTableError, TableError, SettingsError) as error:
        raise NoCurveError(f"compiled table {digest}: {error}") from error
    assert in_force is not None, "a table makes a curve"
    return _curve(in_force.table, axis["gain"], settings.machine_offset, most)


def _curve(table: CorrectionTable, gain: Mapping[str, float], machine_offset: float, most: int) -> Curve:
    indexes = tuple(thinned(table, max(FEWEST, most)))
    return Curve(
        positions=tuple(round(table.positions[i] - machine_offset, DECIMALS) for i in indexes),
        forward=_scaled(table.forward, indexes, gain["forward"]),
        backward=_scaled(table.backward, indexes, gain["backward"]),
        indexes=indexes,
        table_points=len(table.positions),
    )


def _scaled(values: Sequence[float], indexes: Sequence[int], gain: float) -> tuple[float, ...]:
    return tuple(round(gain * values[i], DECIMALS) + 0.0 for i in indexes)  # no -0.0


def thinned(table: CorrectionTable, most: int) -> Iterator[int]:
    """Yield ascending indexes of at most ``most`` points: the ends, and of each stretch its extremes.

    So the highest and the lowest correction of each branch are always there.
    """
    count = len(table.positions)
    if count <= most:
        yield from range(count)
        return
    branches = (table.forward,) if table.is_unidirectional else (table.forward, table.backward)
    stretches = (most - 2) // (2 * len(branches))
    yield 0
    for k in range(stretches):
        begin, end = 1 + k * (count - 2) // stretches, 1 + (k + 1) * (count - 2) // stretches
        found: set[int] = set()
        for branch in branches:
            values = list(branch[begin:end])
            found |= {begin + values.index(min(values)), begin + values.index(max(values))}
        yield from sorted(found)
    yield count - 1


def curve_as_data(
    name: str, axis: Mapping[str, Any], digest: str, settings: AxisSettings, curve: Curve
) -> dict[str, Any]:
    """Return a curve as ``/tables/NAME`` shows it."""
    offset = settings.machine_offset
    return {
        "axis": name,
        "units": axis["units"],
        "file": axis["table"]["file"],
        "digest": digest,
        "gain": axis["gain"],
        "machine_offset": offset,
        "travel": None if settings.travel is None else [round(p - offset, DECIMALS) for p in settings.travel],
        "modulo": settings.modulo or None,
        "table_points": curve.table_points,
        "is_whole": curve.is_whole,
        "indexes": curve.indexes,
        "positions": curve.positions,
        "forward": curve.forward,
        "backward": curve.backward,
    }
