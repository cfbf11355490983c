"""What is known about the words of one command field: the controller's belief and the drive's content.

A field is *torn* once a write to it was lost on the way: refused, withdrawn, unanswered. The controller may
believe in that write or not, so no part of a position may be combined with what stood there before. Only when
every word was written again is the position known once more (M1, M3).
"""

from gateway.modbus.registers import PositionField


class Shadow:
    """Words of one command field, in the order of its registers."""

    __slots__ = ("_all_words", "_missing", "_pending", "corrected_words", "nominal_words")

    def __init__(self, field: PositionField) -> None:
        self.nominal_words: bytes | None = None
        """What the controller believes the drive holds; None: not known."""
        self.corrected_words: bytes | None = None
        """What the drive acknowledged; None: not known."""
        self._all_words = (1 << field.words) - 1
        self._pending: bytearray | None = None
        self._missing = 0

    @property
    def is_torn(self) -> bool:
        """Whether a write was lost and not every word has been written again since."""
        return self._pending is not None

    def settle(self, nominal_words: bytes, corrected_words: bytes) -> None:
        """Note that the drive holds these words."""
        self.nominal_words = nominal_words
        self.corrected_words = corrected_words
        self._pending = None

    def forget(self) -> None:
        """Nobody knows any more what the drive holds."""
        self.nominal_words = self.corrected_words = None

    def tear(self) -> None:
        """Note that a write was lost: from now on every word has to come again."""
        self._pending = bytearray(2 * self._all_words.bit_length())
        self._missing = self._all_words

    def completed(self, first: int, words: bytes) -> bytes | None:
        """Return the whole position once ``words`` are written from word ``first`` on; None if not known."""
        base = self._pending if self._pending is not None else self.nominal_words
        if base is None or (self._pending is not None and self._missing & ~_mask(first, words)):
            return None
        merged = bytearray(base)
        merged[2 * first : 2 * first + len(words)] = words
        return bytes(merged)

    def lose(self, first: int, words: bytes) -> None:
        """Note a write that never reached the drive; on a torn field its words count as written again."""
        if self._pending is None:
            self.tear()
            return
        self._pending[2 * first : 2 * first + len(words)] = words
        self._missing &= ~_mask(first, words)


def _mask(first: int, words: bytes) -> int:
    return ((1 << len(words) // 2) - 1) << first
