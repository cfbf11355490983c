"""What a request means for an axis: which target runs, which one waits, what stops or homes it (M2).

What makes a target run
=======================

Two things decide: the drive's profile (``drives.motion.MotionPlan``) and what the frame writes. One frame may
do several things to an axis. Each line below that applies is one of them. If none applies, nothing moves
(``IGNORE``).

==============================================================  =============================================
the frame writes                                                meaning
==============================================================  =============================================
a value of a trigger (a register or a coil)                     what the profile says of that value, or of
                                                                every value that it does not name
the same, where the trigger acts on a rising bit                that value's action, if the bit was 0 or is
                                                                unknown; a stop needs no rising bit
bits of a trigger (FC22), while its other bits are unknown      the action of the value, if the written bits
                                                                decide it; else a stop, if it can only be a
                                                                stop; else ``UNKNOWN``
a trigger that counts only in frames from its ``block`` on,     nothing
in another frame
a register of ``starts_on``, with any value                     ``START``
a command field of a drive that is not staged and has no        ``START``
register in ``starts_on``: the drive moves immediately
a command field, while a trigger register holds a value that    ``START``
means ``FOLLOW`` or ``FOLLOW_NEXT``, or its mode means
``FOLLOW``
a command field, while the content of a trigger register that   ``UNKNOWN``
could hold such a value is unknown
an actual position that can be set                              ``SET_POSITION``
a mode in which the drive moves without targets                 ``OTHER_MOTION``
==============================================================  =============================================

If several apply, the first in :data:`PRECEDENCE` counts, which begins with the stop. Beside a stop nothing
else in the frame counts. ``START`` runs a target as its mode says. ``FOLLOW`` runs that target, and later
each one as soon as it is written. ``FOLLOW_NEXT`` does not run the present target, only those that are
written later: if the frame itself writes one, it means ``FOLLOW``, else nothing.
``STORED`` runs a position that the drive stores.

A trigger register that may follow must be known before a command field counts. If it is not, and the gateway
may read, it is read first (``prerequisites``). Unknown words of an earlier target do not matter for that.

*Which target.* The command field that the value names. Else the first one that the frame writes. Else the one
that was written last.

*Which move.* The mode of that field decides, with the content that the frame leaves in it:

======================  ==================================  ==================================================
the trigger means       the mode means                      the action
======================  ==================================  ==================================================
anything that runs      something that runs no target       that of the mode
``START``               a move                              that of the mode; if it is ``START``, absolute
``FOLLOW``              a distance                          that of the mode
a move                  a move                              that of the trigger
anything that runs      no mode is mapped                   that of the trigger; if it is ``START``, absolute
anything that runs      unknown                             it is read first; ``UNKNOWN`` if the gateway may
                                                            not read, or the drive does not answer
anything that runs      a mode that counts only together    ``UNKNOWN``
                        with its position, which is not in
                        the frame
======================  ==================================  ==================================================

*What runs.* If a drive is staged, or has a trigger or a register in ``starts_on``, only the one target above
runs; any other command field in the frame waits in the drive. With any other drive, each command field that
the frame writes runs.

Decoding has two steps. A :class:`DecodedRequest` is the content of the bytes. It is parsed once, because the
registers of a unit do not change while the line runs. Its commands depend on more: on what the drive has
acknowledged, and on what was read for the request. So :func:`decode` is called when it is the request's turn,
once for each frame that is sent for it (``request.understand``). It is also called wherever the gateway must
know what a request stops or moves.

Nothing is changed here.
"""

from collections.abc import Mapping
from typing import Final, NamedTuple

from gateway.drives.motion import NOTHING_DONE, Action, ModePlan, Operation
from gateway.exchange.access import Access
from gateway.exchange.axis.acknowledge import Rendering
from gateway.exchange.axis.axis import Axis
from gateway.exchange.axis.registers import ALL_WORDS, FieldImage
from gateway.exchange.unit import AxisHits, FieldHit, RuleHit, UnitMap

NO_ACCESS: Final = Access()
NOTHING_READ: Final[Mapping[str, Mapping[int, int | None]]] = {}

