"""What there is to see of a demonstration: written by its steps, read by the screen and the report."""

from dataclasses import dataclass, field
from enum import Enum

from gateway.cli.demonstration.spec import AxisSpec
from gateway.compensation.direction import Direction
from gateway.compensation.table import CorrectionTable
from gateway.metrology.readings import Reading


class Phase(Enum):
    """Steps of one round, in their order, in words for a person."""

    WAITING = "waiting"
    HOMING = "homing"
    MEASURING = "measuring with the laser, no correction"
    WITHOUT = "random targets from both sides, without correction"
    MEASURING_WITH = "measuring with the laser, with correction"
    WITH = "the same targets, with correction"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Judged:
    """One stop: where the nut truly was compared with where the controller wanted it."""

    nominal: float
    direction: Direction
    error_um: float


@dataclass(slots=True)
class AxisView:
    """One axis as it stands now. Positions in its units."""

    spec: AxisSpec
    backlash_um: float
    pitch_error_um: float
    """Range of the screw's own error over the table, without backlash."""
    phase: Phase = Phase.WAITING
    stops_done: int = 0
    stops_total: int = 0
    nominal: float = 0.0
    told: float = 0.0
    """What the drive was told: nominal plus correction."""
    nut: float = 0.0
    stops: int = 0
    inexact_readbacks: int = 0
    before: list[Reading] = field(default_factory=list)
    """What the laser read at its targets, without correction; the table is made of them."""
    after: list[Reading] = field(default_factory=list)
    """What it read there with correction; only for a report."""
    measured: list[Judged] = field(default_factory=list)
    without: list[Judged] = field(default_factory=list)
    corrected: list[Judged] = field(default_factory=list)
    table: CorrectionTable | None = None

    @property
    def error_without_um(self) -> float:
        """Worst error of the nut without correction."""
        return worst_um(self.without)

    @property
    def error_with_um(self) -> float:
        """Worst error of the nut with correction."""
        return worst_um(self.corrected)

    @property
    def is_readback_exact(self) -> bool:
        """Whether the controller read back exactly what it commanded, at every stop so far."""
        return self.stops > 0 and self.inexact_readbacks == 0


class Listener:
    """Hears of a round; this one does nothing about it."""

    def on_view(self, view: "View") -> None:
        """A round begins, and will be seen in ``view``."""

    def on_phase(self, axis: AxisView) -> None:
        """A step of an axis begins."""

    def on_end(self, view: "View") -> None:
        """The round is over."""


@dataclass(slots=True)
class View:
    """The whole machine, and who wants to hear that a step began."""

    seed: int
    axes: dict[str, AxisView]
    listener: Listener

    def begin(self, axis: AxisView, phase: Phase, stops: int) -> None:
        """A step of an axis begins."""
        axis.phase, axis.stops_done, axis.stops_total = phase, 0, stops
        self.listener.on_phase(axis)


def worst_um(judged: list[Judged]) -> float:
    """Largest error, whatever its sign; 0 before the first stop."""
    return max((abs(stop.error_um) for stop in judged), default=0.0)
