"""What ``probe --timing`` says of a line."""

from collections.abc import Iterator

from gateway.cli.probing.timing import LineTimes, Proposal, UnitTimes


def timing_lines(found: LineTimes) -> Iterator[str]:
    """Yield what was measured of a line, what is proposed and what it costs."""
    line = found.line
    yield f"line {line.name}: answers to reads, from the request to the last byte, in ms"
    yield from (f"  {_of_unit(unit)}" for unit in found.units)
    yield from (f"  {left_out}" for left_out in found.left_out)
    for gap_ms, lost in found.lost_with_gap.items():
        what = f"{lost} answers lost" if lost else "nothing lost"
        yield f"  {gap_ms:g} ms of silence before each request, all drives in turn: {what}"
    proposed = found.proposed
    if proposed is None:
        yield f"  error: {found.problem}"
        return
    yield f"  now:      {_keys(found.now)}"
    yield f"  proposed: {_keys(proposed)}"
    cost_ms, now_ms = found.cost_ms(proposed), found.cost_ms(found.now)
    times = "three times" if line.timing.backs_off else "each time"
    yield f"  a drive that falls silent keeps others waiting {times}: {cost_ms:g} ms; now {now_ms:g} ms"
    yield from (f"  note: {note}" for note in _notes(found, proposed))


def _of_unit(unit: UnitTimes) -> str:
    who = f"axis {unit.axis}, unit id {unit.unit_id}"
    if not unit.took_ms:
        return f"{who}: no answer"
    lost = f"{unit.lost} lost" if unit.lost else "none lost"
    return (
        f"{who}: {len(unit.took_ms)} answers, half within {unit.within(0.5):.2f}, 99 % within "
        f"{unit.within(0.99):.2f}, longest {max(unit.took_ms):.2f}, {lost}"
    )


def _keys(of: Proposal) -> str:
    drain = "" if of.drain_ms is None else f", drain_ms = {of.drain_ms:g}"
    return f"response_timeout_ms = {of.response_timeout_ms:g}{drain}, gap_ms = {of.gap_ms:g}"


def _notes(found: LineTimes, proposed: Proposal) -> Iterator[str]:
    yield (
        "only reads were measured: a drive that stores what it is told may need longer; raise "
        "response_timeout_ms where writes are not answered in time"
    )
    if found.gap_ms is not None and found.gap_ms < proposed.gap_ms:
        yield (
            f"nothing was lost with {found.gap_ms:g} ms of silence; gap_ms = {proposed.gap_ms:g} is "
            "configured or stands in the register map of a drive: shorten it only where no manual asks for it"
        )
    patient = [
        f"{controller.plan.name} ({controller.plan.timeout_ms:g})"
        for controller in found.line.controllers
        if controller.plan.timeout_ms > proposed.response_timeout_ms
    ]
    if patient:
        shortest_ms = proposed.response_timeout_ms + (proposed.drain_ms or 0.0)
        yield (
            f"a drive is waited for as long as the most patient controller waits: timeout_ms of "
            f"{', '.join(patient)}; with {proposed.response_timeout_ms:g} there a silent drive costs "
            f"{shortest_ms:g} ms"
        )
