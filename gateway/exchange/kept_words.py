"""Which targets keep the words that the drive has, though another correction was requested since (M4, M11).

A repeat of a target gets the same words, so that the axis does not move. In a group, one axis must not keep
words of another switch, table or gain while another axis uses the requested one: the gantry would skew.
"""

from gateway.compensation.correction_spec import NOTHING, CorrectionSpec
from gateway.exchange.axis.axis import Axis
from gateway.exchange.field_counts import counts_of


def may_keep_words(axis: Axis, spec: CorrectionSpec) -> bool:
    """Whether a repeated target may keep its words, which were rendered with ``spec``.

    Words rendered with the requested correction are always right. Setpoints of a stream may keep others: the
    requested correction comes into force over the distance that they travel, and a repeat has no distance.

    In a group an axis may keep its words only if all axes keep theirs. An axis whose target was not
    acknowledged keeps none.
    """
    member = axis.member
    if member.gantry is None or axis.compensation.is_stream or not is_other(axis, spec):
        return True
    if member.fixed is not None:
        return member.fixed.keeps_words
    return all(keeps_other_words(each) for each in (axis, *axis.peers))


def keeps_other_words(axis: Axis) -> bool:
    """Whether its next target probably keeps words of another switch, table or gain.

    A target that has not come yet is unknown. It is assumed to be a repeat of the last one. If there is no
    last one, or the axis was moved otherwise since, no target can be a repeat. A target that was not
    acknowledged keeps none: if the axis is seen elsewhere, it is rendered again. An axis that has lost a
    target keeps none: its controller writes that target next, and it is probably a different one.
    """
    number, motion = axis.rules.staged, axis.motion
    if motion.unacknowledged is not None or axis.interlock.is_blocked:
        return False
    words = None if number is None else axis.fields[number].nominal_words
    if axis.targets.holds_unrun and number is not None and words is not None:
        spec = spec_of_words(axis, number, words)
        return spec is not None and is_other(axis, spec)
    if motion.superseded is not None:
        return is_other(axis, motion.superseded.move.state.spec)
    return axis.compensation.accepted is not None and is_other(axis, axis.compensation.state.spec)


def spec_of_words(axis: Axis, number: int, nominal_words: bytes) -> CorrectionSpec | None:
    """Return the correction of the words that a target may keep; None: it is a new target."""
    if may_have_gone_to(axis, number, nominal_words):
        assert axis.motion.unacknowledged is not None
        assert axis.motion.unacknowledged.move is not None
        return axis.motion.unacknowledged.move.state.spec
    superseded, accepted = axis.motion.superseded_as(number, nominal_words), axis.compensation.accepted
    if superseded is not None:
        return superseded.move.state.spec
    field = axis.plan.command[number]
    if accepted is None or counts_of(field, field.unpack(nominal_words)) != accepted.nominal_counts:
        return None
    return axis.compensation.state.spec


def is_repeat(axis: Axis, number: int, nominal_words: bytes) -> bool:
    """Whether these words are those that the drive already acknowledged for this command field (M4)."""
    image, motion = axis.fields[number], axis.motion
    return (
        image.nominal_words == nominal_words
        and axis.compensation.accepted is not None
        and not image.is_incomplete
        and image.corrected_words is not None
        and (number != motion.last_number or axis.correction.is_dry_run or motion.holds_target(number))
    )


def may_have_gone_to(axis: Axis, number: int, nominal_words: bytes) -> bool:
    """Whether these words are the absolute target that was sent last and not acknowledged."""
    unacknowledged, field = axis.motion.unacknowledged, axis.plan.command[number]
    if unacknowledged is None or unacknowledged.move is None or unacknowledged.is_distance:
        return False
    return counts_of(field, field.unpack(nominal_words)) == unacknowledged.move.nominal_counts


def is_other(axis: Axis, spec: CorrectionSpec) -> bool:
    """Whether a correction has another switch, table or gain than the one that applies now."""
    asked = axis.correction.requested if axis.member.goes_as_referenced else NOTHING
    if spec.curve is None or asked.curve is None:
        return spec.curve is not asked.curve
    is_same_table = spec.curve is asked.curve or spec.table_digest == asked.table_digest
    return not (is_same_table and spec.gain == asked.gain)
