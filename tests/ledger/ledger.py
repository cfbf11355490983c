"""The ledger: every frame on its way in, out and back, and who it belonged to.

The witness knows the exact table, what every controller asked for and in which order, what every drive
truly did and when. It takes nothing from the exchange. What it demands (numbers as in docs/wire-rules.md):

- *Whose frame.* Each frame to a drive is either the oldest request of one controller that is not older than
  its ``timeout_ms`` (or a stop), or a frame that the gateway may add for such a request: a read of a mapped
  register, or one restaging of a target before its trigger (W8, M2). A request is sent once (W5), in order
  (W1), one at a time (W6). All but the words of the target is byte for byte what the controller wrote; a
  half, a mask and a cut block may be recast as a write of the whole.
- *Its words.* The target's words are the correction of the nominal target in one direction, or half way
  while no direction was ever known; where a drive may still turn a staged target into a distance, its words
  are judged when it runs. A half is completed with what the controller wrote last to the other word, never
  with anything older.
- *Its motion.* A drive runs only a target of which the controller's last write was acknowledged, and so was
  its mode (M3). It goes where the exact table puts the nominal destination, rounded to a whole count, on
  the branch of the direction from where it truly is (M6): strictly where the place is known (the last run
  was acknowledged and nothing else moved the axis), within the hysteresis of 2 counts where it was only
  measured. A distance counts from the nominal place of its base (M5) and may round by one count. The same
  target again is the same words (M4).
- *Either branch* is accepted, and counted as ``ambiguous``, where the drive stands between what both
  branches make of the target, or passed it between the reading that the gateway asked for, or its decision by
  one of a moment before, and the command (at most 250 ms), or while a slow drive did not take it; counted as
  ``unsure`` where the gateway asked for the position and was not told. Both must stay a small share.
- *Readings.* A settled axis whose run was acknowledged reads exactly what was commanded. All others read
  between what the branches make of them, widened by the difference that the present motion may still be
  fading out. An acknowledged target reads back as it was written. All other words are those of the drive.
- *Replies.* Each is that of its own request: as the drive said it where it said no success (W4), 0x0B where
  it said nothing (W7), an exception where nothing was sent. Refusals need a reason: a loss, a stop, trouble
  on the line, a place outside the travel, a distance from an unknown place.
- *Settled.* An axis that came to rest stands within one count of the table's value for the way it really
  came.

- *Stops* go before everything that waits (M3) and are never refused while there is a connection.
- *Given up.* What came in pieces for longer than its controller waits, waited longer while the process stood
  still, or is of a connection that is closed, is not sent, but for stops; nothing else is given up (W5).
- *Elsewhere.* Where one drive does not look at unit ids, nothing that would move it goes out under another
  one; what does is the controller's own, and so is its reply (W7).
- *Continuity.* From one reading to the next a position moves as the axis does, but for what fades out; a
  standing axis never jumps. Not asked of motions that began on the way, nor in doubt.
- *Unseen.* Where nobody had seen the axis for a while and it is found on its way, its branch is lost; a run
  that was unsure may be made right by the next one, or stay as it was.
- *Unknown.* After a lost connection nothing is believed of a drive: its mode may be read, a half completed
  with what it holds. A target whose mode nobody knows runs with the controller's own words.

Not accepted as an excuse: that a drive refused, delayed, lost or garbled something earlier.
"""

from typing import Final

from gateway.relay.controller_port import HAS_GONE, STOOD_STILL, TOO_SLOW
from gateway.relay.pulse import AFTERWARDS_NS, EVERY_NS
from tests.ledger.clock import MS, Clock
from tests.ledger.drives import Operation
from tests.ledger.events import Book
from tests.ledger.exchanges import Controller, Frame, Request, Sample, may_become
from tests.ledger.frames import native_success
from tests.ledger.judging import Judge
from tests.ledger.layouts import CONTROL_ENABLE, STOP, Style
from tests.ledger.replies import check_reply
from tests.ledger.stillness import Stillness
from tests.ledger.witness import Witness

NO_CONNECTION = b"\x0a"
NO_RESPONSE = 0x0B
LOST_NS: Final = 1_000 * MS
"""A drive that answered nothing for longer may have been switched off (``lost_ms``)."""


