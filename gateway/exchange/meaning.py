"""What one request means for one axis: the move, stop or homing it starts, and the modes it sets (M2).

There are two steps. A :class:`Frame` is what its bytes say: it is parsed once, when that is asked for first,
and never changes, for the registers of a unit are the same as long as the line runs. Its meaning hangs on
more: on what the drive acknowledged before it, which may change while it waits, and on what is read for it.
So it is judged (:func:`meanings`) when its turn comes, once for each frame that goes out for it
(``request.understand``); besides only where it has to be known what it stops, or whom it would move.

Nothing is changed here.
"""

from collections.abc import Mapping
from typing import Final

from gateway.drives.motion import NOTHING_DONE, Action, Deed, ModePlan
from gateway.exchange.access import Access
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.axis_request import Command
from gateway.exchange.unit import AxisHits, FieldHit, RuleHit, UnitMap

NO_ACCESS: Final = Access()
NOTHING_READ: Final[Mapping[str, Mapping[int, int | None]]] = {}

PRECEDENCE: Final = (
    Action.STOP,
    Action.HOME,
    Action.SET_POSITION,
    Action.STORED,
    Action.UNKNOWN,
    Action.FOLLOW,
    Action.ABSOLUTE,
    Action.RELATIVE,
    Action.RELATIVE_TO_COMMANDED,
    Action.RELATIVE_TO_ACTUAL,
    Action.START,
    Action.OTHER_MOTION,
    Action.FOLLOW_NEXT,
    Action.IGNORE,
)
"""Which one counts where a request does several things to one axis."""
_RANK: Final = {action: rank for rank, action in enumerate(PRECEDENCE)}
_RANK_OF_LETTING_GO: Final = _RANK[Action.OTHER_MOTION] + 0.5
"""A jog let go of in the frame that starts something else is no stop of that."""


class Meaning(Command):
    """The same with the axis, and where its positions stand in the request."""

    __slots__ = ("axis", "commands", "needs_word")

    def __init__(
        self,
        *,
        axis: Axis,
        commands: tuple[FieldHit, ...],
        needs_word: int | None,
        action: Action,
        number: int | None,
        words: Mapping[int, int],
        coils: Mapping[int, int],
        unclear_words: frozenset[int],
        is_doubtful: bool,
        sets_position_too: bool = False,
    ) -> None:
        super().__init__(
            action=action,
            number=number,
            words=words,
            coils=coils,
            unclear_words=unclear_words,
            written=tuple(hit.place.number for hit in commands),
            modes_written=tuple(sorted(axis.rules.modes.intersection((*words, *unclear_words)))),
            epoch=axis.interlock.epoch,
            is_doubtful=is_doubtful,
            sets_position_too=sets_position_too,
        )
        self.axis = axis
        self.commands = commands
        """The command fields that it writes."""
        self.needs_word = needs_word
        """A mode or trigger register that must be read before the meaning is known."""

    @property
    def running(self) -> tuple[FieldHit, ...]:
        """The command fields that it writes and runs."""
        if not self.action.runs_target:
            return ()
        if self.axis.plan.motion.waits_for_trigger:
            return tuple(hit for hit in self.commands if hit.place.number == self.number)
        return self.commands


class Frame:
    """A request to one unit, as its bytes say: which registers and coils it touches, by axis."""

    __slots__ = ("access", "by_axis", "coils", "is_clear", "pdu", "unit")

    def __init__(self, unit: UnitMap, pdu: bytes, access: Access, coils: Mapping[int, int]) -> None:
        self.unit = unit
        self.pdu = pdu
        self.access = access
        self.coils = coils
        """The coils that it writes, with their values."""
        written = unit.written(access.write_address, access.write_quantity)
        self.is_clear = not written.is_unclear
        """False: it writes over an object of unknown width into a mapped one."""
        self.by_axis = written.by_axis
        """What it writes of each axis that it touches; a request that writes coils writes no registers."""
        if coils:
            self.by_axis += tuple(
                [AxisHits(axis) for axis in unit.axes if axis.rules.coils.intersection(coils)]
            )


