"""Whether the status that the relay shows is true, from what the account knows.

A status is of the instant at which it comes. It shows the table, gain and switch that are in force, by the
digest of the compiled table; the target that was accepted last; the newest position that was read, as old as
it says; and how many requests the drives have answered.
"""

from typing import Final

from gateway.status.axis import AxisStatus, Shares
from gateway.status.line import LineStatus
from gateway.status.model import RelayModel
from tests.year.account import TOLD_NS, TROUBLED_NS, Account, Axis, Line
from tests.year.machine import MS, Machine, S

ON_ITS_WAY_NS: Final = 1_200 * MS
"""From a read to its reply: the patience of a controller, and the end of the silence behind it."""


class StatusCheck:
    """Reads statuses."""

    def __init__(self, machine: Machine, account: Account) -> None:
        self._machine, self._account, self._book = machine, account, account.book

    def shown(self, status: RelayModel) -> None:
        """The relay shows its status now."""
        now_ns = self._machine.now_ns
        at_ns = self._account.began_ns + round((status.gateway.uptime_s or 0.0) * S)
        if abs(now_ns - at_ns) > MS:
            self._wrong("status", f"it is {(now_ns - at_ns) / MS:.3f} ms old")
        for line in self._account.lines.values():
            self._check_line(line, status.lines[line.name])
            for axis in line.axes.values():
                self._check_correction(axis, status.axes[axis.name])
                self._check_target(line, axis, status.axes[axis.name])
                self._check_reading(line, axis, status.axes[axis.name], now_ns)

    def _check_line(self, line: Line, shown: LineStatus) -> None:
        """Each frame that left is counted once; one may be on the line. After a fault some never are."""
        if shown.cut_through:
            both = shown.cut_through.requests.cut_through, shown.cut_through.replies.cut_through
            for what, number in zip(("requests", "replies"), both, strict=True):
                most = max(self._book.seen[f"{what} cut through"], number)
                self._book.seen[f"{what} cut through"] = most
        counted = shown.exchanges + shown.timeouts + shown.added_reads + shown.restaged
        uncounted = line.left - counted
        if line.troubled_ns + TROUBLED_NS > line.counted_ns:
            line.uncounted = uncounted
        line.counted_ns = self._machine.now_ns
        if abs(uncounted - line.uncounted) > 1:
            self._wrong(line.name, f"{counted} of {line.left} requests are counted, but {line.uncounted}")

    def _check_correction(self, axis: Axis, shown: AxisStatus) -> None:
        correction, table = axis.correction, shown.table
        is_blocked = shown.compensation == "blocked"  # it may be switched off too
        if is_blocked and not any(each.is_blocked for each in axis.members):
            self._wrong(axis.name, "it is shown as blocked")
        is_off = not correction.is_on if is_blocked else shown.compensation == "off"
        now = (table.file or "", table.compiled, shown.gain, is_off)
        digest = self._account.digests.get(correction.table)
        gain = Shares(forward=correction.forward, backward=correction.backward)
        if now != (correction.table, digest, gain, not correction.is_on):
            self._wrong(axis.name, f"{now} for {correction.table} {correction[2:]}")
        if (shown.compensation == "unreferenced") == axis.is_referenced and correction.is_on and digest:
            why = f"{shown.compensation}, and referenced is {axis.is_referenced}"
            self._machine.after(TOLD_NS, self._need_told, axis, axis.told, why)

    def _need_told(self, axis: Axis, told: int, why: str) -> None:
        """A reference that was found or lost is reported with the end of the exchange that shows it."""
        if axis.told == told:
            self._wrong(axis.name, why)

    def _check_target(self, line: Line, axis: Axis, shown: AxisStatus) -> None:
        """It is that of the last move; until the reply to that has come, of the one before."""
        if axis.sure < 2 or axis.is_flagged or axis.place is None:
            return
        self._book.seen["statuses with a target"] += 1
        targets = {(axis.place, axis.words), axis.came_from}
        now = self._counts(axis, shown.nominal_setpoint), self._counts(axis, shown.corrected_setpoint)
        if now == (None, None) and axis.ran_ns < line.troubled_ns + TROUBLED_NS:
            return  # a write or the link was lost since: it is not known any more
        if any(each.doubled_ns for each in line.frames if each.axis is axis):
            return  # a reply that came once more may have been taken for that of a write on its way
        if now not in targets:
            self._wrong(axis.name, f"its target is {now}, not one of {targets}")

    def _check_reading(self, line: Line, axis: Axis, shown: AxisStatus, now_ns: int) -> None:
        """It is one of those that the drive has told, from the time that the status says."""
        reading = shown.last_actual
        is_doubled = any(each.doubled_ns for each in line.frames if each.axis is axis)
        if (
            reading is None or is_doubled or not axis.is_told
        ):  # what a controller reads is judged all the same
            return
        self._book.seen["statuses with a reading"] += 1
        nominal, corrected = self._counts(axis, reading.nominal), self._counts(axis, reading.corrected)
        read_ns = now_ns - round(reading.age_s * S)
        if not any(
            counts == corrected
            and (sent_ns in axis.read_late or read_ns - sent_ns >= -MS)
            and read_ns - sent_ns <= ON_ITS_WAY_NS
            for sent_ns, counts in axis.readings
        ):
            self._wrong(axis.name, f"{corrected} was read {reading.age_s} s ago, of {list(axis.readings)}")
        assert nominal is not None
        assert corrected is not None
        is_of_before = read_ns < axis.ran_ns  # another correction may have been in force then
        if not is_of_before and (why := self._account.why_no_reading(axis, nominal, corrected)):
            self._wrong(axis.name, why)

    @staticmethod
    def _counts(axis: Axis, position: float | None) -> int | None:
        """Return counts: a nominal position that was read lies between them."""
        if position is None:
            return None
        return round(axis.layout.zero_counts + axis.layout.counts_per_unit * position)

    def _wrong(self, what: str, why: str) -> None:
        self._book.find("wrong-status", f"{what}: {why}")
