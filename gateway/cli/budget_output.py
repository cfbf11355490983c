"""Terminal output of ``pitch-gateway budget``. Times in milliseconds; at most 80 columns."""

from collections.abc import Iterator, Sequence
from typing import Final

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from gateway.budget.line import ControllerBudget, ExchangeBudget, LineBudget
from gateway.budget.verdict import Remedy, ms
from gateway.budget.wire import Wire
from gateway.cli.output import StderrLine
from gateway.commissioning.budget import Budget, LineFigures
from gateway.state.plan import LinePlan
from gateway.times import NS_PER_MS, NS_PER_S
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

NUMBERS: Final = ("in", "gateway", "gap", "drives", "out", "sum", "direct", "time-out")
CLOSE: Final = 0.5
"""Share of a time-out from which a figure has another colour."""


def lines(budget: Budget) -> Iterator[RenderableType]:
    """Yield the budget of every line for a person, and the requirements that cannot be met."""
    for line in budget.lines:
        yield from _line(line)
    yield from (StderrLine(problem) for problem in budget.problems)
    yield from (StderrLine(f"warning: {warning}") for warning in budget.warnings)


def _line(figures: LineFigures) -> Iterator[RenderableType]:
    plan, line = figures.plan, figures.budget
    yield _words(f"[bold]line {plan.name}[/]: times in ms")
    yield _words(f"  drives: {_endpoint_text(plan.drives)}{_wire_text(line.drives)}")
    yield _words(f"  silence before each request to them: {ms(line.gap_ns)}{_whose(line)}")
    unknown = [axis.name for axis in plan.axes if axis.name not in line.response_ns]
    responses = [f"{ms(response_ns)} ({axis})" for axis, response_ns in line.response_ns.items()]
    responses += [f"not known, 0 assumed ({', '.join(unknown)})"] if unknown else []
    if responses:
        yield _words(f"  time that a drive takes itself: {', '.join(responses)}")
    if line.broadcast_ns:
        yield _words(f"  a broadcast keeps the line for {ms(line.broadcast_ns)} (turnaround_ms)")
    for controller in line.controllers:
        yield from _controller(figures, controller)
    yield from _added(line)


def _endpoint_text(endpoint: TcpEndpoint | SerialEndpoint) -> str:
    if isinstance(endpoint, TcpEndpoint):
        return "RTU over TCP" if endpoint.rtu else "TCP"
    return f"RTU {endpoint.baudrate} {endpoint.data_bits}{endpoint.parity}{endpoint.stop_bits}"


def _wire_text(wire: Wire) -> str:
    if wire.is_serial:
        return f", {wire.bits_per_byte * NS_PER_S / wire.baudrate / 1000:.1f} µs/character"
    if wire.is_hidden:
        return ", the wire behind the device server is unknown, 0 assumed"
    return ", 0 on the wire"


def _whose(line: LineBudget) -> str:
    if not line.gap_ns:
        return ""
    return " (gap_ms)" if line.drive_gap_ns > line.drives.silence_ns else " (the standard's)"


def _controller(figures: LineFigures, controller: ControllerBudget) -> Iterator[RenderableType]:
    line, link = figures.budget, figures.plan.controllers[controller.index]
    yield ""
    yield _words(
        f"[bold]controller {controller.name}[/] ({controller.role.value}): {_endpoint_text(link.endpoint)}"
        f"{_wire_text(controller.wire)}, time-out {controller.timeout_ns / NS_PER_MS:g}"
    )
    if not controller.exchanges:
        yield _words("  no axis on this line, so its frames are unknown; --registers N computes one")
        return
    yield _exchange_table(controller)
    cycle = controller.round
    often = f", that is {_rate(cycle.total_ns)}" if cycle.total_ns else ""
    yield _words(
        f"  a round of these {len(controller.exchanges)}: {ms(cycle.total_ns)}{often}; "
        f"without the gateway {ms(cycle.direct_ns)}"
    )
    if cycle.added_ns:
        yield _words(
            f"  frames added by the gateway can take {ms(cycle.added_ns)} more in a round, see below"
        )
    others_ns = line.longest_other_ns(controller.index)
    if others_ns:
        yield _words(f"  an exchange of another controller can come first: up to {ms(others_ns)} more")
    yield from _forwarding_rows(figures.plan, controller)
    yield from _remedies(figures.remedies[controller.name])


