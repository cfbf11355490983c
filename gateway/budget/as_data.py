"""A budget as plain data, for ``--json`` and for the status. Times in milliseconds, to the microsecond."""

from gateway.budget.line import ControllerBudget, ExchangeBudget, ForwardingBudget, LineBudget
from gateway.budget.verdict import Remedy
from gateway.budget.wire import Wire
from gateway.plain import JsonObject
from gateway.times import NS_PER_MS, NS_PER_S


def _ms(span_ns: int) -> float:
    return round(span_ns / NS_PER_MS, 3)


def line_data(line: LineBudget) -> JsonObject:
    """Return the whole budget of a line."""
    return {
        "drives": {
            **_wire_data(line.drives),
            "gap_ms": _ms(line.gap_ns),
            "drive_gap_ms": _ms(line.drive_gap_ns),
            "broadcast_ms": _ms(line.broadcast_ns),
        },
        "drive_time_ms": {axis: _ms(response_ns) for axis, response_ns in line.response_ns.items()},
        "controllers": {
            controller.name: _controller_data(line, controller) for controller in line.controllers
        },
        "added_frames": [
            {
                "axis": each.added.axis,
                "why": each.added.why.value,
                "before": each.added.before.value,
                "hold_ms": _ms(each.hold_ns),
            }
            for each in line.added
        ],
    }


def _wire_data(wire: Wire) -> JsonObject:
    return {
        "baudrate_bd": wire.baudrate or None,
        "bits_per_character": wire.bits_per_byte or None,
        "character_us": round(wire.bits_per_byte * NS_PER_S / wire.baudrate / 1000, 3)
        if wire.baudrate
        else None,
        "wire_known": not wire.is_hidden,
        "silence_ms": _ms(wire.silence_ns),
    }


def _controller_data(line: LineBudget, controller: ControllerBudget) -> JsonObject:
    cycle = controller.round
    return {
        **_wire_data(controller.wire),
        "role": controller.role.value,
        "timeout_ms": _ms(controller.timeout_ns),
        "exchanges": [_exchange_data(controller, exchange) for exchange in controller.exchanges],
        "round": {
            "exchanges": len(controller.exchanges),
            "total_ms": _ms(cycle.total_ns),
            "direct_ms": _ms(cycle.direct_ns),
            "added_frames_ms": _ms(cycle.added_ns),
            "cut_through_ms": _ms(cycle.forwarded_ns),
        },
        "behind_others_ms": _ms(line.longest_other_ns(controller.index)),
    }


def _exchange_data(controller: ControllerBudget, exchange: ExchangeBudget) -> JsonObject:
    legs = exchange.legs
    return {
        "axis": exchange.step.axis or None,
        "what": exchange.step.what.value,
        "request_bytes": exchange.request_bytes,
        "reply_bytes": exchange.reply_bytes,
        "legs_ms": {
            "controller_to_gateway": _ms(legs.request_in_ns),
            "silence_after_request": _ms(legs.request_tail_ns),
            "gateway": _ms(legs.gateway_ns),
            "gap": _ms(legs.gap_ns),
            "gateway_to_drive": _ms(legs.request_out_ns),
            "drive": _ms(legs.drive_ns),
            "drive_to_gateway": _ms(legs.reply_in_ns),
            "silence_after_reply": _ms(legs.reply_tail_ns),
            "silence": _ms(legs.silence_ns),
            "gateway_to_controller": _ms(legs.reply_out_ns),
        },
        "cut_through": None if exchange.forwarding is None else _forwarding_data(exchange.forwarding),
        "total_ms": _ms(legs.total_ns),
        "waited_ms": _ms(legs.waited_ns),
        "direct_ms": _ms(exchange.direct.total_ns),
        "direct_waited_ms": _ms(exchange.direct.waited_ns),
        "added_frames_ms": _ms(exchange.added_ns),
        "timeout_share": round(legs.waited_ns / controller.timeout_ns, 4),
    }


def _forwarding_data(forwarding: ForwardingBudget) -> JsonObject:
    request, reply = forwarding.delays
    return {
        "request_lead_ms": _ms(request.delay_ns),
        "request_saves_ms": _ms(request.saves_ns),
        "reply_lead_ms": _ms(reply.delay_ns),
        "reply_saves_ms": _ms(reply.saves_ns),
        "total_ms": _ms(forwarding.legs.total_ns),
        "waited_ms": _ms(forwarding.legs.waited_ns),
    }


def remedy_data(remedy: Remedy) -> JsonObject:
    """Return one change and its effect."""
    return {
        "what": remedy.what,
        "waited_before_ms": _ms(remedy.waited_before_ns),
        "waited_ms": _ms(remedy.waited_ns),
        "round_before_ms": _ms(remedy.round_before_ns),
        "round_ms": _ms(remedy.round_ns),
    }