PRECEDENCE: Final = (
    Operation(Action.STOP),
    Operation(Action.HOME),
    Operation(Action.SET_POSITION),
    Operation(Action.STORED),
    Operation(Action.UNKNOWN),
    Operation(Action.FOLLOW),
    Operation(Action.ABSOLUTE),
    Operation(Action.RELATIVE),
    Operation(Action.RELATIVE_TO_COMMANDED),
    Operation(Action.RELATIVE_TO_ACTUAL),
    Operation(Action.START),
    Operation(Action.OTHER_MOTION),
    Operation(Action.STOP, is_letting_go=True),  # releasing a jog in a frame that starts something is no stop
    Operation(Action.FOLLOW_NEXT),
    Operation(Action.IGNORE),
)
"""Which command counts if a request does several things to one axis."""
_RANK: Final = {
    (operation.action, operation.is_letting_go): rank for rank, operation in enumerate(PRECEDENCE)
}


class DecodedRequest:
    """A request to one unit, by its bytes: which registers and coils it touches, by axis."""

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


# --- one request to one axis -------------------------------------------------------------------------------


class FieldWrite(NamedTuple):
    """A command field that a request writes, in full or in part."""

    hit: FieldHit
    words: bytes | None
    """All its nominal words after the request; None: unknown."""
    is_run: bool
    """The drive moves there with this request; False: it only holds the position."""


class Part(NamedTuple):
    """What a request writes of one command field or limit."""

    image: FieldImage
    first: int
    """Its first word; -1: the whole field, or a write after which nothing of it is certain."""
    words: bytes
    """Empty for a mask write (FC22), which changes one word."""


class Staging(NamedTuple):
    """Words of a command field or limit that the drive holds and does not run."""

    image: FieldImage
    nominal_words: bytes
    corrected_words: bytes | None
    """None: it is unknown what the drive holds."""
    epoch: int
    """Epoch of the field when it was sent."""
    written: int = ALL_WORDS
    """Mask of the words that the controller wrote."""


NO_RUNS: Final[Mapping[str, Rendering]] = {}
NOTHING_WRITTEN: Final[Mapping[int, int]] = {}


