"""Whether an axis knows where it is, as far as the gateway can tell (M9).

Four ways, named by the configuration:

- *absolute*: an absolute encoder; a set-position command ends it until the gateway is told otherwise.
- *drive-bit*: the drive's homed bit. It is read when the line comes up, after every silence, after homing,
  and before a target when it was last seen a while ago; else it is seen in passing.
- *homing*: a homing command was seen, and after it the drive's homed bit (or its done bit), which is read
  before a target when nobody else has read it.
- *set-position*: the controller told the drive where it stands, at rest.

The last two are lost when the drive may have been switched off, and with an alarm. While nothing is known,
positions pass 1:1.
"""

from typing import Final

from gateway.exchange.plan import Reference
from gateway.times import NS_PER_MS, NS_PER_S

REFERENCE_FRESH_NS: Final = NS_PER_S
"""A homed bit that was seen longer ago is read again before a target."""
HOMING_SETTLE_NS: Final = 100 * NS_PER_MS
"""A bit that is still set so soon after a homing command may be that of the homing before."""


class ReferenceState:
    """What is known about the reference of one axis."""

    __slots__ = ("_homing_since_ns", "_seen_ns", "is_found", "is_in_doubt", "is_known", "kind")

    def __init__(self, kind: Reference) -> None:
        self.kind = kind
        self.is_found = kind is Reference.ABSOLUTE
        """Whether the axis counts as referenced."""
        self.is_in_doubt = self.follows_bit
        """Whether the homed bit has to be looked at before anything else is done with the axis."""
        self.is_known = not self.follows_bit
        """Whether the homed bit was ever seen, where it decides."""
        self._seen_ns = 0
        self._homing_since_ns: int | None = None

    @property
    def hangs_on_a_bit(self) -> bool:
        """Whether a status bit of the drive tells when the reference is found."""
        return self.kind in (Reference.DRIVE_BIT, Reference.HOMING)

    @property
    def follows_bit(self) -> bool:
        """Whether the drive's homed bit decides."""
        return self.kind is Reference.DRIVE_BIT

    @property
    def is_homing(self) -> bool:
        """Whether a homing command was seen, and not yet its end."""
        return self._homing_since_ns is not None

    def see(self, now_ns: int, *, is_set: bool) -> None:
        """Take note of the homed bit."""
        if is_set and self._may_be_old(now_ns):
            return
        if not is_set and self.is_homing:
            self._homing_since_ns = now_ns - HOMING_SETTLE_NS
        if is_set:
            self._homing_since_ns = None
        self.is_found = is_set
        self.is_in_doubt = False
        self.is_known = True
        self._seen_ns = now_ns

    def see_end_of_homing(self, now_ns: int, *, is_set: bool) -> None:
        """Take note of the bit that ends a homing command."""
        if self.kind is not Reference.HOMING or not self.is_homing:
            return
        if not is_set:
            self._homing_since_ns = now_ns - HOMING_SETTLE_NS
        elif not self._may_be_old(now_ns):
            self._homing_since_ns = None
            self.is_found = True

    def has_to_be_asked(self, now_ns: int, *, before_target: bool) -> bool:
        """Whether the homed bit, or the bit that ends a homing, has to be read before positions pass."""
        if not self.follows_bit:
            return before_target and self.is_homing and self.kind is Reference.HOMING
        is_old = not self.is_found or now_ns - self._seen_ns > REFERENCE_FRESH_NS
        return self.is_in_doubt or (before_target and is_old)

    def note_homing(self, now_ns: int) -> None:
        """A homing command went out: where the axis is, is only known when it has ended."""
        if self.kind is Reference.ABSOLUTE:
            return
        self.is_found = False
        self._homing_since_ns = now_ns
        if self.follows_bit:
            self.is_in_doubt = True

    def note_homing_ended(self) -> None:
        """Something else came before homing had ended: the bit that is seen next does not end it."""
        self._homing_since_ns = None

    def note_position_set(self, *, is_at_rest: bool) -> None:
        """The drive was told that it stands somewhere else."""
        self._homing_since_ns = None
        self.is_found = self.kind is Reference.SET_POSITION and is_at_rest
        self.is_in_doubt = self.follows_bit

    def note_loss(self) -> None:
        """The drive may have lost its position."""
        if self.kind is Reference.ABSOLUTE:
            return
        self._homing_since_ns = None
        if self.follows_bit:
            self.is_in_doubt = True
        else:
            self.is_found = False

    def declare(self) -> None:
        """A person says that the axis stands where its drive says."""
        self.is_found = True
        self.is_in_doubt = False
        self._homing_since_ns = None

    def _may_be_old(self, now_ns: int) -> bool:
        return self._homing_since_ns is not None and now_ns - self._homing_since_ns < HOMING_SETTLE_NS
