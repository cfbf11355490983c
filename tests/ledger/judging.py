"""What a frame towards a drive has to be, given what the controller believes; and when a refusal is due."""

from typing import Final

from tests.ledger.clock import MS
from tests.ledger.events import Book
from tests.ledger.exchanges import Frame, Request
from tests.ledger.frames import words_of
from tests.ledger.layouts import (
    CONTROL_ENABLE,
    CONTROL_START,
    IMAGE_RELATIVE,
    JOG,
    MODE_RELATIVE,
    RUN,
    RUN_RELATIVE,
    STOP,
    Style,
)
from tests.ledger.registers import Belief
from tests.ledger.screws import TRAVEL_MM
from tests.ledger.witness import Intent, Witness

NO_CONNECTION: Final = 0x0A
UNSEEN_NS: Final = 500 * MS
DONE_DROP_NS: Final = 1_000 * MS
MAY_PROVE: Final = (2, 3, 4)
"""Exceptions that say so only of a drive whose map promises it."""


class Judge:
    """One axis: the controller's belief, held against what goes to the drive."""

    def __init__(self, witness: Witness, book: Book) -> None:
        self.witness, self.book = witness, book
        self.layout = witness.layout
        self.belief = Belief(witness.layout)
        self._control: int | None = None
        """The control word of an image as it was acknowledged last."""
        self._unacknowledged: Frame | None = None
        """The last target, if it was not acknowledged; of drives that know no distances."""
        self._is_proven = False
        """It was read back as it was sent."""

    # --- requests on their way -------------------------------------------------------------------------

    def sent(self, request: Request, frame: Frame) -> None:
        """A write of the controller goes out: take note of it, and look at its target's words."""
        belief, parsed = self.belief, request.parsed
        touched = belief.touched(parsed)
        is_joined = len(touched) == 1 and self._target_of(frame) is not None
        if is_joined and not self._is_proven and belief.stale_part(parsed, request.arrived_ns):
            self._violation("joined-with-a-lost-part", f"{request.pdu.hex(' ')} as {frame.pdu.hex(' ')}")
        frame.before = belief.written()
        belief.write(parsed, request.arrived_ns)
        if touched:
            self._unacknowledged, self._is_proven = None, False
        frame.written = belief.written()
        frame.intent = self._intent(request, frame)
        if frame.intent is not None:
            self.witness.decides()
            now_ns = self.witness.now_ns
            frame.intent = frame.intent._replace(sent=(now_ns, self.witness.drive.motor.at(now_ns)))
        frame.is_interruption = self._trigger(request) in ("stop", "jog")
        if touched:
            self.book.seen["targets sent"] += 1
            self._check_target(request, frame)

    def _intent(self, request: Request, frame: Frame) -> Intent | None:
        """Return what the drive is meant to do when it takes this frame."""
        belief, layout = self.belief, self.layout
        touched, trigger = belief.touched(request.parsed), self._trigger(request)
        nominal = belief.nominal
        place = self.witness.place
        if trigger in ("stop", "jog"):
            return None
        if nominal is None and any(register.word is not None for register in belief.target):
            return Intent(0, False, True, place, is_unknown=True)
        if layout.style in (Style.DIRECT, Style.PLAIN, Style.BLOCK):
            if not touched or nominal is None:
                return None
            in_frame = belief.touches_mode(request.parsed)
            is_raw = layout.style is Style.BLOCK and not in_frame
            is_relative = in_frame and bool((belief.mode.word or 0) & 1)
            return Intent(nominal, is_relative, True, place, is_raw=is_raw)
        if trigger is None or nominal is None:
            return None
        if layout.style is Style.IMAGE:
            return Intent(nominal, bool((belief.mode.word or 0) & IMAGE_RELATIVE), True, place)
        is_relative = trigger == "relative"
        if layout.style is Style.STICKY and belief.mode.word is None and belief.is_target_ok:
            return Intent(nominal, False, True, place, is_raw=True)  # nobody knows its mode
        if layout.style is Style.STICKY:
            is_relative = belief.mode.word == MODE_RELATIVE
        target, mode = [register.is_ok for register in belief.target], belief.mode.is_ok
        why = f"target {nominal}: words acknowledged {target}, mode {belief.mode.word} acknowledged {mode}"
        return Intent(nominal, is_relative, belief.is_ok, place, why=why)

    def _trigger(self, request: Request) -> str | None:
        """Return what a request makes the drive do beside its target."""
        write, layout = request.parsed.write, self.layout
        if write is None or layout.style is Style.PLAIN:
            return None
        if not 0 <= layout.trigger - write[0] < len(write[1]):
            return None
        word = write[1][layout.trigger - write[0]]
        if layout.style is Style.IMAGE:
            if not word & CONTROL_ENABLE:
                return "stop"
            return "run" if word & CONTROL_START else None
        if layout.style in (Style.DIRECT, Style.BLOCK):
            return {STOP: "stop", JOG: "jog"}.get(word)
        return {STOP: "stop", JOG: "jog", RUN: "run", RUN_RELATIVE: "relative"}.get(word)

    def _check_target(self, request: Request, frame: Frame) -> None:
        corrected = self._target_of(frame)
        nominal = self.belief.nominal
        if nominal is None:
            return
        if corrected is None:  # a half that went out as it came
            self.belief.is_raw = True
            is_free = self.layout.is_staged or self.layout.style is Style.BLOCK
            if not is_free:
                self._violation("bare-half", frame.pdu.hex(" "))
            return
        is_stop = self._trigger(request) == "stop"
        is_raw = is_stop or (frame.intent is not None and frame.intent.is_raw)
        self.belief.is_raw = is_raw
        if is_raw:
            if corrected != nominal:
                self._violation("touched-unknown", f"{nominal} became {corrected}")
        elif not self._may_stand_for(corrected, nominal):
            self._violation("no-correction", f"{nominal} became {corrected}")

    def _may_stand_for(self, corrected: int, nominal: int) -> bool:
        """Whether a count may be written for a target; its motion is judged when it runs."""
        if self.witness.is_one_of(corrected, nominal):
            return True
        if self.layout.basis is None:
            return self.layout.is_staged and corrected == nominal
        return abs(corrected - nominal) <= self.witness.most_correction()

    def _target_of(self, frame: Frame) -> int | None:
        """Return the target that a frame holds whole."""
        if frame.parsed.write is None:
            return None
        address, words = frame.parsed.write
        start = self.layout.command - address
        if start < 0 or start + 2 > len(words):
            return None
        return self.layout.join((words[start], words[start + 1]))

    def invalidate_all(self) -> None:
        """The drive may have been switched off: what it holds is not known any more."""
        self.witness.invalidate_all()
        self.belief.invalidate_all(self.witness.now_ns)
        self._control = None  # a target that was not acknowledged may still be read back
        self._is_proven = False

    # --- frames of the gateway's own -----------------------------------------------------------------------

    def check_added_read(self, frame: Frame, preparing: list[Request]) -> None:
        """Look at a frame that belongs to no request and writes nothing."""
        layout, read = self.layout, frame.parsed.read
        allowed = {(layout.actual, 2), (layout.command, 2), (layout.status, 1), (layout.mode, 1)}
        allowed |= {(layout.trigger, 1)}
        if layout.commanded is not None:
            allowed.add((layout.commanded, 2))
        if read not in allowed:
            self._violation("W8-invented-frame", frame.pdu.hex(" "))
        elif not preparing:
            self._violation("W8-read-for-nothing", frame.pdu.hex(" "))

    def check_restaging(self, frame: Frame, preparing: list[Request]) -> None:
        """Look at a write that belongs to no request: only a target right before its trigger may be one."""
        self.book.seen["restaged"] += 1
        corrected, belief = self._target_of(frame), self.belief
        triggers = [
            r for r in preparing if r.controller.may_write and self._trigger(r) in ("run", "relative")
        ]
        if corrected is None or frame.parsed.function != 16 or not self.layout.is_staged or not triggers:
            self._violation("invented-write", frame.pdu.hex(" "))
            return
        self.witness.decides()
        frame.written = belief.written()
        trigger = triggers[0]
        trigger.restaged += 1
        belief.is_raw = False
        if trigger.restaged > 1:
            self._violation("restaged-twice", frame.pdu.hex(" "))
        if belief.nominal is None and any(register.is_ok for register in belief.target):
            return  # completed with what the drive held
        if not belief.is_ok or belief.nominal is None:
            self._violation("restaged-lost-target", frame.pdu.hex(" "))
        elif not self._may_stand_for(corrected, belief.nominal):
            self._violation("no-correction", f"{belief.nominal} was restaged as {corrected}")

    # --- endings ---------------------------------------------------------------------------------------

    def answered(self, frame: Frame, *, is_native: bool, is_exception: bool) -> None:
        """A frame was answered, or (neither native nor an exception) was not, or oddly."""
        if frame.parsed.write is None:
            self._read_answered(frame, is_native=is_native)
            return
        request = frame.request
        touched = self.belief.touched(frame.parsed)
        if is_native and frame.written is not None:
            if request is None:
                self.belief.acknowledge(frame.parsed, frame.written, whole=True)
            else:
                self.belief.acknowledge(request.parsed, frame.written, whole=len(touched) == 2)
        elif not is_native:
            self._lost(frame, has_proof=is_exception and self._has_proof(frame))
        unchanged = is_exception and self.layout.exception_writes_nothing
        is_held = is_native and not frame.has_moved and self._is_held(request)
        if (frame.intent is not None or frame.is_interruption) and not unchanged and not is_held:
            self.witness.moved(
                is_acknowledged=is_native, has_moved=frame.has_moved, is_interruption=frame.is_interruption
            )
        self._note_control(request, is_acknowledged=is_native)
        if is_native and frame.parsed.read is not None:
            self._read_answered(frame, is_native=True)

    def _has_proof(self, frame: Frame) -> bool:
        """Whether the exception to a write says that the drive has written nothing (M7)."""
        if frame.reply is None:
            return False
        code = frame.reply[1]
        return code == 1 or (code in MAY_PROVE and self.layout.exception_writes_nothing)

    def _control_of(self, request: Request | None) -> int | None:
        """Return the control word that a request writes into an image."""
        if self.layout.style is not Style.IMAGE or request is None or request.parsed.write is None:
            return None
        address, words = request.parsed.write
        return words[-address] if address <= 0 < address + len(words) else None

    def _is_held(self, request: Request | None) -> bool:
        """Whether the start bit of an image has not risen, and everybody knows that."""
        control = self._control_of(request)
        return control is not None and self._control is not None and bool(self._control & CONTROL_START)

    def _note_control(self, request: Request | None, *, is_acknowledged: bool) -> None:
        control = self._control_of(request)
        if control is not None:
            self._control = control if is_acknowledged else None

    def _lost(self, frame: Frame, *, has_proof: bool = False) -> None:
        parsed = (frame.request or frame).parsed
        touched = self.belief.touched(parsed if has_proof else frame.parsed)
        for index in touched:
            self.belief.target[index].is_ok = self.belief.target[index].is_certain = False
        self.belief.lose(parsed, self.witness.now_ns)
        if has_proof and frame.before is not None and frame.written is not None:
            self.belief.take_back(parsed, frame.before, frame.written)
        is_place = self.layout.style in (Style.DIRECT, Style.PLAIN)
        self._unacknowledged = frame if is_place and self._target_of(frame) is not None else None
        self.book.seen["targets not acknowledged"] += bool(touched)

    def _read_answered(self, frame: Frame, *, is_native: bool) -> None:
        read, layout, witness = frame.parsed.read, self.layout, self.witness
        if read is None:
            return
        covers = read[0] <= layout.actual and read[0] + read[1] >= layout.actual + 2
        if not is_native:
            witness.reading_failed |= covers and frame.may_be_added
            return
        if frame.sample is None:
            return
        if read == (layout.mode, 1) and frame.may_be_added and frame.reply is not None:
            self.belief.know_mode(int.from_bytes(frame.reply[2:4], "big"))
        self._prove(frame)
        if covers:
            is_look = (
                not frame.candidates and witness.now_ns - max(witness.seen_ns, witness.began_ns) > UNSEEN_NS
            )
            witness.is_branch_lost |= is_look and not frame.sample.is_stationary
            witness.told(frame.sample.at, is_for_a_move=frame.may_be_added)
        if layout.has_bits and read[0] <= layout.status < read[0] + read[1] and frame.sample.is_stationary:
            witness.done_seen = True

    def _prove(self, frame: Frame) -> None:
        """Who reads that a drive holds the target that was never acknowledged may know that it arrived."""
        unacknowledged, read = self._unacknowledged, frame.parsed.read
        if unacknowledged is None or read is None or frame.reply is None:
            return
        start = self.layout.command - read[0]
        if not 0 <= start <= read[1] - 2:
            return
        held = self.layout.join(words_of(frame.reply[2:])[start : start + 2])  # type: ignore[arg-type]
        if held == self._target_of(unacknowledged):
            self._unacknowledged, self._is_proven = None, True
            if (
                unacknowledged.written is not None
            ):  # what was refused since was never sent: the drive holds this
                self.belief.hold(unacknowledged.written)

    def lost_unsent(self, request: Request) -> None:
        """A write never reached the drive; who ignores exceptions believes in it all the same."""
        parsed = request.parsed
        if self.belief.touched(parsed) or self.belief.touches_mode(parsed):
            self.belief.write(parsed, request.arrived_ns)
            self.belief.lose(parsed, self.witness.now_ns)
            self.book.seen["targets lost"] += 1

    def check_refusal(self, request: Request, code: int, *, is_excused: bool) -> None:
        """Look whether the gateway had a reason to refuse a write."""
        parsed, belief = request.parsed, self.belief
        touched, trigger = belief.touched(parsed), self._trigger(request)
        if trigger == "stop" and code != NO_CONNECTION:
            self._violation("M3-stop-refused", f"{request.pdu.hex(' ')} with {code}")
        if is_excused or code == NO_CONNECTION:
            return
        if len(touched) == 2 and self.layout.style is not Style.BLOCK:
            words = (belief.word_after(parsed, 0), belief.word_after(parsed, 1))
            nominal = self.layout.join(words)  # type: ignore[arg-type]
            self._check_position_refused(request, nominal, code)
        elif not touched and trigger in ("run", "relative") and not belief.is_blocked and belief.is_ok:
            self._check_trigger_refused(request, trigger == "relative")

    def _check_position_refused(self, request: Request, nominal: int, code: int) -> None:
        is_relative = self.layout.style is Style.IMAGE and bool(request.parsed.write[1][1] & IMAGE_RELATIVE)  # type: ignore[index]
        if is_relative or (self.layout.is_staged and self.layout.basis is not None):
            return
        if self._is_inside(nominal):
            self._violation("refused-for-nothing", f"target {nominal} with {code}")

    def _check_trigger_refused(self, request: Request, is_relative: bool) -> None:
        if self.layout.style is Style.STICKY:
            is_relative = self.belief.mode.word == MODE_RELATIVE
        nominal, place = self.belief.nominal, self.witness.place
        assert nominal is not None
        if is_relative:
            # So soon after it was sent off or stopped a done bit proves nothing, nor a moving axis' place.
            is_fresh = self.witness.now_ns - self.witness.began_ns < DONE_DROP_NS
            is_moving = self.witness.drive.motor.arrives_ns > request.arrived_ns
            if place is None or is_fresh or is_moving:
                return
            nominal += place[0]
        if self._is_inside(nominal):
            # A lost part tears the whole position for the gateway, and only itself for the belief kept here:
            # to refuse then is careful, not wrong. It is counted, and must stay rare.
            self.book.seen["triggers refused with care"] += 1

    def _is_inside(self, nominal: int) -> bool:
        return 0.0 <= self.layout.machine_mm(nominal) <= TRAVEL_MM

    def _violation(self, kind: str, detail: str) -> None:
        self.book.violation(kind, detail, self.witness.journal)