class AxisCommand:
    """What one request does to one axis: its meaning, what it writes, and what is sent for it.

    :func:`decode` sets its meaning, ``request.understand`` what it writes, ``prepare`` what is sent.
    ``effects`` applies its end to the axis.
    """

    __slots__ = (
        "action",
        "axis",
        "buffered_parts",
        "coils",
        "epoch",
        "epochs",
        "goes_unknown",
        "hits",
        "is_again",
        "is_doubtful",
        "is_stop",
        "is_uncorrected",
        "modes_written",
        "needs_word",
        "number",
        "partly_written",
        "parts",
        "peer_runs",
        "remaps",
        "runs",
        "runs_alone",
        "runs_target",
        "sets_position_too",
        "stagings",
        "targets",
        "unclear_words",
        "untracked",
        "words",
        "writes",
        "written",
    )

    def __init__(
        self,
        axis: Axis,
        action: Action = Action.IGNORE,
        number: int | None = None,
        hits: tuple[FieldHit, ...] = (),
        *,
        words: Mapping[int, int] = NOTHING_WRITTEN,
        coils: Mapping[int, int] = NOTHING_WRITTEN,
        unclear_words: frozenset[int] = frozenset(),
        needs_word: int | None = None,
        is_doubtful: bool = False,
        sets_position_too: bool = False,
    ) -> None:
        # --- its meaning
        self.axis = axis
        self.action = action
        """IGNORE if nothing moves; never START: the mode replaces that."""
        self.number = number
        """The command field that runs, if the action runs a target; also if its mode is unknown."""
        self.hits = hits
        """The command fields that it writes."""
        self.written = tuple([hit.mapped.number for hit in hits])
        """Their numbers."""
        self.words = words
        """Mode and trigger registers, as the request leaves them."""
        self.coils = coils
        self.unclear_words = unclear_words
        """Mode and trigger registers whose content is unknown after the request."""
        self.modes_written = tuple(sorted(axis.rules.modes.intersection((*self.words, *unclear_words))))
        """Registers that it writes and that decide what a position means."""
        self.needs_word = needs_word
        """A mode or trigger register that must be read before the meaning is known."""
        self.is_doubtful = is_doubtful
        """It sets a bit that starts the motion, and it is unknown whether the bit was set before."""
        self.sets_position_too = sets_position_too
        """A stop that also sets the drive's position."""
        self.is_stop = action is Action.STOP
        """It must never be refused or late (M3)."""
        self.runs_target = action.runs_target
        """It starts a move to a position that this request or an earlier one wrote."""
        self.runs_alone = self.runs_target and number not in self.written
        """It runs a target that an earlier request wrote."""
        self.epoch = axis.interlock.epoch
        # --- what it writes
        self.writes: list[FieldWrite] = []
        self.partly_written: list[FieldImage] = []
        """Fields written in part where parts do not exist: addresses are commands, or objects."""
        self.is_again = False
        """It only repeats the target that the drive already has (M4)."""
        # --- what is sent
        self.targets: list[Rendering] = []
        """Targets in this request to which the drive goes."""
        self.runs: list[Rendering] = []
        """Targets to which the drive goes and that it held already."""
        self.epochs: dict[int, int] = {}
        """Epoch of the field of each of these targets when the request was sent, by field number."""
        self.stagings: list[Staging] = []
        self.parts: list[Part] = []
        """All that it writes of command fields."""
        self.buffered_parts: list[Part] = []
        """Parts of staged targets whose other parts are unknown: they pass as they come (M1)."""
        self.untracked: list[FieldImage] = []
        """Command fields that were written 1:1 in a way that leaves their content unknown."""
        self.goes_unknown = False
        """The axis goes to an unknown position: a distance passed unchanged."""
        self.is_uncorrected = False
        """It goes there by a frame that stops another axis, with words that were not corrected for it."""
        self.peer_runs = NO_RUNS
        """Targets that the other axes of its group hold and must run, by their names (M11)."""
        self.remaps = False
        """It writes a register that remaps other registers."""

    # --- its meaning

    @property
    def is_empty(self) -> bool:
        """Whether the request has no meaning for the axis, even if it writes a limit of it."""
        is_anything = self.hits or self.words or self.coils or self.unclear_words
        return self.action is Action.IGNORE and not is_anything

    @property
    def is_idle(self) -> bool:
        """Whether it neither moves the axis nor changes a target or what one means."""
        return self.action is Action.IGNORE and not (self.written or self.writes_mode)

    @property
    def runs_stored(self) -> bool:
        """Whether it runs a position that the drive stores, or may do so."""
        return self.action is Action.STORED or (
            self.action is Action.UNKNOWN and self.number is not None and self.number not in self.written
        )

    @property
    def writes_mode(self) -> bool:
        """Whether it sets a register that decides what a position means."""
        return bool(self.modes_written)

    @property
    def running(self) -> tuple[FieldHit, ...]:
        """The command fields that it writes and runs."""
        if not self.runs_target:
            return ()
        if self.axis.waits_for_trigger:
            return tuple([hit for hit in self.hits if hit.mapped.number == self.number])
        return self.hits

    # --- what is sent

    def go_anywhere(self) -> None:
        """Mark the position to which the axis goes as unknown."""
        self.goes_unknown = True

    def run_uncorrected(self) -> None:
        """Mark that the axis goes somewhere with words that were not corrected for it."""
        self.goes_unknown = self.is_uncorrected = True

    def forget_targets(self) -> None:
        """Drop the rendered targets, because they are not what is sent."""
        self.targets.clear()
        self.stagings.clear()

    @property
    def is_run_known(self) -> bool:
        """Whether a trigger ran a target whose end is known."""
        return any(run.move is not None or not any(run.nominal_words) for run in self.runs)

    @property
    def sends_somewhere(self) -> bool:
        """Whether it makes the axis go to a position."""
        return bool(self.targets or self.runs or self.untracked)


# --- meaning -----------------------------------------------------------------------------------------------


