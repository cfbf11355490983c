"""Data of a move: the position of the axis, the correction of a target, and the state after it."""

from enum import Enum
from typing import NamedTuple

from gateway.compensation.blend import shape, towards
from gateway.compensation.correction_map import CorrectionMap
from gateway.compensation.correction_spec import NOTHING, CorrectionSpec
from gateway.compensation.direction import Direction, Travel
from gateway.compiled import mypyc_attr
from gateway.counts import Counts


class EstimateKind(Enum):
    """How well the position of an axis is known, and on which scale."""

    REACHED = "reached"
    """The last accepted target, in nominal counts, known to be reached: every count of difference matters."""
    MEASURED = "measured"
    """A measured position in nominal counts: a difference below the hysteresis means little."""
    ASSUMED = "assumed"
    """The last accepted target, in nominal counts, not proved to be reached."""
    ON_DRIVE = "on-drive"
    """A measured position in corrected counts, while the branch that led there is unknown."""
    ON_WAY = "on-way"
    """The same for an axis that moves from an assumed position."""


class PositionEstimate(NamedTuple):
    """The position of an axis."""

    counts: Counts
    kind: EstimateKind


class State(NamedTuple):
    """The whole state after a target. ``position`` is the last nominal machine position."""

    position: float | None = None
    travel: Travel = Travel(Direction.UNKNOWN, 0.0)
    progress: float = Direction.UNKNOWN.goal
    spec: CorrectionSpec = NOTHING
    previous: CorrectionSpec | None = None
    change: float = 1.0
    change_distance: float = 0.0
    is_unsure: bool = False
    at_ns: int = 0


class Move(NamedTuple):
    """What a target would do: its correction, and the state after accepting it."""

    nominal_counts: Counts
    correction_counts: float
    correction_map: CorrectionMap
    state: State


@mypyc_attr(free_list_len=1)  # nearly always there is one at a time
class SteadyMove:
    """A move that changes only the position; see ``AxisCompensation.move_of``.

    Plain numbers, because one is made for each setpoint.
    """

    __slots__ = (
        "before",
        "correction_counts",
        "correction_map",
        "extreme",
        "nominal_counts",
        "now_ns",
        "position",
    )

    def __init__(  # noqa: PLR0917 - called for each setpoint
        self,
        nominal_counts: Counts,
        correction_counts: float,
        position: float,
        extreme: float,
        now_ns: int,
        before: State,
        correction_map: CorrectionMap,
    ) -> None:
        self.nominal_counts = nominal_counts
        self.correction_counts = correction_counts
        self.position = position
        """Nominal machine position."""
        self.extreme = extreme
        """The furthest position of its travel."""
        self.now_ns = now_ns
        self.before = before
        """The state before it: its position, furthest position and time may be older."""
        self.correction_map = correction_map


class Accepted(NamedTuple):
    """The last target that the drive accepted."""

    nominal_counts: Counts
    corrected_counts: Counts


def is_reversing(state: State) -> bool:
    """Whether a blend between the branches is in progress."""
    direction = state.travel.direction
    return direction is not Direction.UNKNOWN and state.progress != direction.goal


def map_in_force(state: State) -> CorrectionMap:
    """Return the correction of a state: both blends, and the straight lines."""
    forward_share = shape(state.progress)
    weight = 1.0 if state.previous is None else shape(state.change)
    terms = state.spec.terms(forward_share, weight)
    offset, tilt = state.spec.offset * weight, state.spec.tilt * weight
    if state.previous is not None:
        terms += state.previous.terms(forward_share, 1.0 - weight)
        offset += state.previous.offset * (1.0 - weight)
        tilt += state.previous.tilt * (1.0 - weight)
    return CorrectionMap(terms, offset, tilt)


def advance_change(state: State, distance: float) -> State:
    """Return a state whose change-over has advanced by a distance, in units."""
    change = towards(state.change, 1.0, distance / state.change_distance if state.change_distance else 1.0)
    if change >= 1.0:
        return state._replace(previous=None, change=1.0)
    return state._replace(change=change)
