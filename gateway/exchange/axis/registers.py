"""The register image of an axis: the known content of the registers that decide where its drive goes.

Each command field and limit has a :class:`FieldImage`. It holds the *nominal words*, which the controller
believes to be there, and the *corrected words*, which the drive acknowledged. A :class:`RuleImage` holds the
content of mode and trigger registers and of coils, which of them were lost, and which command field was
written last.

A lost write (refused, withdrawn, unanswered) leaves a field *incomplete*. The controller may believe in that
write or not. So no part of a position may be combined with the earlier content.
:data:`COMPLETENESS_AFTER` says how a lost part changes its field, :data:`NEXT_PART` how the next part is
handled (M1, M3).

Only ``Axis`` and ``exchange.effects`` change an image.
"""

from enum import Enum
from typing import Final

from gateway.drives.motion import Action, MotionPlan
from gateway.modbus.registers import PositionField

JOIN_NS: Final = 200_000_000
"""Masters that write a position word by word do so 20 to 50 ms apart; the next command comes later."""
ALL_WORDS: Final = -1
"""A word mask: every word of a field."""


class Completeness(Enum):
    """Whether the rest of a field may complete a part of it."""

    WHOLE = "whole"
    """No write was lost since the drive acknowledged a complete position."""
    PART_REFUSED = "part-refused"
    """The drive refused a part and proved that it wrote nothing. Its content is known. But no trigger runs it
    until every word is acknowledged again, or one frame writes them all."""
    ALL_LOST = "torn"
    """A write was lost: every word must come again."""
    PARTS_LOST = "parts-lost"
    """Some words came since but never reached the drive: they count if the others follow soon."""
    PARTS_BUFFERED = "parts-buffered"
    """Some words came since and the drive acknowledged them: the others may come later."""


class Loss(Enum):
    """How a part of a position was lost."""

    REFUSED_UNWRITTEN = "refused-unwritten"
    """The drive refused it, with an exception that proves that nothing was written."""
    REFUSED = "refused"
    """The drive refused it and may have written it, or did not answer."""
    DENIED = "denied"
    """The gateway refused it: rights, another writer, travel, lateness, a line that is down."""
    TOO_EARLY = "too-early"
    """The gateway refused it because its field was incomplete, and the drive would have moved with it."""
    WITHDRAWN = "withdrawn"
    """It was not sent, and its controller got no answer, because it did not wait any more."""


COMPLETENESS_AFTER: Final[dict[tuple[Completeness, Loss], Completeness]] = {
    **{(state, Loss.REFUSED_UNWRITTEN): Completeness.ALL_LOST for state in Completeness},
    (Completeness.WHOLE, Loss.REFUSED_UNWRITTEN): Completeness.PART_REFUSED,
    (Completeness.PART_REFUSED, Loss.REFUSED_UNWRITTEN): Completeness.PART_REFUSED,
    **{(state, Loss.REFUSED): Completeness.ALL_LOST for state in Completeness},
    **{(state, Loss.DENIED): Completeness.ALL_LOST for state in Completeness},
    **{(state, Loss.TOO_EARLY): Completeness.PARTS_LOST for state in Completeness},
    **{(state, Loss.WITHDRAWN): Completeness.PARTS_LOST for state in Completeness},
}
"""The state of a field after the loss of a part. A part that was answered with an exception joins no other
one, unless the gateway refused it only because the others were missing."""


class NextPart(Enum):
    """How the next part of a position is handled."""

    COMPLETED = "completed"
    """What the drive holds completes it."""
    JOINED = "joined"
    """The parts that came before complete it. If words are still missing then, it is handled as in
    ``ALL_LOST``."""
    AS_IT_CAME = "as-it-came"
    """It is sent as it came: the drive only holds it, and its trigger is refused until the others came."""
    REFUSED = "refused"
    """Exception 4."""


NEXT_PART: Final[dict[tuple[Completeness, bool, bool], NextPart]] = {
    **{
        (state, waits, heard): found
        for waits in (True, False)
        for heard in (True, False)
        for state, found in (
            (Completeness.WHOLE, NextPart.COMPLETED),
            (Completeness.PART_REFUSED, NextPart.COMPLETED if heard else NextPart.REFUSED),
            (Completeness.ALL_LOST, NextPart.AS_IT_CAME if waits else NextPart.REFUSED),
            (Completeness.PARTS_LOST, NextPart.JOINED),
            (Completeness.PARTS_BUFFERED, NextPart.JOINED),
        )
    }
}
"""By the completeness of the field, whether its drive waits for a trigger, and whether the controller may
have known of the last refusal when it wrote the part. A part that it had pipelined belongs to the refused
command."""