def _exchange_table(controller: ControllerBudget) -> Table:
    table = _table()
    table.add_column("  axis", overflow="fold")
    table.add_column("exchange", no_wrap=True)
    table.add_column("bytes", no_wrap=True)
    has_gap = any(exchange.legs.gap_ns for exchange in controller.exchanges)
    for name in NUMBERS:
        if name != "gap" or has_gap:
            table.add_column(name, justify="right", no_wrap=True)
    for exchange in controller.exchanges:
        table.add_row(*_row(exchange, controller.timeout_ns, has_gap=has_gap))
    return table


def _table() -> Table:
    return Table(box=None, padding=(0, 1), collapse_padding=True, pad_edge=False, header_style="bold")


def _words(markup: str) -> Text:
    return Text.from_markup(markup)


def _row(exchange: ExchangeBudget, timeout_ns: int, *, has_gap: bool) -> list[str]:
    legs, step = exchange.legs, exchange.step
    drive_ns = legs.request_out_ns + legs.drive_ns + legs.reply_in_ns + legs.reply_tail_ns
    share = legs.waited_ns / timeout_ns
    colour = "red" if share > 1.0 else "yellow" if share > CLOSE else "green"
    return [
        f"  {step.axis}",
        step.what.value,
        f"{exchange.request_bytes}+{exchange.reply_bytes}",
        ms(legs.request_in_ns + legs.request_tail_ns),
        ms(legs.gateway_ns),
        *([ms(legs.gap_ns)] if has_gap else ()),
        ms(drive_ns),
        ms(legs.silence_ns + legs.reply_out_ns),
        ms(legs.total_ns),
        ms(exchange.direct.total_ns),
        f"[{colour}]{100.0 * share:.1f} %[/]",
    ]


def _forwarding_rows(plan: LinePlan, controller: ControllerBudget) -> Iterator[RenderableType]:
    """Yield the gain from cut-through between two serial ports."""
    if not (isinstance(plan.drives, SerialEndpoint) and controller.wire.is_serial):
        return
    whose = "cut_through = true" if plan.cut_through else "with cut_through = true"
    found = [
        (each.step, each.forwarding)
        for each in controller.exchanges
        if each.forwarding and each.forwarding.saves_ns
    ]
    if not found:
        yield _words(f"  {whose} no frame would gain as much as a character")
        return
    table = _table()
    table.add_column(f"  {whose}", overflow="fold")
    for name in ("request sooner by", "reply sooner by", "sum"):
        table.add_column(name, justify="right")
    for step, forwarding in found:
        sooner = [ms(delay.saves_ns) if delay.saves_ns else "stored" for delay in forwarding.delays]
        table.add_row(f"  {step.axis} {step.what.value}", *sooner, ms(forwarding.legs.total_ns))
    table.add_row("  a round", "", "", ms(controller.round.forwarded_ns))
    yield table


def _remedies(found: Sequence[Remedy]) -> Iterator[RenderableType]:
    if not found:
        return
    table = _table()
    table.add_column("  what would help", overflow="fold")
    table.add_column("longest wait", justify="right")
    table.add_column("round", justify="right")
    for each in found:
        table.add_row(
            f"  {each.what}",
            f"{ms(each.waited_before_ns)} → {ms(each.waited_ns)}",
            f"{ms(each.round_before_ns)} → {ms(each.round_ns)}",
        )
    yield table


def _added(line: LineBudget) -> Iterator[RenderableType]:
    if not line.added:
        return
    yield ""
    yield _words("[bold]frames added by the gateway[/], only when needed")
    table = _table()
    for name in ("  axis", "what", "before"):
        table.add_column(name, overflow="fold")
    table.add_column("delays it by", justify="right")
    for each in line.added:
        added = each.added
        table.add_row(f"  {added.axis}", added.why.value, added.before.value, ms(each.hold_ns))
    yield table


def _rate(round_ns: int) -> str:
    """Return how often a round comes: with more than a second between rounds, the seconds.

    >>> _rate(242_000_000), _rate(1_000_000_000), _rate(1_250_000_000), _rate(30_000_000_000)
    ('4.1 a second', '1.0 a second', 'one in 1.25 s', 'one in 30 s')
    """
    if round_ns <= NS_PER_S:
        return f"{NS_PER_S / round_ns:.1f} a second"
    round_s = round_ns / NS_PER_S
    digits = 0 if round_s >= 9.95 else 1 if round_s >= 1.995 else 2
    return f"one in {round_s:.{digits}f} s"