class Ledger:
    """One line with its controllers and axes."""

    def __init__(
        self,
        clock: Clock,
        book: Book,
        witnesses: dict[int, Witness],
        *,
        hush_ms: float = 0.0,
        answer_ms: float = 0.0,
    ) -> None:
        """``hush_ms``: so long a drive that did not answer is asked nothing, at most (W6).

        ``answer_ms``: so long it may take to answer.
        """
        self.clock, self.book = clock, book
        self._hush_ns = int(hush_ms * MS)
        self._answer_ns = int(answer_ms * MS)
        self._hushed_ns: dict[int, int] = {}
        """Until when that may last, by unit id."""
        self.witnesses = witnesses
        self.judges = {unit: Judge(witness, book) for unit, witness in witnesses.items()}
        self._alone = next(iter(witnesses.values())) if len(witnesses) == 1 else None
        """The axis of a drive that answers to any unit id."""
        self.controllers: list[Controller] = []
        self._arrived_ns = 0
        self.on_wire: Frame | None = None
        self._delivering: Frame | None = None
        self._expiring: Frame | None = None
        self._troubled_ns = self._stopped_ns = -1
        self._missed_stops: set[tuple[int, bytes]] = set()
        """Stops that their drives have not answered."""
        self._written: dict[int, Frame] = {}
        """The last write to each unit id."""
        self._silent_since: dict[int, int] = {}
        """When the first request was sent that a drive has not answered, by its unit id."""
        self.is_down = False
        """There is no connection to the drives."""

    # --- controllers ------------------------------------------------------------------------------------

    def arrived(
        self, controller: Controller, transaction_id: int, unit: int, pdu: bytes, written_ns: int
    ) -> Request:
        """A controller's request has reached the gateway whole."""
        # No two come at one instant: in their order they are told apart, by age too.
        self._arrived_ns = max(self.clock.now_ns, self._arrived_ns + 1)
        request = Request(controller, transaction_id, unit, pdu, self._arrived_ns, written_ns=written_ns)
        request.is_foreign = unit not in self.judges
        request.is_stop = controller.may_write and self._is_stop(request)
        self.book.seen["requests"] += 1
        self.witness(unit).journal.note(f"{controller.name}: request", pdu, f"#{transaction_id}")
        if controller.is_serial:
            controller.unanswered.clear()
            for old in controller.pending:
                if not old.is_stop:
                    self._lost(old, "withdrawn: its controller went on")
            controller.pending = [old for old in controller.pending if old.is_stop]
        if request.is_stop:
            self._stopped_ns = request.arrived_ns
            self._take_the_place_of_given_up(request)
        controller.pending.append(request)
        controller.unanswered[transaction_id] = request
        if self.is_down:
            self._give_up_untold(controller)
        return request

    def is_to_be_sent(self, request: Request, stillness: Stillness) -> None:
        """The gateway means to send a request: does its controller still wait for it?"""
        now_ns, timeout_ns = self.clock.now_ns, request.controller.timeout_ns
        waited_ns = now_ns - request.written_ns
        has_slept = stillness.woke_ns == now_ns and stillness.slept_ns > timeout_ns + EVERY_NS
        if request.controller.is_closed:
            self._breach("W5-sender-has-gone", request, "its connection is closed")
        elif has_slept and request.written_ns < now_ns:
            self._breach("W5-waited-while-it-slept", request, f"for {waited_ns / MS:.1f} ms")
        elif stillness.woke_ns < request.written_ns and waited_ns > timeout_ns:
            self._breach("W5-came-in-pieces", request, f"for {waited_ns / MS:.1f} ms")

    def is_to_be_given_up(self, request: Request, why: str, stillness: Stillness) -> None:
        """The gateway means not to send a request: has its controller given it up?"""
        now_ns, timeout_ns = self.clock.now_ns, request.controller.timeout_ns
        has_slept = now_ns - stillness.woke_ns <= AFTERWARDS_NS and stillness.slept_ns > timeout_ns
        is_right = {
            HAS_GONE: request.controller.is_closed,
            STOOD_STILL: has_slept,
            TOO_SLOW: now_ns - request.written_ns > timeout_ns,
        }
        self.book.seen[f"given up: {why}"] += 1
        if not is_right[why]:
            self._breach("given-up-for-nothing", request, why)

    def given_up(self, request: Request, why: str) -> None:
        """The gateway has dealt with a request that its controller gave up: only a stop of it is sent."""
        pending = request.controller.pending
        # Its connection ends with it: what came before it is lost before it.
        for old in [each for each in pending if each is not request and not each.is_stop]:
            pending.remove(old)
            self._lost(old, "its connection ends")
        if request in pending and (self.is_down or not request.is_stop):
            pending.remove(request)
            self._lost(request, why)

    def gone(self, controller: Controller) -> None:
        """The gateway has seen that a connection is closed."""
        controller.unanswered.clear()
        for request in list(controller.pending):
            if not request.is_stop:
                controller.pending.remove(request)
                self._lost(request, "its connection closed")

    def _breach(self, kind: str, request: Request, detail: str) -> None:
        self.book.violation(kind, f"{request.pdu.hex(' ')}: {detail}", self.witness(request.unit).journal)

    def _take_the_place_of_given_up(self, stop: Request) -> None:
        """A stop for which nobody waits any more needs not go out beside a new one, which waits as it did."""
        for controller in self.controllers:
            for old in list(controller.pending):
                is_same = (old.unit, old.pdu) == (stop.unit, stop.pdu)
                if is_same and controller.unanswered.get(old.transaction_id) is not old:
                    controller.pending.remove(old)
                    stop.goes_again |= old.goes_again

    def _is_stop(self, request: Request) -> bool:
        layout, write = self.witness(request.unit).layout, request.parsed.write
        if write is None or request.is_foreign or layout.style is Style.PLAIN:
            return False
        if not 0 <= layout.trigger - write[0] < len(write[1]):
            return False
        word = write[1][layout.trigger - write[0]]
        return not word & CONTROL_ENABLE if layout.style is Style.IMAGE else word == STOP

    def witness(self, unit: int) -> Witness:
        """Return who knows the axis that a unit id reaches."""
        found = self.witnesses.get(unit, self._alone)
        assert found is not None
        return found

    def _lost(self, request: Request, why: str) -> None:
        if request.is_lost:
            return
        request.is_lost = True
        self.witness(request.unit).journal.note("  never sent", request.pdu, why)
        self.book.seen["never sent"] += 1
        if request.is_foreign:
            return
        judge = self.judges[request.unit]
        if request.controller.may_write and request.parsed.write:
            judge.lost_unsent(request)

    # --- towards the drives ------------------------------------------------------------------------------

    def sent(self, unit: int, pdu: bytes, *, is_early: bool = False) -> Frame:
        """The gateway sends a frame: find out whose it is, and whether it is what it has to be."""
        frame = Frame(unit, pdu, self.clock.now_ns)
        frame.is_early = is_early
        if frame.parsed.write is not None:
            frame.written_before = self._written.get(unit)
            if frame.written_before is not None and frame.written_before.pdu != pdu:
                frame.written_before.written_before = None  # no chain of all of them
            self._written[unit] = frame
        if self.on_wire is not None:
            self.book.violation("W6-two-at-a-time", pdu.hex(" "), self.witness(unit).journal)
        self.on_wire = frame
        self.book.seen["frames"] += 1
        self._check_stops(frame)
        self._expire()
        found = [r for r in self._next_ones(unit) if self._may_become(r, frame)]
        if is_early:  # what goes again waits for the silence
            found = [request for request in found if not request.goes_again]
        if unit not in self.judges:
            self._sent_elsewhere(frame, found)
            return frame
        judge = self.judges[unit]
        if frame.parsed.write is None:
            frame.candidates = found
            frame.may_be_added = any(r.parsed.write for r in self._next_ones(unit))
            judge.witness.journal.note("to the drive", pdu, "" if found else "(added)")
            if not found:
                judge.check_added_read(frame, self._next_ones(unit))
        elif found:
            judge.witness.journal.note("to the drive", pdu, f"#{found[0].transaction_id}")
            self._resolve(found[0], frame)
            judge.sent(found[0], frame)
        else:
            judge.witness.journal.note("to the drive", pdu, "(restaged)")
            judge.check_restaging(frame, self._next_ones(unit))
        return frame

    def _sent_elsewhere(self, frame: Frame, found: list[Request]) -> None:
        """A frame goes to a unit id that no drive was given: a controller's, and it moves nothing (W7)."""
        self.book.seen["frames to unit ids without an axis"] += 1
        witness, write = self.witness(frame.unit), frame.parsed.write
        witness.journal.note(f"to unit id {frame.unit}", frame.pdu)
        if not found:
            self.book.violation("W8-invented-frame", frame.pdu.hex(" "), witness.journal)
            return
        self._resolve(found[0], frame)
        layout = witness.layout
        precious = {layout.command, layout.command + 1, layout.actual, layout.actual + 1, layout.trigger}
        if write is not None and precious & set(range(write[0], write[0] + len(write[1]))):
            self.book.violation("W7-past-the-correction", frame.pdu.hex(" "), witness.journal)

    def _expire(self) -> None:
        """What is older than its controller's patience is lost, whether or not it will be answered yet."""
        for controller in self.controllers:
            for request in controller.pending:
                if not request.is_stop and self._is_too_old(request):
                    self._lost(request, "too old")

    def _check_stops(self, frame: Frame) -> None:
        """A stop that waits goes before everything else (M3)."""
        stops = [r for c in self.controllers if c.may_write for r in c.pending if r.is_stop]
        if any((r.unit, r.pdu) == (frame.unit, frame.pdu) for r in stops):
            for controller in self.controllers:
                for request in controller.pending:  # what a stop goes before begins anew, and may look again
                    request.restaged = 0
            return
        # The same again, which its drive did not answer, lets the others have an exchange between; one that
        # goes once more itself waits for the silence.
        missed = self._missed_stops
        waiting = [r for r in stops if not r.goes_again and (r.unit, r.pdu) not in missed]
        if waiting:
            detail = f"{frame.pdu.hex(' ')} went before {waiting[0].pdu.hex(' ')}"
            self.book.violation("M3-stop-waits", detail, self.witness(waiting[0].unit).journal)

    def _may_become(self, request: Request, frame: Frame) -> bool:
        if request.is_foreign:
            return request.pdu == frame.pdu
        layout = self.witness(request.unit).layout
        return may_become(request.parsed, request.pdu, frame, layout)

    def _next_ones(self, unit: int) -> list[Request]:
        """Return the requests that may go out now: of each controller its stops and the oldest in time."""
        found = []
        for controller in self.controllers:
            is_first = True
            for request in controller.pending:
                if request.is_stop:
                    found.append(request)
                elif is_first and not self._is_too_old(request):
                    if request.may_leave:
                        found.append(request)
                    is_first = False
        found.sort(key=lambda request: request.arrived_ns)
        return [request for request in found if request.unit == unit]

    def _is_too_old(self, request: Request) -> bool:
        return self.clock.now_ns - request.arrived_ns > request.controller.timeout_ns

    def _resolve(self, request: Request, frame: Frame) -> None:
        """A frame is this request's; it is sent only once."""
        frame.request = request
        self._pass_over(request)
        request.controller.pending.remove(request)

    def _pass_over(self, request: Request) -> None:
        """What its controller asked for before and is still waiting will never be sent."""
        controller = request.controller
        for old in list(controller.pending) if not request.is_stop else ():
            if old is request:
                break
            if old.is_stop:
                continue
            if not self._is_too_old(old):
                detail = f"{old.pdu.hex(' ')} was passed over by {request.pdu.hex(' ')}"
                self.book.violation("W1-out-of-order", detail, self.witness(old.unit).journal)
            controller.pending.remove(old)
            controller.unanswered.pop(old.transaction_id, None)
            self._lost(old, "too old")

    def _goes_again(self, frame: Frame) -> None:
        """A stop that left early and was not answered leaves once more when the line has been silent (M3).

        Where its controller has given up on it, the same stop that waits already takes its place.
        """
        self._missed_stops.add((frame.unit, frame.pdu))
        # Its answer may come until then, and the silence begins behind that.
        self._hushed_ns[frame.unit] = frame.sent_ns + self._answer_ns + self._hush_ns
        request = frame.request
        if request is None:
            return
        frame.request = None
        waiting = [(each.unit, each.pdu) for controller in self.controllers for each in controller.pending]
        is_waited_for = request.controller.unanswered.get(request.transaction_id) is request
        if is_waited_for or (frame.unit, frame.pdu) not in waiting:
            request.goes_again = True
            request.controller.pending.insert(0, request)

    def did(self, frame: Frame, operations: list[Operation]) -> None:
        """A drive has taken a frame."""
        witness = self.witness(frame.unit)
        motor, now_ns = witness.drive.motor, self.clock.now_ns
        frame.has_moved = bool(operations)
        for operation in operations:
            witness.did(operation, frame.intent)
        frame.sample = Sample(motor.at(now_ns), not motor.is_moving(now_ns), witness.faded)

    def jogged(self, unit: int) -> None:
        """Somebody jogs an axis on its own panel, beside the line.

        Nobody does while the gateway has not seen it at rest: what is moved between start and target in sight
        of nobody looks like an axis on its way, and a distance then counts from its target.
        """
        witness = self.witness(unit)
        if not (witness.done_seen or witness.is_seen_at_rest):
            self.book.seen["jogs left out"] += 1
            return
        self.book.seen["jogs on the panel"] += 1
        witness.did(witness.drive.jog(self.clock.now_ns), None)
        witness.moved(is_acknowledged=True, has_moved=True, is_interruption=True)

    # --- back from the drives ------------------------------------------------------------------------------

    def delivering(self, pdu: bytes, answered: Frame | None) -> None:
        """The gateway is about to take a reply to ``answered`` for that to the frame on the wire."""
        frame = self.on_wire
        assert frame is not None
        is_none = frame.is_early and pdu != frame.pdu  # a late frame ends the wait: it goes once more
        if answered is not frame and not is_none and not self._is_same_stop(frame, answered):
            self.book.violation("W6-reply-to-another", pdu.hex(" "), self.witness(frame.unit).journal)
        self.on_wire, self._delivering = None, frame
        frame.reply = pdu
        self.witness(frame.unit).journal.note("from the drive", pdu)
        self._silent_since.pop(frame.unit, None)
        is_native = native_success(frame.pdu, pdu)
        if frame.is_early and pdu != frame.pdu:
            early = frame.request
            self._goes_again(frame)
            if is_native and early is not None:  # the gateway may believe it where nothing is owed
                frame.candidates = [early]
        else:
            self._missed_stops -= {each for each in self._missed_stops if each[0] == frame.unit}
        if not is_native:
            self._troubled_ns = self.clock.now_ns
        if frame.unit in self.judges:
            self.judges[frame.unit].answered(frame, is_native=is_native, is_exception=pdu[0] >= 0x80)

    @staticmethod
    def _is_same_stop(frame: Frame, answered: Frame | None) -> bool:
        """Whether a reply is that to the same stop of before, and nothing was written to the drive since.

        One of both left early: that one may still be answered when it goes once more (W6).
        """
        before = frame.written_before
        while before is not None and before is not answered and before.pdu == frame.pdu:
            before = before.written_before
        if before is None or before is not answered or before.pdu != frame.pdu:
            return False
        return frame.is_early or before.is_early

    def delivered(self) -> None:
        frame, self._delivering = self._delivering, None
        if frame is not None and frame.request is None and frame.parsed.write is None:
            self.book.seen["added or orphaned reads"] += 1

    def abandoned(self, *, goes_again: bool = True) -> None:
        """The gateway has given up on the frame on the wire; a stop that left early may go once more."""
        frame, self.on_wire = self.on_wire, None
        if frame is None:
            return
        self._expiring = frame
        self._troubled_ns = self.clock.now_ns
        self._hushed_ns[frame.unit] = self.clock.now_ns + self._hush_ns
        self.book.seen["time-outs"] += 1
        if frame.request is not None and frame.request.is_stop:
            self._missed_stops.add((frame.unit, frame.pdu))
        if frame.is_early and goes_again:
            self._goes_again(frame)
        self.witness(frame.unit).journal.note("given up on", frame.pdu)
        if frame.unit in self.judges:
            self.judges[frame.unit].answered(frame, is_native=False, is_exception=False)
            self._fall_silent(frame.unit, frame.sent_ns)

    def _fall_silent(self, unit: int, since_ns: int) -> None:
        """A request was not answered, or not even asked, for the silence of its drive."""
        if self.clock.now_ns - self._silent_since.setdefault(unit, since_ns) > LOST_NS:
            self.book.seen["long silences"] += 1
            self.judges[unit].invalidate_all()

    def dropping(self) -> None:
        """The connection to the drives is lost: nobody knows what happens to them meanwhile."""
        self.abandoned(goes_again=False)
        self._troubled_ns = self.clock.now_ns
        self.book.seen["connections lost"] += 1
        self.is_down = True
        for controller in self.controllers:
            self._give_up_untold(controller)
        for unit, judge in self.judges.items():
            judge.invalidate_all()
            self._silent_since.setdefault(unit, self.clock.now_ns)

    def _give_up_untold(self, controller: Controller) -> None:
        """Nothing waits for a connection that is lost; on serial lines (W7) and who has gone is not told."""
        if controller.is_serial or controller.is_closed:
            for request in controller.pending:
                self._lost(request, "no connection")
            controller.pending.clear()
            controller.unanswered.clear()

    def acted(self) -> None:
        """The gateway has done what a time-out, or a lost connection, wanted."""
        self._expiring = None

    # --- back to the controllers ---------------------------------------------------------------------------

    def replied(self, controller: Controller, transaction_id: int, unit: int, pdu: bytes) -> None:
        request = controller.unanswered.pop(transaction_id, None)
        if request is None or request.unit != unit:
            detail = f"{controller.name} #{transaction_id} {pdu.hex(' ')}"
            self.book.violation("W6-reply-to-nothing", detail, self.witness(unit).journal)
            return
        self.witness(unit).journal.note(f"{controller.name}: reply", pdu, f"#{transaction_id}")
        self.book.seen["replies"] += 1
        if self._is_of(self._delivering, request):
            assert self._delivering is not None
            if not request.is_foreign:
                check_reply(self.judges[unit], request, self._delivering, pdu, self.book)
            elif pdu != self._delivering.reply:
                self._wrong(request, pdu, "nothing of it is changed under another unit id")
        elif pdu[1:] != NO_CONNECTION and self._is_of(self._expiring, request):
            if pdu != bytes((request.pdu[0] | 0x80, 0x0B)):
                self._wrong(request, pdu, "a drive that does not answer is 0x0B")
        else:
            self._refused(request, pdu)

    def _is_of(self, frame: Frame | None, request: Request) -> bool:
        if frame is None:
            return False
        if frame.request is None and request in frame.candidates:
            self._resolve(request, frame)
        other = frame.request
        if other is not None and other.goes_again and other is not request:
            # The same stop, asked for later, may go before the one that goes once more.
            pending = request.controller.pending
            if request in pending and (request.unit, request.pdu) == (other.unit, other.pdu):
                other.controller.pending.insert(0, other)
                self._resolve(request, frame)
        return frame.request is request

    def _refused(self, request: Request, pdu: bytes) -> None:
        controller = request.controller
        if request.is_lost and len(pdu) == 2 and pdu[0] == request.pdu[0] | 0x80:
            return  # a stop behind it overtook it just before its connection ended
        if request not in controller.pending:
            self._wrong(request, pdu, "it was sent and not answered by its drive")
            return
        if len(pdu) != 2 or pdu[0] != request.pdu[0] | 0x80:
            self._wrong(request, pdu, "it was never sent")
            return
        if controller.is_motion and not self._is_stopped(request):
            self._pass_over(request)
        controller.pending.remove(request)
        self.book.seen[f"refused with {pdu[1]:#04x}"] += 1
        # It could have left only too late, behind the silence of its drive: nothing is learned of that (W6).
        is_hushed = self.clock.now_ns < self._hushed_ns.get(request.unit, 0)
        is_too_late = pdu[1] == NO_RESPONSE and is_hushed and not request.is_stop
        self.book.seen["too late to send"] += is_too_late
        is_excused = self._troubled_ns >= request.arrived_ns or self._is_stopped(request) or is_too_late
        if request.is_foreign:
            self._check_foreign_refusal(request, pdu[1], is_excused=is_excused)
        elif controller.may_write:
            self.judges[request.unit].check_refusal(request, pdu[1], is_excused=is_excused)
        self._lost(request, f"refused with {pdu[1]:#04x}")
        if pdu[1] == NO_RESPONSE and not (request.is_foreign or is_too_late):
            self._fall_silent(request.unit, self.clock.now_ns)

    def _check_foreign_refusal(self, request: Request, code: int, *, is_excused: bool) -> None:
        if self.is_down:
            return
        if code == NO_CONNECTION[0] and request.parsed.write is not None:
            self.book.seen["writes to unit ids without an axis refused"] += 1
        elif not is_excused:
            self._breach("refused-for-nothing", request, f"with {code}")

    def _is_stopped(self, request: Request) -> bool:
        return self._stopped_ns >= request.arrived_ns

    def _wrong(self, request: Request, pdu: bytes, why: str) -> None:
        detail = f"{request.pdu.hex(' ')} was answered {pdu.hex(' ')}: {why}"
        self.book.violation("wrong-reply", detail, self.witness(request.unit).journal)
