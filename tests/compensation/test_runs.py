"""A run of targets that go on in their direction leaves behind what each would have left by itself."""

from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.compensation.axis import AxisCompensation
from gateway.compensation.correction_map import IDENTITY
from gateway.compensation.correction_spec import CorrectionSpec, spec_of_table
from gateway.compensation.moves import EstimateKind, PositionEstimate
from gateway.compensation.settings import Setpoints
from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from tests.compensation.compensation_strategies import COUNTS_PER_UNIT, plain_settings, tables

MS = 1_000_000
WORN = make_table([0, 50, 100], [0.0, 0.02, 0.0], [-0.02, 0.0, -0.02], Units.MM)
BETWEEN = ("nothing", "looked at", "other correction", "seen")
"""What may happen while a target is on its way."""
STEPS = st.lists(
    st.tuples(
        st.integers(-3, 40),
        st.sampled_from(("nothing", "nothing", "nothing", *BETWEEN)),
        st.sampled_from((False, False, False, True)),
        st.sampled_from(("", "", "", "seen", "again")),
    ),
    min_size=1,
    max_size=30,
)


class Both:
    """The same axis twice: one that takes each target by itself, one that takes runs."""

    def __init__(self, table: CorrectionTable, counts_per_unit: float, setpoints: Setpoints) -> None:
        self.single, self.run = (
            AxisCompensation(plain_settings(counts_per_unit, setpoints=setpoints)) for _ in range(2)
        )
        self.specs = [spec_of_table(table, self.single.settings), CorrectionSpec(offset=0.01)]
        self.is_stream = setpoints is Setpoints.STREAM
        self.steps = 0
        for axis in (self.single, self.run):
            axis.find_reference(self.specs[0])

    def happens(self, what: str, corrected_counts: int) -> None:
        for axis in (self.single, self.run):
            if what == "other correction":
                axis.want(self.specs[1])
            elif what == "seen":
                axis.observe(corrected_counts)
        if what == "looked at":
            assert self.run.state is not None

    def go(self, nominal_counts: int, between: str, now_ns: int) -> int:
        accepted = self.single.accepted
        place = None if accepted is None else PositionEstimate(accepted.nominal_counts, EstimateKind.REACHED)
        is_reached = not self.is_stream and accepted is not None
        steady = self.run.plan_steady(nominal_counts, now_ns, is_reached) if self.run.is_steady else None
        move = self.single.plan(nominal_counts, place, now_ns)
        corrected_counts = nominal_counts + round(move.correction_counts)
        if steady is None:
            theirs = self.run.plan(nominal_counts, place, now_ns)
            assert theirs._replace(correction_map=IDENTITY) == move._replace(correction_map=IDENTITY)
            self.happens(between, corrected_counts)
            self.run.commit(theirs, corrected_counts, is_reached=is_reached)
        else:
            assert steady.correction_counts == move.correction_counts
            self.happens(between, corrected_counts)
            self.run.go_on(steady, corrected_counts, is_reached=is_reached)
            self.steps += 1
        self.single.commit(move, corrected_counts, is_reached=is_reached)
        return corrected_counts

    def are_equal(self) -> None:
        assert self.run.is_unsure == self.single.is_unsure
        assert self.run.is_passing == self.single.is_passing
        assert self.run.is_blending == self.single.is_blending
        assert self.run.state == self.single.state
        ours, theirs = self.run.readback, self.single.readback
        assert ours._replace(correction_map=IDENTITY) == theirs._replace(correction_map=IDENTITY)
        for position in (-7.0, 3.0, 50.0):
            assert ours.correction_map.correction(position) == theirs.correction_map.correction(position)
        assert self.run.accepted == self.single.accepted
        assert self.run.way == self.single.way
        assert self.run.is_steady == self.single.is_steady
        assert self.run.is_seen == self.single.is_seen


@given(tables(0.3), COUNTS_PER_UNIT, st.sampled_from(list(Setpoints)), STEPS)
@settings(max_examples=300)
def test_a_run_leaves_behind_what_its_targets_would_have_left_one_by_one(
    table: CorrectionTable,
    counts_per_unit: float,
    setpoints: Setpoints,
    steps: list[tuple[int, str, bool, str]],
) -> None:
    both = Both(table, counts_per_unit, setpoints)
    nominal_counts, now_ns = round(table.first * counts_per_unit), 0
    step = max(1, round((table.last - table.first) * abs(counts_per_unit) / 200))
    for distance, between, is_looked_at, afterwards in steps:
        nominal_counts += distance * step
        now_ns += MS
        corrected_counts = both.go(nominal_counts, between, now_ns)
        if afterwards == "again":
            both.single.touch(now_ns + 1)
            both.run.touch(now_ns + 1)
        else:
            both.happens(afterwards, corrected_counts - 1)
        if is_looked_at:
            both.are_equal()
    both.are_equal()


def test_a_run_of_a_thousand_setpoints_is_one() -> None:
    both = Both(WORN, 1000.0, Setpoints.STREAM)
    for number in range(1000):
        both.go(100 * number, "nothing", number * MS)
    assert both.steps >= 900
    both.are_equal()
