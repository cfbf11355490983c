"""Which correction is requested for an axis: its table, its switch, and its terms.

A person or the configuration requests it. How positions are corrected now is in ``gateway.compensation``: a
requested correction comes into force with the next different target, and never moves the axis. While the
positions of the axis are not meaningful, nothing is requested. While the first trigger of its group has fixed
the correction, a change is put off (M11).
"""

from math import isfinite

from gateway.compensation.correction_spec import NOTHING, CorrectionSpec, spec_of_table
from gateway.compensation.fingerprint import table_digest
from gateway.exchange.axis.member import Member
from gateway.exchange.axis.motion import Actual, Motion
from gateway.exchange.axis.reference import AxisReference
from gateway.exchange.axis.reports import AxisReports
from gateway.exchange.axis.terms import Terms
from gateway.exchange.field_counts import counts_of
from gateway.exchange.plan import CompensationMode


class RequestedCorrection:
    """The correction that is requested for one axis. ``motion.plan`` has the table and the settings."""

    __slots__ = (
        "_member",
        "_motion",
        "_reference",
        "_reports",
        "base",
        "former",
        "has_branches",
        "is_dry_run",
        "is_enabled",
        "requested",
        "terms",
    )

    def __init__(
        self, motion: Motion, reference: AxisReference, member: Member, reports: AxisReports
    ) -> None:
        plan = motion.plan
        self._motion, self._reference = motion, reference
        self._member, self._reports = member, reports
        self.is_dry_run = plan.compensation is CompensationMode.SHADOW
        """Whether it is a dry run: computed and shown, but written and read 1:1 (``compensation =
        "shadow"``). A reload may end it (``Axis.end_dry_run``)."""
        self.is_enabled = plan.compensation is not CompensationMode.OFF
        """Whether a person or the configuration wants the table to be applied."""
        self.terms = Terms(plan) if plan.thermal or plan.cross else None
        self.base: CorrectionSpec = NOTHING
        """The correction by its table."""
        self.former: tuple[CorrectionSpec, ...] = ()
        """What the last run may have left in force, for a stream."""
        self.requested: CorrectionSpec = NOTHING
        """The same with its terms."""
        self.has_branches = False
        """Whether the requested correction depends on the direction of travel."""
        self.choose()

    def choose(self) -> None:
        """Determine the requested correction again, or put that off."""
        if self._member.put_off_correction():
            return
        plan = self._motion.plan
        self.base = NOTHING
        if self.is_enabled and plan.table is not None:
            self.base = spec_of_table(plan.table, plan.settings, digest=table_digest(plan.table))
        self.has_branches = self.base.has_branches
        self.requested = self.base if self.terms is None else self.terms.on(self.base, plan)

    def want(self) -> None:
        """Request the correction, if the positions of the axis are meaningful and nothing is fixed."""
        if self._reference.is_referenced and self._member.fixed is None:
            self._motion.compensation.want(self.requested)

    def enable(self, *, is_on: bool) -> None:
        """Apply the table or stop applying it, from the next different target on; it never moves the axis."""
        if not self._reference.is_remapped:
            self.is_enabled = is_on
        self.choose()
        self.want()

    def end_dry_run(self) -> None:
        """Apply what was only shown."""
        self.is_dry_run = False
        self.choose()

    def end(self) -> None:
        """Apply no table until the gateway restarts."""
        self.is_enabled = False
        self.former = ()
        self.choose()

    # --- its terms -------------------------------------------------------------------------------------

    def follow_terms(self, now_ns: int) -> None:
        """Update its terms; a changed line comes into force with different targets."""
        terms, plan = self.terms, self._motion.plan
        assert terms is not None
        if terms.follow(self.base, plan, now_ns):
            self.requested = terms.on(self.base, plan)
            self.want()
        self.report_terms(now_ns)

    def report_terms(self, now_ns: int) -> None:
        """Report changes in how well its terms are known."""
        if self.terms is not None:
            self._reports.add(self.terms.events(self._motion.plan.name, now_ns))

    def resume_terms(self, now_ns: int) -> None:
        """Continue its terms from what a record has put into force."""
        terms, spec = self.terms, self._motion.compensation.state.spec
        if terms is None or spec.curve is None:  # a plain offset has no table
            return
        terms.resume(spec, now_ns)
        self.requested = spec if spec.is_kin_of(self.base) else terms.on(self.base, self._motion.plan)
        self._motion.compensation.want(self.requested)

    # --- a stream that begins --------------------------------------------------------------------------

    def begin_stream(
        self, number: int, nominal_words: bytes, actual: Actual | None, former: tuple[CorrectionSpec, ...]
    ) -> None:
        """Put the offset that the drive already has into force before the first setpoint of a stream (M6).

        ``actual``: where the axis is; None: unknown, and nothing changes. ``former``: what the last run may
        have left in force.
        """
        plan, compensation = self._motion.plan, self._motion.compensation
        field_, settings = plan.command[number], plan.settings
        raw = field_.unpack(nominal_words)
        if actual is None or not isfinite(raw):
            return
        fields = (field_, plan.actual[0])
        slack = sum(0.5 * each.step_counts(settings.largest_counts) for each in fields)
        slack /= abs(settings.counts_per_unit)
        position = compensation.machine_position(actual.counts)
        slack += 0.0 if self.terms is None else min(self.terms.largest_at(position), settings.max_correction)
        specs = (self.base, *former)
        rest = compensation.assume_offset(actual.counts, counts_of(field_, raw), specs, slack)
        self._reports.begin_stream(compensation.state.spec.offset, rest)
