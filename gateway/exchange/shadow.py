"""What is known about the words of one command field: the controller's belief and the drive's content.

A field is *torn* once a write to it was lost on the way: refused, withdrawn, unanswered. The controller may
believe in that write or not, so no part of a position may be combined with what stood there before. Parts
that come within :data:`JOIN_NS` of each other belong to one command: once they are all there, the position
is known again and is judged as a whole (M1, M3).
"""

from typing import Final

from gateway.modbus.registers import PositionField

JOIN_NS: Final = 200_000_000
"""Masters that write a position word by word do so 20 to 50 ms apart; the next command comes later."""


class Shadow:
    """Words of one command field, in the order of its registers."""

    __slots__ = (
        "_all_words",
        "_is_held",
        "_lost_ns",
        "_missing",
        "_pending",
        "_since_ns",
        "corrected_words",
        "losses",
        "may_be_corrected",
        "nominal_words",
    )

    def __init__(self, field: PositionField) -> None:
        self.nominal_words: bytes | None = None
        """What the controller believes the drive holds; None: not known."""
        self.corrected_words: bytes | None = None
        """What the drive acknowledged; None: not known."""
        self._all_words = (1 << field.words) - 1
        self._pending: bytearray | None = None
        self._missing = 0
        self._since_ns = 0
        self._lost_ns = 0
        """When the newest write that was lost had come."""
        self._is_held = False
        """The drive acknowledged every part that is pending: they need not hurry."""
        self.may_be_corrected = False
        """The drive may hold other words than the controller wrote."""
        self.losses = 0
        """How many writes were lost so far: what was sent before a loss does not make up for it."""

    @property
    def is_torn(self) -> bool:
        """Whether a write was lost and no whole position has been acknowledged since."""
        return self._pending is not None

    def settle(self, nominal_words: bytes, corrected_words: bytes | None, losses: int | None = None) -> None:
        """Note that the drive holds these words.

        Args:
            nominal_words: what the controller wrote.
            corrected_words: what the drive was told; None: that is not known.
            losses: how many writes had been lost when they were sent; None: none has been lost since.
        """
        self.nominal_words = nominal_words
        self.corrected_words = corrected_words
        self.may_be_corrected = corrected_words != nominal_words
        if losses is None or losses == self.losses:
            self._pending = None

    def forget(self) -> None:
        """Nobody knows any more what the drive holds."""
        self.nominal_words = self.corrected_words = None

    def tear(self, arrived_ns: int = 0) -> None:
        """Note that a whole write was lost, and when it had come: every word has to come again."""
        self._lost_ns = max(self._lost_ns, arrived_ns)
        self.losses += 1
        self._pending = bytearray(2 * self._all_words.bit_length())
        self._missing = self._all_words
        self._is_held = False

    def completed(self, first: int, words: bytes, arrived_ns: int) -> bytes | None:
        """Return the whole position once ``words`` are written from word ``first`` on; None if not known."""
        if self._pending is None:
            base = self.nominal_words
        elif self._are_joined(arrived_ns) and not self._missing & ~_mask(first, words):
            base = bytes(self._pending)
        else:
            base = None
        if base is None:
            return None
        return base[: 2 * first] + words + base[2 * first + len(words) :]

    def _are_joined(self, arrived_ns: int) -> bool:
        return self._is_held or arrived_ns - self._since_ns <= JOIN_NS

    def hold(self, first: int, words: bytes, arrived_ns: int) -> None:
        """Note a part that the drive acknowledged, while the other parts are not known."""
        covers_all = not self._all_words & ~self._missing & ~_mask(first, words)
        is_new = self._pending is None or covers_all or not self._are_joined(arrived_ns)
        stays_held = is_new or self._is_held
        if is_new:
            self.tear()
        self.lose(first, words, arrived_ns)
        self._is_held = stays_held

    def lose(self, first: int, words: bytes, arrived_ns: int) -> None:
        """Note a part that never reached the drive; it counts when the other parts follow soon.

        ``arrived_ns`` is when it came from its controller: of a loss that shows later than that of a newer
        write nothing counts.
        """
        if arrived_ns < self._lost_ns:
            self.tear()
            return
        self._lost_ns = arrived_ns
        if self._pending is None or self._missing == self._all_words or not self._are_joined(arrived_ns):
            self.tear()
            self._since_ns = arrived_ns
        self.losses += 1
        self._is_held = False
        assert self._pending is not None
        self._pending[2 * first : 2 * first + len(words)] = words
        self._missing &= ~_mask(first, words)
        if not self._missing:  # all of it was there, and was lost as a whole
            self.tear()


def _mask(first: int, words: bytes) -> int:
    return ((1 << len(words) // 2) - 1) << first
