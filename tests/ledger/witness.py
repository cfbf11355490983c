"""What the witness knows of one axis, and where each of its motions has to end.

``place`` is the nominal position, as the controller counts it, to which the last motion leads: a range of
counts that is one count wide while everything was acknowledged, None when only the drive's own position tells
(then it is somewhere between what the two branches make of it).
"""

from collections.abc import Iterable
from math import ceil, floor
from typing import Final, NamedTuple

from tests.ledger.clock import MS, Clock
from tests.ledger.continuity import SLOPE, Continuity, Reading
from tests.ledger.drives import Drive, Operation
from tests.ledger.events import Book, Journal
from tests.ledger.layouts import Basis, Layout
from tests.ledger.screws import Screw

ROUNDING: Final = 0.5 + 1e-6
ONE_COUNT: Final = 1.0 + 1e-6
HYSTERESIS: Final = 2
BESIDE: Final = 4
"""Counts beside the two branches of a target within which a moving axis may be taken for either side."""
SAMPLE_MS: Final = 250
SLOW_MS: Final = 5
"""A drive that takes a frame later than this has moved on from where it was told to go from."""
BAND: Final = 2
"""Counts that rounding and anchors may put a reading beside the branches."""

Range = tuple[int, int]


class Intent(NamedTuple):
    """What a frame that makes the drive move is meant to do."""

    nominal: int
    """A position, or a distance."""
    is_relative: bool
    is_trusted: bool
    """Whether target and mode were acknowledged when it was sent."""
    place: Range | None
    is_raw: bool = False
    """The map does not know its meaning: it passes as it came."""
    is_unknown: bool = False
    """A part of the target was never written: what the drive held before the first request completes it."""
    why: str = ""
    sent: tuple[int, int] = (0, 0)
    """When it was sent, and where the axis was then."""