def meanings(
    frame: Frame,
    read_words: Mapping[str, Mapping[int, int | None]] = NOTHING_READ,
    *,
    may_have_risen: bool = False,
) -> list[Meaning]:
    """Return what a request means for each axis of its unit that it means something to.

    Args:
        frame: the request.
        read_words: mode and trigger registers that were read for this request, by axis and address; None
            where one would not tell.
        may_have_risen: take every bit that is set as one that rises.
    """
    found = []
    for hits in frame.by_axis:
        read = read_words.get(hits.axis.plan.name, {})
        meaning = _Reading(frame, hits, read, may_have_risen=may_have_risen).meaning()
        if meaning is not None:
            found.append(meaning)
    return found


class _Reading:
    """One request, looked at for one axis."""

    def __init__(
        self, frame: Frame, hits: AxisHits, read_words: Mapping[int, int | None], *, may_have_risen: bool
    ) -> None:
        axis = hits.axis
        self.axis = axis
        self.plan = axis.plan.motion
        self.access = frame.access
        self.read_words = read_words
        self.may_have_risen = may_have_risen
        self.commands = hits.commands
        self.sets_position = hits.sets_position
        self.words: dict[int, int] = {}
        self.unclear: set[int] = set()
        self.certain_bits: dict[int, tuple[int, int]] = {}
        """Of registers that are only partly known after a mask: their content, and which bits are certain."""
        if hits.rules:
            data = frame.access.words(frame.pdu)
            for hit in hits.rules:
                self._note_word(hit, data)
        self.is_doubtful = any(
            trigger.rising & self.words.get(trigger.address, 0) and axis.rules.word(trigger.address) is None
            for trigger in self.plan.triggers
            if not trigger.is_coil
        )
        self.coils: dict[int, int] = {}
        if frame.coils:
            own = axis.rules.coils
            self.coils = {address: value for address, value in frame.coils.items() if address in own}

    def _note_word(self, hit: RuleHit, data: bytes) -> None:
        if not self.access.is_consistent or len(data) < 2 * hit.word + 2:
            self.unclear.add(hit.address)
            return
        word = data[2 * hit.word] << 8 | data[2 * hit.word + 1]
        if self.access.is_mask:
            before = self.axis.rules.word(hit.address)
            and_mask, or_mask = word, data[2] << 8 | data[3]
            word = ((before or 0) & and_mask) | (or_mask & ~and_mask & 0xFFFF)
            if before is None and and_mask:
                self.unclear.add(hit.address)
                self.certain_bits[hit.address] = (word, ~and_mask & 0xFFFF)
                return
        self.words[hit.address] = word

    def meaning(self) -> Meaning | None:
        if not (self.commands or self.words or self.unclear or self.coils or self.sets_position):
            return None
        deeds = self._deeds()
        deed = min(deeds, key=_rank, default=NOTHING_DONE)
        if deed.action is Action.STOP:
            sets_position = any(each.action is Action.SET_POSITION for each in deeds)
            return self._meaning(Action.STOP, None, sets_position_too=sets_position)
        following = self._unknown_following()
        if following is not None:
            return self._meaning(Action.UNKNOWN, None, needs_word=following)
        if deed.action is Action.FOLLOW_NEXT:
            deed = Deed(Action.FOLLOW) if self.commands else NOTHING_DONE
        if not deed.action.runs_target:
            return self._meaning(deed.action, None)
        number = self._number(deed)
        mode = None if number is None else self.plan.mode(number)
        if mode is None:
            return self._meaning(_run_as(deed.action, Action.ABSOLUTE), number)
        word = self._mode_word(mode)
        if word is not None:
            return self._meaning(_run_as(deed.action, mode.action(word)), number)
        is_asked = mode.is_in_frame or mode.address in self.read_words or mode.address in self.unclear
        if is_asked or not self.axis.may_read:
            return self._meaning(Action.UNKNOWN, number)
        return self._meaning(Action.UNKNOWN, number, needs_word=mode.address)

    def _meaning(
        self,
        action: Action,
        number: int | None,
        needs_word: int | None = None,
        *,
        sets_position_too: bool = False,
    ) -> Meaning:
        return Meaning(
            axis=self.axis,
            commands=self.commands,
            needs_word=needs_word,
            action=action,
            number=number,
            words=self.words,
            coils=self.coils,
            unclear_words=frozenset(self.unclear),
            is_doubtful=action.runs_target and self.is_doubtful,
            sets_position_too=sets_position_too,
        )

    def _deeds(self) -> list[Deed]:
        rules = self.axis.rules
        before = (lambda _: None) if self.may_have_risen else rules.word
        deeds = []
        for trigger in self.plan.triggers:
            if trigger.is_coil:
                if trigger.address in self.coils:
                    deeds.append(trigger.deed(self.coils[trigger.address], rules.coil(trigger.address)))
            elif trigger.block is not None and trigger.block != self.access.write_address:
                continue
            elif trigger.address in self.words:
                deeds.append(trigger.deed(self.words[trigger.address], before(trigger.address)))
            elif trigger.address in self.unclear:
                word, certain = self.certain_bits.get(trigger.address, (0, 0))
                is_certain = not (trigger.mask | trigger.rising) & ~certain
                if is_certain:
                    deeds.append(trigger.deed(word, None))
                else:
                    is_stop = trigger.stops_surely(word, certain)
                    deeds.append(Deed(Action.STOP if is_stop else Action.UNKNOWN))
        if self.sets_position:
            deeds.append(Deed(Action.SET_POSITION))
        if any(address in self.words or address in self.unclear for address in self.plan.starts_on) or (
            self.commands and self._moves_at_once()
        ):
            deeds.append(Deed(Action.START))
        if self.commands and self._may_follow():
            deeds.append(Deed(Action.UNKNOWN))
        if any(self._sets_other_motion(mode) for mode in self.plan.modes if mode is not None):
            deeds.append(Deed(Action.OTHER_MOTION))
        return deeds

    def _sets_other_motion(self, mode: ModePlan) -> bool:
        """Whether a mode is set in which the drive moves without targets, perhaps at once."""
        word = self.words.get(mode.address)
        return word is not None and mode.action(word) is Action.OTHER_MOTION

    def _unknown_following(self) -> int | None:
        """Return a trigger register that decides whether a position moves at once, and is not known."""
        if not self.commands or not self.axis.may_read:
            return None
        asked = self.unclear | set(self.read_words)
        for trigger in self.axis.rules.following:
            if trigger.address not in asked and self._known(trigger.address) is None:
                return trigger.address
        return None

    def _known(self, address: int) -> int | None:
        """Return the content of a register as it is, or as this request leaves it."""
        if address in self.words:
            return self.words[address]
        known = self.axis.rules.word(address)
        return self.read_words.get(address) if known is None else known

    def _may_follow(self) -> bool:
        """Whether a register that may make the drive go to each position holds nobody knows what."""
        for trigger in self.axis.rules.following:
            word = self._known(trigger.address)
            if word is None or trigger.holds_unknown(word):
                return True
        return False

    def _is_following(self) -> bool:
        """Whether the drive goes to each position as soon as it is written."""
        for trigger in self.axis.rules.following:
            word = self._known(trigger.address)
            if word is not None and trigger.is_following(word):
                return True
        return False

    def _moves_at_once(self) -> bool:
        """Whether a written position is gone to without anything else."""
        if not (self.plan.is_staged or self.plan.starts_on) or self._is_following():
            return True
        mode = self.plan.mode(self.commands[0].place.number)
        word = None if mode is None else self._mode_word(mode)
        return mode is not None and word is not None and mode.action(word) is Action.FOLLOW

    def _number(self, deed: Deed) -> int | None:
        if deed.number is not None:
            return deed.number
        if self.commands:
            return self.commands[0].place.number
        if self.axis.rules.staged is not None:
            return self.axis.rules.staged
        return 0 if len(self.axis.plan.command) == 1 else None

    def _mode_word(self, mode: ModePlan) -> int | None:
        if mode.address in self.unclear or (mode.is_in_frame and mode.address not in self.words):
            return None
        return self._known(mode.address)


def _rank(deed: Deed) -> float:
    return _RANK_OF_LETTING_GO if deed.is_letting_go else _RANK[deed.action]


def _run_as(trigger: Action, mode: Action) -> Action:
    """Return what running a target amounts to, with what the trigger and what the mode say."""
    if not mode.runs_target:
        return mode
    if trigger is Action.START or (trigger is Action.FOLLOW and mode.is_relative):
        return Action.ABSOLUTE if mode is Action.START else mode
    return trigger