def decode(
    frame: DecodedRequest,
    read_words: Mapping[str, Mapping[int, int | None]] = NOTHING_READ,
    *,
    may_have_risen: bool = False,
) -> list[AxisCommand]:
    """Return what a request means for each axis of its unit; axes without a meaning are left out.

    Args:
        frame: the request.
        read_words: mode and trigger registers that were read for this request, by axis and address; None: the
            drive did not answer.
        may_have_risen: treat every set bit as a rising one.
    """
    if not frame.unit.has_rules:  # in a unit without triggers and modes each command field runs
        return [
            AxisCommand(hits.axis, Action.ABSOLUTE, hits.commands[0].mapped.number, hits.commands)
            for hits in frame.by_axis
            if hits.commands
        ]
    found = []
    for hits in frame.by_axis:
        read = read_words.get(hits.axis.plan.name, {})
        command = _Decoder(frame, hits, read, may_have_risen=may_have_risen).command()
        if command is not None:
            found.append(command)
    return found


class _Decoder:
    """Decodes one request for one axis."""

    def __init__(
        self,
        frame: DecodedRequest,
        hits: AxisHits,
        read_words: Mapping[int, int | None],
        *,
        may_have_risen: bool,
    ) -> None:
        axis = hits.axis
        self.axis = axis
        self.plan = axis.plan.motion
        self.access = frame.access
        self.read_words = read_words
        self.may_have_risen = may_have_risen
        self.hits = hits.commands
        self.sets_position = hits.sets_position
        self.words: dict[int, int] = {}
        self.unclear: set[int] = set()
        self.certain_bits: dict[int, tuple[int, int]] = {}
        """Registers that are only partly known after a mask: their content, and which bits are certain."""
        if hits.rules:
            data = frame.access.words(frame.pdu)
            for hit in hits.rules:
                self._add_word(hit, data)
        self.is_doubtful = any(
            trigger.rising & self.words.get(trigger.address, 0) and axis.rules.word(trigger.address) is None
            for trigger in self.plan.triggers
            if not trigger.is_coil
        )
        self.coils: dict[int, int] = {}
        if frame.coils:
            own = axis.rules.coils
            self.coils = {address: value for address, value in frame.coils.items() if address in own}

    def _add_word(self, hit: RuleHit, data: bytes) -> None:
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

    def command(self) -> AxisCommand | None:
        """Return what the request means; None: nothing."""
        if not (self.hits or self.words or self.unclear or self.coils or self.sets_position):
            return None
        operations = self._operations()
        operation = min(operations, key=_rank, default=NOTHING_DONE)
        if operation.action is Action.STOP:
            sets_position = any(each.action is Action.SET_POSITION for each in operations)
            return self._command(Action.STOP, None, sets_position_too=sets_position)
        following = self._unknown_following()
        if following is not None:
            return self._command(Action.UNKNOWN, None, needs_word=following)
        if operation.action is Action.FOLLOW_NEXT:
            operation = Operation(Action.FOLLOW) if self.hits else NOTHING_DONE
        if not operation.action.runs_target:
            return self._command(operation.action, None)
        number = self._number(operation)
        mode = None if number is None else self.plan.mode(number)
        if mode is None:
            return self._command(_run_as(operation.action, Action.ABSOLUTE), number)
        word = self._mode_word(mode)
        if word is not None:
            return self._command(_run_as(operation.action, mode.action(word)), number)
        is_asked = mode.is_in_frame or mode.address in self.read_words or mode.address in self.unclear
        if is_asked or not self.axis.reach.may_read:
            return self._command(Action.UNKNOWN, number)
        return self._command(Action.UNKNOWN, number, needs_word=mode.address)

    def _command(
        self,
        action: Action,
        number: int | None,
        needs_word: int | None = None,
        *,
        sets_position_too: bool = False,
    ) -> AxisCommand:
        return AxisCommand(
            self.axis,
            action,
            number,
            self.hits,
            words=self.words,
            coils=self.coils,
            unclear_words=frozenset(self.unclear),
            needs_word=needs_word,
            is_doubtful=action.runs_target and self.is_doubtful,
            sets_position_too=sets_position_too,
        )

    def _operations(self) -> list[Operation]:
        rules = self.axis.rules
        before = (lambda _: None) if self.may_have_risen else rules.word
        operations = []
        for trigger in self.plan.triggers:
            if trigger.is_coil:
                if trigger.address in self.coils:
                    operations.append(
                        trigger.operation(self.coils[trigger.address], rules.coil(trigger.address))
                    )
            elif trigger.block is not None and trigger.block != self.access.write_address:
                continue
            elif trigger.address in self.words:
                operations.append(trigger.operation(self.words[trigger.address], before(trigger.address)))
            elif trigger.address in self.unclear:
                word, certain = self.certain_bits.get(trigger.address, (0, 0))
                is_certain = not (trigger.mask | trigger.rising) & ~certain
                if is_certain:
                    operations.append(trigger.operation(word, None))
                else:
                    is_stop = trigger.stops_surely(word, certain)
                    operations.append(Operation(Action.STOP if is_stop else Action.UNKNOWN))
        if self.sets_position:
            operations.append(Operation(Action.SET_POSITION))
        if any(address in self.words or address in self.unclear for address in self.plan.starts_on) or (
            self.hits and self._moves_at_once()
        ):
            operations.append(Operation(Action.START))
        if self.hits and self._may_follow():
            operations.append(Operation(Action.UNKNOWN))
        if any(self._sets_other_motion(mode) for mode in self.plan.modes if mode is not None):
            operations.append(Operation(Action.OTHER_MOTION))
        return operations

    def _sets_other_motion(self, mode: ModePlan) -> bool:
        """Whether it sets a mode in which the drive moves without targets, perhaps immediately."""
        word = self.words.get(mode.address)
        return word is not None and mode.action(word) is Action.OTHER_MOTION

    def _unknown_following(self) -> int | None:
        """Return an unknown trigger register that decides whether a position is run immediately."""
        if not self.hits or not self.axis.reach.may_read:
            return None
        asked = self.unclear | set(self.read_words)
        for trigger in self.axis.rules.following:
            if trigger.address not in asked and self._word_at(trigger.address) is None:
                return trigger.address
        return None

    def _word_at(self, address: int) -> int | None:
        """Return the content of a register as it is, or as this request leaves it."""
        if address in self.words:
            return self.words[address]
        word = self.axis.rules.word(address)
        return self.read_words.get(address) if word is None else word

    def _may_follow(self) -> bool:
        """Whether a register that may make the drive follow each position has unknown content."""
        for trigger in self.axis.rules.following:
            word = self._word_at(trigger.address)
            if word is None or trigger.holds_unknown(word):
                return True
        return False

    def _is_following(self) -> bool:
        """Whether the drive goes to each position as soon as it is written."""
        for trigger in self.axis.rules.following:
            word = self._word_at(trigger.address)
            if word is not None and trigger.is_following(word):
                return True
        return False

    def _moves_at_once(self) -> bool:
        """Whether the drive goes to a written position without any trigger."""
        if not (self.plan.is_staged or self.plan.starts_on) or self._is_following():
            return True
        mode = self.plan.mode(self.hits[0].mapped.number)
        word = None if mode is None else self._mode_word(mode)
        return mode is not None and word is not None and mode.action(word) is Action.FOLLOW

    def _number(self, operation: Operation) -> int | None:
        if operation.number is not None:
            return operation.number
        if self.hits:
            return self.hits[0].mapped.number
        if self.axis.rules.staged is not None:
            return self.axis.rules.staged
        return 0 if len(self.axis.plan.command) == 1 else None

    def _mode_word(self, mode: ModePlan) -> int | None:
        if mode.address in self.unclear or (mode.is_in_frame and mode.address not in self.words):
            return None
        return self._word_at(mode.address)


def _rank(operation: Operation) -> int:
    return _RANK[operation.action, operation.is_letting_go]


def _run_as(trigger: Action, mode: Action) -> Action:
    """Return the action of running a target, from what the trigger and the mode say."""
    if not mode.runs_target:
        return mode
    if trigger is Action.START or (trigger is Action.FOLLOW and mode.is_relative):
        return Action.ABSOLUTE if mode is Action.START else mode
    return trigger
