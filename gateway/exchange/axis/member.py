"""An axis as a member of its group: the values that the first trigger of the group has fixed for it (M11).

``axis.gantry`` says when values are fixed and for how long. During that time the axis moves with the
reference and the correction of the first moment. A reference that is found or lost, and another correction,
are put off; ``Axis.release`` puts them into force.
"""

from typing import NamedTuple

from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.gantry import Gantry, GantryEvent
from gateway.exchange.axis.motion import Motion, MotionState
from gateway.exchange.axis.reference import AxisReference


class Fixed(NamedTuple):
    """What the first trigger of its group has fixed for one axis."""

    is_referenced: bool
    """Whether its positions were meaningful."""
    motion_state: MotionState
    """Its motion state."""
    had_reported_done: bool
    """Whether its drive had reported done, for an unacknowledged target."""
    nominal_counts: float | None
    """Its nominal position as the controller saw it; None: unknown."""
    run: Rendering | None
    """The staged target that it must run; None: it held no complete one, or it is the first axis."""
    keeps_words: bool = False
    """Whether it may keep words of another switch, table or gain: all axes of its group do."""
    has_gone: bool = False
    may_have_gone: bool = False
    """It was the first, and it is unknown whether its drive obeyed the trigger."""
    missing: int = 0
    """Mask of the words of its target that have not come since it started: a drive that moves with each write
    may get them one by one."""
    part_ns: int = 0
    """When the newest word of its target came."""
    was_lost: bool = False
    """Its reference was lost since, even if it was found again."""
    has_other_correction: bool = False
    """Table, gain or switch were changed since."""


class Member:
    """The decision of the group of one axis, and the values that it has fixed for the axis."""

    __slots__ = ("_motion", "_reference", "fixed", "gantry")

    def __init__(self, motion: Motion, reference: AxisReference) -> None:
        self._motion, self._reference = motion, reference
        self.gantry: Gantry | None = None
        """The decision of its group, shared by all axes of the group; None: it is in no group."""
        self.fixed: Fixed | None = None
        """Replaces reference and switch until each axis of its group has started (M11); None: nothing is
        fixed."""

    def join(self, gantry: Gantry) -> None:
        """Make its axis a member of a group."""
        self.gantry = gantry

    @property
    def goes_as_referenced(self) -> bool:
        """Whether its next target is handled as that of a referenced axis (M11)."""
        fixed = self.fixed
        return self._reference.is_referenced if fixed is None else fixed.is_referenced

    @property
    def has_gone(self) -> bool:
        """Whether it has started, and another axis of its group has not."""
        return self.fixed is not None and self.fixed.has_gone

    def fix(self, run: Rendering | None, *, keeps_words: bool) -> None:
        """Its group starts: keep the present reference and correction until nothing is fixed any more."""
        motion = self._motion
        accepted, actual = motion.compensation.accepted, motion.actual
        nominal_counts = None if accepted is None else accepted.nominal_counts
        if nominal_counts is None and actual is not None:
            nominal_counts = motion.nominal_of(actual.counts)
        self.fixed = Fixed(
            self.goes_as_referenced, motion.state, motion.has_reported_done, nominal_counts, run, keeps_words
        )

    def release(self) -> Fixed | None:
        """Nothing is fixed any more: return what was."""
        fixed, self.fixed = self.fixed, None
        return fixed

    def end(self) -> None:
        """Its axis cannot be reached, or its registers have another meaning: the decision ends."""
        if self.gantry is not None:
            self.gantry.happens(GantryEvent.ENDED)

    def go_as_fixed(self, missing: int, now_ns: int) -> None:
        """It has started; ``missing``: mask of the words of its target that have not come yet."""
        assert self.fixed is not None
        self.fixed = self.fixed._replace(has_gone=True, missing=missing, part_ns=now_ns if missing else 0)

    def may_go_as_fixed(self) -> None:
        """It is the first of its group, and it is unknown whether it has started."""
        assert self.fixed is not None
        self.fixed = self.fixed._replace(may_have_gone=True)

    def keep_no_other_words(self) -> None:
        """An axis of its group uses what was fixed: none may keep words of another switch any more."""
        if self.fixed is not None and self.fixed.keeps_words:
            self.fixed = self.fixed._replace(keeps_words=False)

    def put_off_reference(self, *, is_referenced: bool) -> bool:
        """Put off a reference that was found or lost; return False if nothing is fixed."""
        fixed = self.fixed
        if fixed is None:
            return False
        self._put_off(fixed._replace(was_lost=fixed.was_lost or not is_referenced))
        return True

    def put_off_correction(self) -> bool:
        """Put off another table, gain or switch; return False if nothing is fixed."""
        fixed = self.fixed
        if fixed is None:
            return False
        self._put_off(fixed._replace(has_other_correction=True))
        return True

    def _put_off(self, fixed: Fixed) -> None:
        """Record what must wait until nothing is fixed any more."""
        assert self.gantry is not None
        self.fixed = fixed
        self.gantry.put_off()
