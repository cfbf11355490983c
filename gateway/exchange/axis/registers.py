"""The register image of an axis: what is known of the registers that decide where its drive goes.

Of each command field and limit a :class:`FieldImage`: the *nominal words*, which the controller believes
there, and the *corrected words*, which the drive acknowledged. Of mode and trigger registers and of coils a
:class:`RuleImage`: what they hold, which of them were lost, and which command field was written last.

A write that was lost on the way (refused, withdrawn, unanswered) leaves a field *torn*: the controller may
believe in that write or not, so no part of a position may be combined with what stood there before. What a
lost part makes of its field is :data:`COMPLETENESS_AFTER`, what becomes of the next part :data:`NEXT_PART`
(M1, M3).

Only ``Axis`` and ``exchange.effects`` change an image.
"""

from enum import Enum
from typing import Final

from gateway.drives.motion import Action, MotionPlan
from gateway.modbus.registers import PositionField

JOIN_NS: Final = 200_000_000
"""Masters that write a position word by word do so 20 to 50 ms apart; the next command comes later."""
ALL_WORDS: Final = -1
"""As a mask of words: every word of a field."""


class Completeness(Enum):
    """Whether parts of a field may be completed with the rest of it."""

    WHOLE = "whole"
    """No write was lost since the drive acknowledged a whole position."""
    PART_REFUSED = "part-refused"
    """The drive refused a part and proved that it wrote nothing. What it holds is known, but no trigger runs
    it before every word was acknowledged anew, or one frame wrote them all."""
    ALL_LOST = "torn"
    """A write was lost: every word has to come again."""
    PARTS_LOST = "parts-lost"
    """Since then some words came which never reached the drive: they count when the others follow soon."""
    PARTS_BUFFERED = "parts-buffered"
    """Since then some words came which the drive acknowledged: the others need not hurry."""


class Loss(Enum):
    """How a part of a position was lost."""

    REFUSED_UNWRITTEN = "refused-unwritten"
    """The drive refused it, with an exception that proves that nothing was written."""
    REFUSED = "refused"
    """The drive refused it and may have written it, or did not answer."""
    DENIED = "denied"
    """The gateway refused it: rights, another writer, travel, lateness, a line that is down."""
    TOO_EARLY = "too-early"
    """The gateway refused it because its field was torn, and the drive would have moved with it."""
    WITHDRAWN = "withdrawn"
    """It was not sent, and its controller was not told so: that has gone on."""


COMPLETENESS_AFTER: Final[dict[tuple[Completeness, Loss], Completeness]] = {
    **{(state, Loss.REFUSED_UNWRITTEN): Completeness.ALL_LOST for state in Completeness},
    (Completeness.WHOLE, Loss.REFUSED_UNWRITTEN): Completeness.PART_REFUSED,
    (Completeness.PART_REFUSED, Loss.REFUSED_UNWRITTEN): Completeness.PART_REFUSED,
    **{(state, Loss.REFUSED): Completeness.ALL_LOST for state in Completeness},
    **{(state, Loss.DENIED): Completeness.ALL_LOST for state in Completeness},
    **{(state, Loss.TOO_EARLY): Completeness.PARTS_LOST for state in Completeness},
    **{(state, Loss.WITHDRAWN): Completeness.PARTS_LOST for state in Completeness},
}
"""What the loss of a part makes of its field. A part that was answered with an exception joins no other one,
unless the gateway refused it only because the others were missing."""