class FieldImage:
    """Words of one command field or limit, in the order of its registers."""

    __slots__ = (
        "_all_words",
        "_heard_ns",
        "_lost_ns",
        "_missing",
        "_parts",
        "_rewritten",
        "_since_ns",
        "_there",
        "_waits",
        "completeness",
        "epoch",
        "may_be_corrected",
        "nominal_words",
    )

    def __init__(self, field: PositionField, *, waits: bool = False) -> None:
        self._waits = waits
        """Whether the drive holds a position until a trigger runs it."""
        self.nominal_words: bytes | None = None
        """What the controller believes the drive holds; None: unknown."""
        self._there: tuple[bytes | None, ...] = ()
        """What the drive acknowledged. Two entries: the rewrite of a target was not acknowledged, so the
        drive holds one of them; None in them: the earlier content was unknown. Empty: unknown."""
        self.completeness = Completeness.WHOLE
        self._all_words = (1 << field.words) - 1
        self._parts = bytearray(2 * field.words)
        """The words that came since a write was lost; ``_missing`` has a bit for each that is still
        missing."""
        self._heard_ns = 0
        """When the controller got the answer that the drive had refused a part."""
        self._missing = self._all_words
        self._since_ns = 0
        self._rewritten: dict[int, bytes] = {}
        """Words that were rewritten one by one while ``corrected_words`` is unknown, by their number."""
        self._lost_ns = 0
        """When the newest lost write had arrived."""
        self.may_be_corrected = False
        """The drive may hold other words than the controller wrote."""
        self.epoch = 0
        """Increases with each lost write: what was sent in an earlier epoch does not replace it."""

    @property
    def corrected_words(self) -> bytes | None:
        """What the drive acknowledged; None: unknown."""
        return self._there[0] if len(self._there) == 1 else None

    @property
    def is_incomplete(self) -> bool:
        """Whether a write was lost and not every word has been acknowledged again."""
        return self.completeness is not Completeness.WHOLE

    @property
    def has_part(self) -> bool:
        """Whether a part of a position has come that other parts must complete."""
        return self.completeness not in (Completeness.WHOLE, Completeness.ALL_LOST)

    def settle(
        self,
        nominal_words: bytes,
        corrected_words: bytes | None,
        epoch: int | None = None,
        written: int = ALL_WORDS,
    ) -> None:
        """Record that the drive holds these words.

        Args:
            nominal_words: what the controller wrote.
            corrected_words: what the drive received; None: unknown.
            epoch: of the field, when they were sent; None: nothing was lost since.
            written: mask of the words in this write; it left the others as they were.
        """
        self.nominal_words = nominal_words
        self._there = () if corrected_words is None else (corrected_words,)
        if self._rewritten:
            self._rewritten.clear()
        self.may_be_corrected = corrected_words != nominal_words
        if epoch is not None and epoch != self.epoch:
            return
        if self.completeness is Completeness.PART_REFUSED:
            self._missing &= ~written
            if self._missing:
                return
        self.completeness = Completeness.WHOLE

    def leave(self, nominal_words: bytes, corrected_words: bytes | None) -> None:
        """Record that these words were sent, and that the drive may hold them or not."""
        self.may_be_corrected = self.may_be_corrected or corrected_words != nominal_words

    def forget(self) -> None:
        """Mark as unknown what the drive holds."""
        self.nominal_words = None
        self.invalidate()
        if self.completeness is Completeness.PART_REFUSED:
            self.completeness = Completeness.ALL_LOST  # nothing is known that could complete the next part

    def invalidate(self) -> None:
        """The drive may hold another target than was sent to it; the controller's view stays the same."""
        self._there = ()
        self._rewritten.clear()

    def invalidate_rewritten(self, corrected_words: bytes) -> None:
        """A rewritten target was not acknowledged: the drive holds the new words, or those from before."""
        either = (self.corrected_words, corrected_words)
        self.invalidate()
        self._there = either

    def means(self, words: bytes) -> bytes | None:
        """Return what the controller wrote, if the read words stand for it; else None."""
        return self.nominal_words if words in self._there else None

    def holds(self, first: int, words: bytes) -> bool:
        """Whether the drive is known to hold these words from word ``first`` on."""
        there = self.corrected_words
        if there is not None:
            return there[2 * first : 2 * first + len(words)] == words
        count = len(words) // 2
        return all(self._rewritten.get(first + i) == words[2 * i : 2 * i + 2] for i in range(count))

    def acknowledge_rewrite(self, nominal_words: bytes, first: int, words: bytes, epoch: int) -> None:
        """Record that the drive acknowledged words of a rewritten target, from word ``first`` on.

        Unknown words stay unknown: the target counts as written when all of them have come.
        """
        count = len(nominal_words) // 2
        there = self.corrected_words
        if there is None:
            self._rewritten.update({first + i: words[2 * i : 2 * i + 2] for i in range(len(words) // 2)})
            if len(self._rewritten) < count:
                self.leave(nominal_words, None)
                return
            there = b"".join([self._rewritten[word] for word in range(count)])
        merged = there[: 2 * first] + words + there[2 * first + len(words) :]
        self.settle(nominal_words, merged, epoch, written=0)

    def lose_all_words(self, arrived_ns: int = 0) -> None:
        """Record that a complete write was lost, and when it had arrived: every word must come again."""
        self._lost_ns = max(self._lost_ns, arrived_ns)
        self.epoch += 1
        self.completeness = Completeness.ALL_LOST
        self._missing = self._all_words

    def next_part(self, arrived_ns: int) -> NextPart:
        """Return how a part that arrived then is handled."""
        return NEXT_PART[self.completeness, self._waits, arrived_ns >= self._heard_ns]

    def base(self, arrived_ns: int) -> bytes | None:
        """Return the content that such a part changes; None: unknown."""
        return self.nominal_words if self.next_part(arrived_ns) is NextPart.COMPLETED else None

    def completed(self, first: int, words: bytes, arrived_ns: int, follows_ns: int) -> bytes | None:
        """Return the complete position after writing ``words`` from word ``first`` on; None: unknown.

        ``follows_ns``: when the request before it arrived on the same connection.
        """
        base = self.base(arrived_ns)
        if self.next_part(arrived_ns) is NextPart.JOINED and self._are_joined(arrived_ns, follows_ns):
            base = None if self._missing & ~_mask(first, words) else bytes(self._parts)
        if base is None:
            return None
        return base[: 2 * first] + words + base[2 * first + len(words) :]

    def _are_joined(self, arrived_ns: int, follows_ns: int) -> bool:
        """Whether a part belongs to those that came before it.

        Parts that never reached the drive belong to one command only if no other request came between them.
        """
        if self.completeness is Completeness.PARTS_BUFFERED:
            return True
        return follows_ns == self._lost_ns and arrived_ns - self._since_ns <= JOIN_NS

    def buffer(self, first: int, words: bytes, arrived_ns: int, follows_ns: int) -> None:
        """Record a part that the drive acknowledged as it came, while the other parts are unknown."""
        self.invalidate()
        covers_all = not self._all_words & ~self._missing & ~_mask(first, words)
        is_new = not self.is_incomplete or covers_all or not self._are_joined(arrived_ns, follows_ns)
        stays_buffered = is_new or self.completeness is Completeness.PARTS_BUFFERED
        if is_new:
            self.lose_all_words()
        self._store_part(first, words, arrived_ns, follows_ns)
        if stays_buffered and self.completeness is Completeness.PARTS_LOST:
            self.completeness = Completeness.PARTS_BUFFERED

    def forget_parts(self) -> None:
        """The connection of some parts broke: parts from another connection do not complete them."""
        if self.completeness is Completeness.PARTS_BUFFERED:
            self.lose_all_words()

    def lose(
        self, loss: Loss, first: int, words: bytes, *, arrived_ns: int, follows_ns: int, now_ns: int
    ) -> None:
        """Record how a part was lost.

        Args:
            loss: how.
            first: its first word.
            words: the words; empty for a mask write (FC22).
            arrived_ns: when it came from its controller. If a newer write was lost before, the part is not
                joined with others: every word must come again.
            follows_ns: when the request before it arrived on the same connection.
            now_ns: when its controller gets the answer.
        """
        after = COMPLETENESS_AFTER[self.completeness, loss]
        if after is Completeness.PART_REFUSED and self.nominal_words is None:
            after = Completeness.ALL_LOST  # nothing is known that could complete the next part
        if after is Completeness.PARTS_LOST and words:
            self._store_part(first, words, arrived_ns, follows_ns)
        elif after is Completeness.PART_REFUSED:
            self._lost_ns = max(self._lost_ns, arrived_ns)
            self.epoch += 1
            self.completeness, self._missing, self._heard_ns = after, self._all_words, now_ns
        else:
            self.lose_all_words(arrived_ns)

    def _store_part(self, first: int, words: bytes, arrived_ns: int, follows_ns: int) -> None:
        """Keep a part for the others that follow."""
        if arrived_ns < self._lost_ns:
            self.lose_all_words()
            return
        is_kept = self.completeness in (Completeness.PARTS_LOST, Completeness.PARTS_BUFFERED)
        if not (is_kept and self._are_joined(arrived_ns, follows_ns)):
            self.lose_all_words()
            self._since_ns = arrived_ns
        self._lost_ns = arrived_ns
        self.epoch += 1
        self.completeness = Completeness.PARTS_LOST
        self._parts[2 * first : 2 * first + len(words)] = words
        self._missing &= ~_mask(first, words)
        if not self._missing:  # all words had come, and were lost
            self.lose_all_words()


def _mask(first: int, words: bytes) -> int:
    return mask_of(first, len(words) // 2)


def mask_of(first: int, count: int) -> int:
    """Return the mask of ``count`` words from word ``first`` on."""
    return ((1 << count) - 1) << first


class RuleImage:
    """Content of mode and trigger registers and of coils, as the drive acknowledged it or as it was read."""

    __slots__ = (
        "_coils",
        "_lost_modes",
        "_words",
        "addresses",
        "coils",
        "following",
        "modes",
        "plan",
        "staged",
    )

    def __init__(self, plan: MotionPlan) -> None:
        self.plan = plan
        self.modes = frozenset(mode.address for mode in plan.modes if mode is not None)
        """Registers that decide what a position means."""
        triggers = {trigger.address for trigger in plan.triggers if not trigger.is_coil}
        self.addresses = tuple(sorted(self.modes | triggers | plan.starts_on))
        """Registers whose writing may have a meaning."""
        self.coils = frozenset(trigger.address for trigger in plan.triggers if trigger.is_coil)
        """Coils that make the drive act."""
        self.following = tuple(trigger for trigger in plan.triggers if trigger.can_follow)
        """Triggers that may make the drive go to each position as it is written."""
        self._words: dict[int, int] = {}
        self._coils: dict[int, int] = {}
        self._lost_modes: dict[int, tuple[int, int]] = {}
        """Mode registers with a lost write: its exception code, and the epoch that began with it."""
        self.staged: int | None = None
        """The command field that a trigger without a number runs."""

    def word(self, address: int) -> int | None:
        """Return the content of a register; None: unknown."""
        return self._words.get(address)

    def coil(self, address: int) -> int | None:
        """Return the state of a coil; None: unknown."""
        return self._coils.get(address)

    def may_go_at_once(self, number: int) -> bool:
        """Whether the drive may go to a position before anything else is written (M2)."""
        for trigger in self.following:
            word = self._words.get(trigger.address)
            if word is None or trigger.holds_unknown(word):
                return True
        return self.goes_at_once(number)

    def goes_at_once(self, number: int) -> bool:
        """Whether the drive certainly does so."""
        if not (self.plan.is_staged or self.plan.starts_on):
            return True  # its triggers only stop it, or move it in another way
        for trigger in self.following:
            word = self._words.get(trigger.address)
            if word is not None and trigger.is_following(word):
                return True
        mode = self.plan.mode(number)
        mode_word = None if mode is None else self._words.get(mode.address)
        return mode is not None and mode_word is not None and mode.action(mode_word) is Action.FOLLOW

    def store_words(self, words: dict[int, int], epoch: int) -> None:
        """Record what the drive acknowledged; ``epoch``: of its axis, when it was sent."""
        self._words.update(words)
        for address in words:
            if self._lost_modes.get(address, (0, 0))[1] <= epoch:
                self._lost_modes.pop(address, None)

    def store_read(self, address: int, word: int) -> None:
        """Record the content of a register that was read."""
        self._words[address] = word

    def store_coils(self, coils: dict[int, int]) -> None:
        """Record the coils that the drive acknowledged."""
        self._coils.update(coils)

    def stage(self, number: int) -> None:
        """Record the command field that was written last."""
        self.staged = number

    def invalidate(self, words: dict[int, int], coils: dict[int, int]) -> None:
        """Mark the content of these registers and coils as unknown."""
        for address in words:
            self._words.pop(address, None)
        for address in coils:
            self._coils.pop(address, None)

    def forget(self) -> None:
        """Mark all register contents as unknown."""
        self._words.clear()
        self._coils.clear()
        self.staged = None

    def lose_mode(self, address: int, code: int, epoch: int) -> None:
        """Record that the write of a mode register was lost; ``epoch``: of the axis, which begins with it."""
        self._lost_modes[address] = (code, epoch)

    def lost_mode(self, number: int | None) -> int | None:
        """Return the exception code with which the mode of a command field was lost, if it was."""
        mode = None if number is None else self.plan.mode(number)
        return None if mode is None else self._lost_modes.get(mode.address, (None, 0))[0]
