"""What the controller believes the registers of one axis hold: the words of its target, and its mode."""

from typing import Final, NamedTuple

from tests.ledger.clock import MS
from tests.ledger.frames import Parsed
from tests.ledger.layouts import Layout, Style

JOINED_MS: Final = 300
"""Halves that are further apart belong to different commands."""
SURELY_JOINED_MS: Final = 100
"""Halves that follow each other as soon as this belong to one command."""


class Register:
    """One register: what was written last, whether that was acknowledged, and when."""

    __slots__ = ("at_ns", "is_certain", "is_ok", "is_taken_back", "number", "word")

    def __init__(self) -> None:
        self.word: int | None = None
        self.is_ok = self.is_certain = False
        """The drive holds it; and that by an acknowledgement of the last write itself, not of one like it."""
        self.is_taken_back = False
        """Its last write was refused and has written nothing: it is what it was before."""
        self.at_ns = 0
        """When it was written, or lost."""
        self.number = 0
        """Of the request that wrote it last."""

    def write(self, word: int | None, number: int) -> None:
        """Take note of a write that is not acknowledged so far."""
        self.word, self.number = word, number
        self.is_ok = self.is_certain = self.is_taken_back = False

    def accept(self, number: int, word: int | None) -> None:
        """Take note that the drive accepted a word, with all that was written up to a number."""
        if self.word is not None:
            self.is_certain |= self.number <= number
            self.is_ok |= self.is_certain or self.word == word


class Written(NamedTuple):
    """What was written of the target and the mode by some moment."""

    number: int
    target: tuple[int | None, int | None]
    mode: int | None


class Belief:
    """The target of one axis as the controller wrote it last, in the order in which it wrote."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self.target = (Register(), Register())
        self.mode = Register()
        self.blocked_ns = 0
        self.is_blocked = True
        """A write was lost and no complete target was accepted since: triggers may be refused."""
        self.count = 0
        """Requests so far that wrote any of it."""
        self.is_raw = False
        """The map does not know how the target was meant: it went out as it came."""
        self._is_mode_lost = False
        """A write to it was lost, and none was accepted since."""
        self._begin_mode()

    def _begin_mode(self) -> None:
        """Only a mode register counts as it stands; the others have nothing to be lost."""
        if self.layout.style is not Style.STICKY:
            self.know_mode(0)

    def know_mode(self, word: int) -> None:
        """Take note that the gateway was told what the drive's mode register holds.

        That proves a mode that was lost, and stands for one that was never written.
        """
        if self.mode.word is None:
            self.mode.word, self.mode.is_certain = word, not self._is_mode_lost
        self.mode.is_ok |= self.mode.word == word

    @property
    def nominal(self) -> int | None:
        """The target; None while a word was never written."""
        first, second = self.target
        if first.word is None or second.word is None:
            return None
        return self.layout.join((first.word, second.word))

    @property
    def is_target_ok(self) -> bool:
        """Whether every word of the target was acknowledged as it was written last."""
        return all(word.is_ok for word in self.target)

    @property
    def is_ok(self) -> bool:
        return self.is_target_ok and self.mode.is_ok

    def touched(self, request: Parsed) -> list[int]:
        """Return the words of the target, 0 and 1, that a request writes."""
        if request.write is None:
            return []
        address, words = request.write
        start = self.layout.command - address
        return [i for i in (0, 1) if 0 <= start + i < len(words)]

    def touches_mode(self, request: Parsed) -> bool:
        if request.write is None or self.layout.style in (Style.DIRECT, Style.PLAIN, Style.TRIGGERED):
            return False
        return 0 <= self.layout.mode - request.write[0] < len(request.write[1])

    def word_after(self, request: Parsed, index: int) -> int | None:
        """Return one word of the target once a request is applied."""
        assert request.write is not None
        address, words = request.write
        if request.mask is None:
            return words[self.layout.command + index - address]
        before = self.target[index].word
        if before is None:
            return None
        and_mask, or_mask = request.mask
        return before & and_mask | or_mask & ~and_mask & 0xFFFF

    def write(self, request: Parsed, arrived_ns: int) -> None:
        """Take note of what a request writes; not acknowledged so far."""
        self.count += 1
        for index in self.touched(request):
            self.target[index].write(self.word_after(request, index), self.count)
            self.target[index].at_ns = arrived_ns
        if self.touches_mode(request):
            assert request.write is not None
            self.mode.write(request.write[1][self.layout.mode - request.write[0]], self.count)

    def stale_part(self, request: Parsed, arrived_ns: int) -> bool:
        """Whether a part is completed with a word that was lost long ago."""
        others = [self.target[i] for i in (0, 1) if i not in self.touched(request)]
        return any(
            not (word.is_ok or word.is_taken_back)
            and word.word is not None
            and arrived_ns - word.at_ns > JOINED_MS * MS
            for word in others
        )

    def written(self) -> Written:
        """Return what is written so far, to hold an acknowledgement against."""
        first, second = self.target
        return Written(self.count, (first.word, second.word), self.mode.word)

    def acknowledge(self, request: Parsed, sent: Written, *, whole: bool) -> None:
        """Take note that the drive accepted a write; ``whole``: with all words of the target.

        ``sent``: :meth:`written` when it was sent. What was written later, and is something else, is not what
        was accepted.
        """
        indices = self.touched(request)
        for i in (0, 1) if indices and whole else indices:
            self.target[i].accept(sent.number, sent.target[i])
        if self.touches_mode(request):
            self.mode.accept(sent.number, sent.mode)
            self._is_mode_lost = not self.mode.is_certain
        is_certain = all(register.is_certain for register in (*self.target, self.mode))
        if indices and is_certain and (whole or self._are_both_new()):
            self.is_blocked = False

    def take_back(self, request: Parsed, before: Written, sent: Written) -> None:
        """Take note that a write was refused and has written nothing: what it wrote is as it was (M1)."""
        for index in self.touched(request):
            register = self.target[index]
            if register.number == sent.number:
                register.word, register.is_taken_back = before.target[index], True

    def hold(self, written: Written) -> None:
        """Take note that the drive was read, and holds a target that was written before."""
        for register, word in zip(self.target, written.target, strict=True):
            register.word = word

    def _are_both_new(self) -> bool:
        """Whether both halves were written since the target was lost, and surely belong to one command."""
        first_ns, second_ns = (register.at_ns for register in self.target)
        are_joined = abs(first_ns - second_ns) <= SURELY_JOINED_MS * MS
        return are_joined and min(first_ns, second_ns) >= self.blocked_ns

    def invalidate_all(self, now_ns: int) -> None:
        """The drive may hold anything."""
        for register in (*self.target, self.mode):
            register.write(None, 0)
        self._begin_mode()
        self.is_blocked, self.blocked_ns = True, now_ns

    def lose(self, request: Parsed, now_ns: int) -> None:
        """Take note that a write was lost: refused, withdrawn, not answered. Its parts count from now."""
        for index in self.touched(request):
            self.target[index].at_ns = now_ns
        self._is_mode_lost |= self.touches_mode(request) and self.layout.style is Style.STICKY
        if self.touched(request) or self.touches_mode(request):
            self.blocked_ns = 0
        self.is_blocked = True