class NextPart(Enum):
    """What becomes of the next part of a position."""

    COMPLETED = "completed"
    """The rest of it is what the drive holds."""
    JOINED = "joined"
    """The rest of it are the parts that came before; where they do not make a whole, it is as in TORN."""
    AS_IT_CAME = "as-it-came"
    """It goes out as it came: the drive only holds it, and its trigger is refused until the others came."""
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
"""By field, whether its drive waits for a trigger, and whether the controller may have heard of the last
refusal when it wrote the part: one that it had pipelined belongs to the command that was refused."""


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
        """What the controller believes the drive holds; None: not known."""
        self._there: tuple[bytes | None, ...] = ()
        """What the drive acknowledged. Two: it holds one of them, for a target was written anew and that was
        not acknowledged; None among them: what stood there was not known. Empty: not known."""
        self.completeness = Completeness.WHOLE
        self._all_words = (1 << field.words) - 1
        self._parts = bytearray(2 * field.words)
        """The words that came since a write was lost; which of them still miss is a bit in ``_missing``."""
        self._heard_ns = 0
        """When the controller was told of a part that the drive refused."""
        self._missing = self._all_words
        self._since_ns = 0
        self._rewritten: dict[int, bytes] = {}
        """Words that were written anew one by one while ``corrected_words`` is not known, by their number."""
        self._lost_ns = 0
        """When the newest write that was lost had come."""
        self.may_be_corrected = False
        """The drive may hold other words than the controller wrote."""
        self.epoch = 0
        """Goes up with each write that was lost: what was sent in an earlier one does not make up for it."""

    @property
    def corrected_words(self) -> bytes | None:
        """What the drive acknowledged; None: not known."""
        return self._there[0] if len(self._there) == 1 else None

    @property
    def is_incomplete(self) -> bool:
        """Whether a write was lost and not every word has been acknowledged anew since."""
        return self.completeness is not Completeness.WHOLE

    def settle(
        self,
        nominal_words: bytes,
        corrected_words: bytes | None,
        epoch: int | None = None,
        written: int = ALL_WORDS,
    ) -> None:
        """Note that the drive holds these words.

        Args:
            nominal_words: what the controller wrote.
            corrected_words: what the drive was told; None: that is not known.
            epoch: of the field, when they were sent; None: nothing has been lost since.
            written: mask of the words that the controller wrote with that; the others it left as they were.
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
        """Note that these words were sent, and that nobody knows whether the drive holds them."""
        self.may_be_corrected = self.may_be_corrected or corrected_words != nominal_words

    def forget(self) -> None:
        """Nobody knows any more what the drive holds."""
        self.nominal_words = None
        self.invalidate()
        if self.completeness is Completeness.PART_REFUSED:
            self.completeness = Completeness.ALL_LOST  # the next part has nothing to be completed from

    def invalidate(self) -> None:
        """The drive may hold another target than it was told; what the controller believes stays."""
        self._there = ()
        self._rewritten.clear()

    def invalidate_rewritten(self, corrected_words: bytes) -> None:
        """A target was written anew, and not acknowledged: the drive holds it so, or as before."""
        either = (self.corrected_words, corrected_words)
        self.invalidate()
        self._there = either

    def means(self, words: bytes) -> bytes | None:
        """Return what the controller wrote, where words that were read stand for that; else None."""
        return self.nominal_words if words in self._there else None

    def holds(self, first: int, words: bytes) -> bool:
        """Whether the drive is known to hold these words from word ``first`` on."""
        there = self.corrected_words
        if there is not None:
            return there[2 * first : 2 * first + len(words)] == words
        count = len(words) // 2
        return all(self._rewritten.get(first + i) == words[2 * i : 2 * i + 2] for i in range(count))

    def acknowledge_rewrite(self, nominal_words: bytes, first: int, words: bytes, epoch: int) -> None:
        """Note that the drive acknowledged words of a target that was written anew, from word ``first`` on.

        A word that is not known stays so: the target counts as written once each of them came.
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
        """Note that a whole write was lost, and when it had come: every word has to come again."""
        self._lost_ns = max(self._lost_ns, arrived_ns)
        self.epoch += 1
        self.completeness = Completeness.ALL_LOST
        self._missing = self._all_words

    def next_part(self, arrived_ns: int) -> NextPart:
        """Return what becomes of a part that came then."""
        return NEXT_PART[self.completeness, self._waits, arrived_ns >= self._heard_ns]

    def base(self, arrived_ns: int) -> bytes | None:
        """Return the words that a part which came then leaves as they are; None: not known."""
        return self.nominal_words if self.next_part(arrived_ns) is NextPart.COMPLETED else None

    def completed(self, first: int, words: bytes, arrived_ns: int, follows_ns: int) -> bytes | None:
        """Return the whole position once ``words`` are written from word ``first`` on; None if not known.

        ``follows_ns``: when the request before it came on the same connection.
        """
        base = self.base(arrived_ns)
        if self.next_part(arrived_ns) is NextPart.JOINED and self._are_joined(arrived_ns, follows_ns):
            base = None if self._missing & ~_mask(first, words) else bytes(self._parts)
        if base is None:
            return None
        return base[: 2 * first] + words + base[2 * first + len(words) :]

    def _are_joined(self, arrived_ns: int, follows_ns: int) -> bool:
        """Whether a part belongs to those that came before it.

        Those that never reached the drive belong to one command only where nothing came between them.
        """
        if self.completeness is Completeness.PARTS_BUFFERED:
            return True
        return follows_ns == self._lost_ns and arrived_ns - self._since_ns <= JOIN_NS

    def buffer(self, first: int, words: bytes, arrived_ns: int, follows_ns: int) -> None:
        """Note a part that the drive acknowledged as it came, while the other parts are not known."""
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
        """The connection of some parts broke off: nothing that comes on another one completes them."""
        if self.completeness is Completeness.PARTS_BUFFERED:
            self.lose_all_words()

    def lose(
        self, loss: Loss, first: int, words: bytes, *, arrived_ns: int, follows_ns: int, now_ns: int
    ) -> None:
        """Note how a part was lost.

        Args:
            loss: how.
            first: its first word.
            words: the words; empty where they are a mask over one that is known.
            arrived_ns: when it came from its controller: of a loss that shows later than that of a newer
                write nothing counts.
            follows_ns: when the request before it came on the same connection.
            now_ns: when its controller is told.
        """
        after = COMPLETENESS_AFTER[self.completeness, loss]
        if after is Completeness.PART_REFUSED and self.nominal_words is None:
            after = Completeness.ALL_LOST  # nothing is there that the next part could be completed from
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
        if not self._missing:  # all of it was there, and was lost as a whole
            self.lose_all_words()