class Witness:
    def __init__(self, clock: Clock, layout: Layout, screw: Screw, drive: Drive, book: Book) -> None:
        self.layout, self.drive, self.book = layout, drive, book
        self.journal = Journal(clock, layout.name, book.kept)
        self._clock = clock
        self._screw = screw
        self.place: Range | None = None
        self.is_from_run = False
        """``place`` is that of a target that was run, and nothing has moved the axis since."""
        self.is_in_doubt = True
        """Something that may have moved the axis was not acknowledged; no absolute move since."""
        self.reading_failed = False
        """The gateway asked where the axis is and was not told."""
        self.is_branch_lost = False
        """The gateway looked where it is, as nobody had seen it for long, and it was on its way (M6)."""
        self.seen_ns = 0
        """When the gateway was told last where it is."""
        self._was_unsure = False
        """The last move was made although the gateway had asked where the axis is and was not told."""
        self.done_seen = False
        self.place_before: Range | None = None
        self.was_jogged = self._was_nothing = self._fades = False
        self._is_directed = self._has_directions = False
        """The last move, and some acknowledged one, was certain of its direction."""
        self.faded = float(self.most_correction())
        """Counts by which a reading may lie beside the branches: what was read where a move began is kept,
        and faded out on its way. The table itself comes into force with the first move.
        """
        self._told: tuple[int, int] | None = None
        """Instant and count of the last position."""
        self._sample: tuple[int, int] | None = None
        """The same, if the gateway asked for it, or decided by it; of an older one when and where it did."""
        self._continuity = Continuity()
        self._begun_faded = self.faded
        """The same when the present motion began."""
        self._begun_at = 0
        self._was_moving = False
        """The present motion began on the way, or elsewhere than where the gateway saw the axis last."""
        self.began_ns = 0
        """When the drive was made to move last."""
        self._left = 0.0
        """What of that was left when a move arrived and nobody looked: it comes back on the way back."""
        self._run_range: Range | None = None
        self._is_ambiguous = True
        self._moves = 0
        self._acknowledged = -1
        """The last move that was acknowledged."""

    @property
    def now_ns(self) -> int:
        return self._clock.now_ns

    # --- the exact table -------------------------------------------------------------------------------

    def value(self, nominal: int, *, is_forward: bool) -> float:
        """Counts at which the drive has to stand for a nominal position."""
        correction = self._screw.correction_mm(self.layout.machine_mm(nominal), is_forward=is_forward)
        return nominal + correction * self.layout.counts_per_unit

    def is_one_of(self, corrected: int, nominal: int) -> bool:
        """Whether a count is the correction of a position for either direction, or half way between."""
        up, down = self.value(nominal, is_forward=True), self.value(nominal, is_forward=False)
        return any(abs(corrected - value) <= ROUNDING for value in (up, down, (up + down) / 2))

    def band(self, corrected: int, faded: float = 0.0) -> Range:
        """Nominal positions that a count of the drive may stand for."""
        corrections = self._corrections(corrected)
        faded = max(faded, self.faded)
        low, high = corrected - max(corrections) - faded, corrected - min(corrections) + faded
        return floor(low) - BAND, ceil(high) + BAND

    def _corrections(self, corrected: int) -> list[float]:
        return [self.value(corrected, is_forward=way) - corrected for way in (True, False)]

    def _fade_from(self, corrected: int) -> None:
        corrections = self._corrections(corrected)
        self.faded += max(corrections) - min(corrections)
        if self._was_moving:  # the gateway may take it to have begun where it saw the axis last
            self.faded += SLOPE * abs(corrected - self._begun_at)
        self._begun_at = corrected
        self._begun_faded = self.faded

    def _end_fade(self) -> None:
        """Once a move that was acknowledged has arrived, nothing of the one before is left."""
        is_answered = self._acknowledged == self._moves and self._fades
        if is_answered and not self.drive.motor.is_moving(self.now_ns):
            self._left, self.faded = self.faded, 0.0

    def most_correction(self) -> int:
        """More counts than any correction has."""
        return int(0.35 * abs(self.layout.counts_per_unit))

    # --- motions ---------------------------------------------------------------------------------------

    def did(self, operation: Operation, intent: Intent | None) -> None:
        """Judge what the drive did."""
        now_ns = self._clock.now_ns
        self.journal.note(
            f"drive: {operation.kind}", b"", f"{operation.was_at} -> {operation.end}, base {operation.base}"
        )
        self.book.seen[f"drive {operation.kind}"] += 1
        self.began_ns = now_ns
        has_come_further = self._sample is not None and self._sample[1] != operation.was_at
        self.done_seen, self._was_moving = False, operation.was_moving or has_come_further
        if operation.kind in ("stop", "jog"):
            self._interrupted(operation)
            return
        if intent is None:
            self._violation("invented-motion", f"the drive went to {operation.end} and nobody had said so")
            self._run_range = None
            return
        if not intent.is_trusted:
            self._violation("ran-lost-target", intent.why)
        self._judge(operation, intent)
        self._fade_from(operation.was_at)
        self._moves += 1
        self._clock.at(self.drive.motor.arrives_ns, lambda number=self._moves: self._settled(number))  # type: ignore[misc]
        self.journal.note("  judged", b"", f"nominal {self._run_range} at {now_ns / MS:.3f}")

    def _interrupted(self, operation: Operation) -> None:
        self._moves += 1
        self.is_from_run, self.was_jogged = False, operation.kind == "jog"
        if operation.kind == "jog" or operation.was_moving:
            self.place = None
        if operation.kind == "jog":
            self._fade_from(operation.was_at)
            self.faded += self._left
        self._run_range = self.place

    def _judge(self, operation: Operation, intent: Intent) -> None:
        self.place_before = intent.place
        self._is_directed = self._was_nothing = self._fades = False
        if intent.is_unknown:
            self._run_range, self._is_ambiguous = None, True
            return
        if intent.is_raw:
            self._run_range, self._is_ambiguous = None, True
            if operation.end - operation.base != intent.nominal:
                self._violation(
                    "touched-unknown", f"{intent.nominal} became {operation.end - operation.base}"
                )
            self.faded += self._left
            return
        if intent.is_relative and not intent.nominal:
            if operation.end != operation.base:
                self._violation("nothing-became-something", f"a distance of 0 moved it to {operation.end}")
            self._run_range, self._is_ambiguous = intent.place, True
            self._was_nothing = True
            return
        self._fades = True
        low, high = self._destination(operation, intent)
        ways = self._ways(low, high, operation, intent)
        tolerance = ONE_COUNT if intent.is_relative else ROUNDING
        # What was unsure may be made right, or stay as it was.
        if self._is_again(low, high, intent) and (
            not self._was_unsure or operation.end == operation.end_before
        ):
            self.book.seen["repeats"] += 1
            if abs(operation.end - operation.end_before) > (ONE_COUNT if intent.is_relative else 0):
                self._violation(
                    "M4-not-the-same-words", f"{operation.end_before} became {operation.end} for {low}"
                )
            self._run_range, self._is_ambiguous = (low, high), True
            return
        fitting = self._fitting(operation.end, low, high, ways, tolerance)
        if not fitting and (self.reading_failed or (len(ways) > 1 and not self._has_directions)):
            fitting = self._fitting(operation.end, low, high, (True, False), tolerance) or (
                [low] if low == high and self.is_one_of(operation.end, low) else []
            )
            self.book.seen["unsure moves"] += 1
        self._was_unsure = self.reading_failed
        if not fitting:
            self._complain(operation, low, high, ways, tolerance)
        self._is_directed = len(ways) == 1 and not self.reading_failed
        self._run_range = (min(fitting), max(fitting)) if fitting else None
        is_partial = (
            intent.place is not None and not self.is_from_run
        )  # stopped while a correction was fading
        self._is_ambiguous = len(ways) > 1 or not fitting or self.reading_failed or is_partial
        self.book.seen["ambiguous moves" if len(ways) > 1 else "certain moves"] += 1

    def _destination(self, operation: Operation, intent: Intent) -> Range:
        if not intent.is_relative:
            return intent.nominal, intent.nominal
        if operation.was_moving and self.layout.basis is not Basis.TARGET and intent.nominal:
            self._violation("relative-of-a-moving-axis", f"from {operation.base} while it was moving")
        low, high = intent.place or self.band(operation.base)
        return low + intent.nominal, high + intent.nominal

    def _is_again(self, low: int, high: int, intent: Intent) -> bool:
        return low == high and self.is_from_run and intent.place == (low, low)

    def _ways(self, low: int, high: int, operation: Operation, intent: Intent) -> tuple[bool, ...]:
        """Directions in which the move may be taken to go: one where it is certain."""
        if self.is_branch_lost:
            return (True, False)
        sign = self.layout.machine_sign
        places = self._places(operation.was_at, intent)
        if intent.place is not None and not operation.was_moving and len(places) == 1:
            beside = 0 if self.done_seen and self.is_from_run else HYSTERESIS + (not self.is_from_run)
            least, most = low - intent.place[1], high - intent.place[0]
        else:
            beside = BESIDE + int(self.faded)  # the reading may lie as far beside
            values = [self.value(n, is_forward=way) for n in (low, high) for way in (True, False)]
            least, most = min(values) - max(places), max(values) - min(places)  # type: ignore[assignment]
        if least > beside:
            return (sign > 0,)
        if most < -beside:
            return (sign < 0,)
        return (True, False)

    def _places(self, was_at: int, intent: Intent) -> set[int]:
        """Where the gateway may have taken the axis to be: now, when it asked, when a slow drive was told."""
        places, now_ns = {was_at}, self.now_ns
        if self._sample is not None and now_ns - self._sample[0] <= SAMPLE_MS * MS:
            places.add(self._sample[1])
        if now_ns - intent.sent[0] > SLOW_MS * MS:
            places.add(intent.sent[1])
        return places

    def _fitting(self, end: int, low: int, high: int, ways: Iterable[bool], tolerance: float) -> list[int]:
        return [
            nominal
            for nominal in range(low, high + 1)
            if any(abs(end - self.value(nominal, is_forward=way)) <= tolerance for way in ways)
        ]

    def _complain(
        self, operation: Operation, low: int, high: int, ways: tuple[bool, ...], tolerance: float
    ) -> None:
        exact = [round(self.value(low, is_forward=way), 3) for way in (True, False)]
        detail = (
            f"to nominal {low}..{high} from {operation.was_at} the drive went to {operation.end}; exact "
            f"would be {exact[0]} forward, {exact[1]} backward, and forward is {ways}"
        )
        other = self._fitting(operation.end, low, high, (True, False), tolerance)
        if not other and low == high and self.is_one_of(operation.end, low):
            self._violation("half-way", detail)
        else:
            kind = "wrong-branch" if self.is_from_run or self.place_before is None else "against-the-reading"
            self._violation(kind if other else "wrong-target", detail)

    def _settled(self, number: int) -> None:
        """Judge where the axis has come to rest, by the way that it really came."""
        if number != self._moves:
            return
        self._end_fade()
        if self._is_ambiguous or self._run_range is None:
            return
        self.book.seen["settled axes"] += 1
        is_forward = self.drive.motor.last_sense * self.layout.machine_sign > 0
        end = self.drive.motor.end
        low, high = self._run_range
        if not self._fitting(end, low, high, (is_forward,), ONE_COUNT):
            self._violation("settled-off", f"stands at {end} for nominal {low}..{high}")

    # --- what became of a frame that may have moved it ----------------------------------------------------

    def moved(self, *, is_acknowledged: bool, has_moved: bool, is_interruption: bool) -> None:
        """Note that a frame which moves the axis was answered, or was not; or was, and moved nothing."""
        if not is_acknowledged or not has_moved:
            self.place, self.is_from_run, self.is_in_doubt = None, False, True
            return
        if is_interruption:
            self.is_in_doubt |= self.was_jogged
            return
        self.is_branch_lost = False
        if not self._was_nothing:
            self.is_from_run = self._run_range is not None
        self.place = self._run_range
        self.is_in_doubt = self._run_range is None
        self._has_directions |= self._is_directed
        self._acknowledged = self._moves
        self._end_fade()

    def invalidate_all(self) -> None:
        """The drive may have been switched off."""
        self.place, self.is_from_run, self.is_in_doubt = None, False, True
        self.done_seen = False
        self._continuity.forget()
        self.journal.note("what the drive holds is not known any more")

    # --- readings -------------------------------------------------------------------------------------------

    def told(self, corrected: int, *, is_for_a_move: bool) -> None:
        """Note that the gateway was told where the axis is; ``is_for_a_move``: because it asked.

        What it was told in passing it may use only while the axis cannot have passed the target meanwhile.
        """
        self._told = self._clock.now_ns, corrected
        self._sample = self._told if is_for_a_move else None
        self.seen_ns = self._clock.now_ns
        if not self.drive.motor.is_moving(self.now_ns):
            self._left = 0.0
        self.reading_failed = False

    @property
    def is_seen_at_rest(self) -> bool:
        """Whether the gateway was told that the axis has come to where it was sent."""
        told = self._told
        return told is not None and told[0] > self.began_ns and told[1] == self.drive.motor.end

    def decides(self) -> None:
        """Note that a branch is decided now: what came just now is as good as what was asked for.

        What came a moment before says on which side of its target the axis is, if it still is there.
        """
        now_ns = self._clock.now_ns
        if self._told is None or now_ns - self._told[0] > SAMPLE_MS * MS:
            return
        if self._told[0] == now_ns:
            self._sample = self._told
        elif self._sample is None:
            self._sample = now_ns, self.drive.motor.at(now_ns)

    def check_reading(
        self, corrected: int, read: dict[int, int], *, is_stationary: bool, faded: float
    ) -> None:
        """Judge what the controller was told of a position.

        ``read``: words by their place in the field; ``faded``: what :attr:`faded` was when it was taken.
        """
        low, high = self.band(corrected, faded)
        is_settled = is_stationary and self.place is not None and corrected == self.drive.motor.end
        if is_settled and self.place is not None:
            low, high = self.place
            self.book.seen["exact readbacks"] += low == high
        else:
            self.book.seen["readbacks on the way"] += 1
        fitting = [
            n
            for n in range(low, high + 1)
            if all(self.layout.split(n)[i] == word for i, word in read.items())
        ]
        if not fitting:
            kind = "readback-not-exact" if is_settled else "readback-off"
            words = {i: hex(word) for i, word in read.items()}
            self._violation(kind, f"{corrected} read as {words}; it stands for {low}..{high}")
        elif len(read) == 2:
            self._check_jump(corrected, fitting[0], max(faded, self._begun_faded))
            if is_stationary and not self.is_in_doubt and corrected == self.drive.motor.end:
                self.place = (fitting[0], fitting[0])

    def _check_jump(self, corrected: int, nominal: int, faded: float) -> None:
        if self.is_in_doubt or self._was_moving:
            self._continuity.forget()  # where the gateway took the motion to begin is not known
            return
        motor = self.drive.motor
        reading = Reading(corrected, nominal, self._moves, faded)
        jump = self._continuity.jump(reading, motor.begun_at, abs(motor.end - motor.begun_at))
        if jump:
            self._violation("reading-jumps", f"{corrected} reads {nominal}: {jump:.1f} counts too far")

    def _violation(self, kind: str, detail: str) -> None:
        self.book.violation(kind, detail, self.journal)
