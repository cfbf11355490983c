"""What one request does to one axis, as it was sent; ``Axis`` says what its end makes of it."""

from collections.abc import Mapping
from typing import Final, NamedTuple

from gateway.compensation.moves import SteadyMove
from gateway.compiled import mypyc_attr
from gateway.counts import Counts
from gateway.drives.motion import Action
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.registers import ALL_WORDS, FieldImage


class Command:
    """What a request does to one axis, beside the positions in it."""

    __slots__ = (
        "action",
        "coils",
        "epoch",
        "is_doubtful",
        "modes_written",
        "number",
        "sets_position_too",
        "unclear_words",
        "words",
        "written",
    )

    def __init__(
        self,
        *,
        action: Action,
        number: int | None,
        words: Mapping[int, int],
        coils: Mapping[int, int],
        unclear_words: frozenset[int],
        written: tuple[int, ...],
        modes_written: tuple[int, ...],
        epoch: int,
        is_doubtful: bool,
        sets_position_too: bool = False,
    ) -> None:
        self.action = action
        """IGNORE where nothing moves; never START: that is what the mode makes of it."""
        self.number = number
        """The command field that runs, of an action that runs a target; also where nobody knows its mode."""
        self.words = words
        """Mode and trigger registers, as the request leaves them."""
        self.coils = coils
        self.unclear_words = unclear_words
        """Such registers that it changes in a way that nobody can tell."""
        self.written = written
        """Numbers of the command fields that it writes."""
        self.modes_written = modes_written
        """Registers that it writes and that decide what a position means."""
        self.epoch = epoch
        """Of its axis, when it was sent."""
        self.is_doubtful = is_doubtful
        """A bit that starts the motion is set, and nobody knows whether it was set before."""
        self.sets_position_too = sets_position_too
        """A stop that also tells the drive that it stands somewhere else."""

    @property
    def is_stop(self) -> bool:
        """Whether it must never be refused or late (M3)."""
        return self.action is Action.STOP

    @property
    def is_idle(self) -> bool:
        """Whether it neither moves the axis nor changes a target or what one means."""
        return self.action is Action.IGNORE and not (self.written or self.writes_mode)

    @property
    def runs_alone(self) -> bool:
        """Whether it runs a target that was written before."""
        return self.action.runs_target and self.number not in self.written

    @property
    def runs_stored(self) -> bool:
        """Whether it runs what the drive keeps, in a way that nobody knows."""
        return self.action is Action.STORED or (
            self.action is Action.UNKNOWN and self.number is not None and self.number not in self.written
        )

    @property
    def writes_mode(self) -> bool:
        """Whether it sets a register that decides what a position means."""
        return bool(self.modes_written)


class Staging(NamedTuple):
    """Words of a command field or limit that the drive holds and does not run."""

    image: FieldImage
    nominal_words: bytes
    corrected_words: bytes | None
    """None: what the drive holds is not known."""
    epoch: int
    """Of the field, when it was sent."""
    written: int = ALL_WORDS
    """Mask of the words that the controller wrote."""


@mypyc_attr(free_list_len=1)  # as of the moves in them
class SteadyTarget:
    """A target on the fast path."""

    __slots__ = ("corrected_counts", "corrected_words", "epoch", "nominal_words", "steady")

    def __init__(
        self,
        nominal_words: bytes,
        corrected_words: bytes,
        corrected_counts: Counts,
        epoch: int,
        steady: SteadyMove | None,
    ) -> None:
        self.nominal_words = nominal_words
        self.corrected_words = corrected_words
        self.corrected_counts = corrected_counts
        self.epoch = epoch
        """Of its field, when it was sent."""
        self.steady = steady
        """What accepting it means; None: it is a repeat."""


class Part(NamedTuple):
    """What a request writes of one command field or limit."""

    image: FieldImage
    first: int
    """Its first word; -1: all of it, or in a way that leaves nothing of it certain."""
    words: bytes
    """Empty where a mask changes one word."""


NO_RUNS: Final[Mapping[str, Rendering]] = {}


class AxisRequest:
    """What one request does to one axis, as it was sent."""

    __slots__ = (
        "arrived_ns",
        "blind",
        "buffered_parts",
        "command",
        "epochs",
        "follows_ns",
        "goes_unknown",
        "is_uncorrected",
        "parts",
        "peer_runs",
        "reads_too",
        "remaps",
        "runs",
        "stagings",
        "targets",
    )

    def __init__(
        self,
        arrived_ns: int,
        command: Command | None = None,
        *,
        follows_ns: int = 0,
        reads_too: bool = False,
    ) -> None:
        self.arrived_ns = arrived_ns
        """When it came from its controller; no two requests of a line came at the same instant."""
        self.follows_ns = follows_ns
        """When the request before it came on the same connection."""
        self.reads_too = reads_too
        """It reads in the same frame (FC23): an exception may be one of the reading."""
        self.command = command
        self.targets: list[Rendering] = []
        """Targets that the drive goes to with this request."""
        self.runs: list[Rendering] = []
        """The same of those that it held already."""
        self.epochs: dict[int, int] = {}
        """Of the field of each of these targets, by its number, when the request was sent."""
        self.stagings: list[Staging] = []
        self.parts: list[Part] = []
        """What it writes of command fields, all of it."""
        self.buffered_parts: list[Part] = []
        """Parts of staged targets whose other parts are not known yet: they pass as they come (M1)."""
        self.blind: list[FieldImage] = []
        """Command fields that were written 1:1 in a way that leaves their content unknown."""
        self.goes_unknown = False
        """The axis goes somewhere nobody knows: a distance passed unchanged."""
        self.is_uncorrected = False
        """It goes there beside a stop of another axis, with words that were not corrected for it."""
        self.peer_runs: Mapping[str, Rendering] = NO_RUNS
        """What the other axes of its group hold and have to run, by their names (M11)."""
        self.remaps = False
        """It writes a register that moves other registers about."""

    def go_anywhere(self) -> None:
        """Note that nobody knows where the axis goes."""
        self.goes_unknown = True

    def run_uncorrected(self) -> None:
        """Note that the axis goes somewhere with words that were not corrected for that."""
        self.goes_unknown = self.is_uncorrected = True

    def forget_targets(self) -> None:
        """Note that what was rendered is not what goes out."""
        self.targets.clear()
        self.stagings.clear()

    def remap(self) -> None:
        """Note that it moves registers about."""
        self.remaps = True

    @property
    def is_run_known(self) -> bool:
        """Whether a trigger ran a target whose end is known."""
        return any(run.move is not None or not any(run.nominal_words) for run in self.runs)

    @property
    def sends_somewhere(self) -> bool:
        """Whether it makes the axis go to a position."""
        return bool(self.targets or self.runs or self.blind)