def _mask(first: int, words: bytes) -> int:
    return mask_of(first, len(words) // 2)


def mask_of(first: int, count: int) -> int:
    """Return the mask of so many words from word ``first`` on."""
    return ((1 << count) - 1) << first


class RuleImage:
    """What mode and trigger registers and coils hold, as the drive acknowledged it or was read to hold."""

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
        """Registers whose writing may mean something."""
        self.coils = frozenset(trigger.address for trigger in plan.triggers if trigger.is_coil)
        """Coils that make the drive act."""
        self.following = tuple(trigger for trigger in plan.triggers if trigger.can_follow)
        """What may make the drive go to each position as it is written."""
        self._words: dict[int, int] = {}
        self._coils: dict[int, int] = {}
        self._lost_modes: dict[int, tuple[int, int]] = {}
        """Mode registers whose writing was lost: its exception code, and the epoch that began with it."""
        self.staged: int | None = None
        """The command field that a trigger without a number runs."""

    def word(self, address: int) -> int | None:
        """Return the content of a register, as far as it is known."""
        return self._words.get(address)

    def coil(self, address: int) -> int | None:
        """Return the state of a coil, as far as it is known."""
        return self._coils.get(address)

    def may_go_at_once(self, number: int) -> bool:
        """Whether a position that is written now may be gone to before anything else is written (M2)."""
        for trigger in self.following:
            word = self._words.get(trigger.address)
            if word is None or trigger.is_following(word) or trigger.holds_unknown(word):
                return True
        mode = self.plan.mode(number)
        mode_word = None if mode is None else self._words.get(mode.address)
        return mode is not None and mode_word is not None and mode.action(mode_word) is Action.FOLLOW

    def store_words(self, words: dict[int, int], epoch: int) -> None:
        """Note what the drive acknowledged; ``epoch``: of its axis, when it was sent."""
        self._words.update(words)
        for address in words:
            if self._lost_modes.get(address, (0, 0))[1] <= epoch:
                self._lost_modes.pop(address, None)

    def store_read(self, address: int, word: int) -> None:
        """Note what a register was read to hold."""
        self._words[address] = word

    def store_coils(self, coils: dict[int, int]) -> None:
        """Note which coils the drive acknowledged."""
        self._coils.update(coils)

    def stage(self, number: int) -> None:
        """Note the command field that was written last."""
        self.staged = number

    def invalidate(self, words: dict[int, int], coils: dict[int, int]) -> None:
        """Note that what these registers and coils hold is not known any more."""
        for address in words:
            self._words.pop(address, None)
        for address in coils:
            self._coils.pop(address, None)

    def forget(self) -> None:
        """Nobody knows any more what the drive's registers hold."""
        self._words.clear()
        self._coils.clear()
        self.staged = None

    def lose_mode(self, address: int, code: int, epoch: int) -> None:
        """Note that the writing of a mode register was lost; ``epoch``: of the axis, which begins with it."""
        self._lost_modes[address] = (code, epoch)

    def lost_mode(self, number: int | None) -> int | None:
        """Return the exception code with which the mode of a command field was lost, if it was."""
        mode = None if number is None else self.plan.mode(number)
        return None if mode is None else self._lost_modes.get(mode.address, (None, 0))[0]
