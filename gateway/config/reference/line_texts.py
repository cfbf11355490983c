"""Texts of ``[line.NAME]``."""

from typing import Final

from gateway.config.reference.text import Said, Texts

LINE: Final[Texts] = {
    "drives": Said(
        more="See below",
    ),
    "response_timeout_ms": Said(
        more="The gateway never gives up before its controllers would, but for trials (`retry_ms`)",
    ),
    "drain_ms": Said(
        meaning=(
            "RTU drives: silence that must follow a time-out before its unit id is asked again, so that a "
            "late reply answers nothing else. Reads of other unit ids need not wait for it, writes do, "
            "unless the silent drive has left three requests in a row unanswered and was never late; one "
            "that was late keeps everybody waiting for ten minutes after. What waits for its own unit id "
            "and could leave only with less than half of its controller's `timeout_ms` left gets 0x0B at "
            "once instead (counter `too_late`). Refused with `tcp` drives, whose replies carry a number"
        ),
        default="`response_timeout_ms`",
    ),
    "retry_ms": Said(
        meaning=(
            "requests to a unit id that left three in a row unanswered, and to its group, are answered "
            "with 0x0B at once, on RTU too. After `retry_ms`, then after twice as long each time up to 10 "
            "s, the next one is sent as a trial, behind a read where it might move something; any frame "
            "of the drive ends that. A read that is a trial is waited for `response_timeout_ms`, and so "
            "long it costs the others of the line. The same stop to a silent drive goes once in "
            "`retry_ms` at most. `0`: it is always asked, and the others wait for each time-out"
        ),
    ),
    "connect": Said(
        meaning=(
            '`"on-demand"`: the connection to the drives is made for a request, and closed when none has '
            "been answered for a second and nothing is staged, under way or unproven; with the next one "
            "homed bits and actual positions are read first. For servers with few connections. Refused "
            'with axes whose `referenced` is `"homing"` or `"set-position"`: nobody would see that their '
            "drive was switched off"
        ),
    ),
    "connect_delay_ms": Said(
        meaning=(
            "for servers that stay mute when they are asked as soon as they have accepted: so long nothing "
            "is sent on a connection, stops neither. A request waits for its connection for half of its "
            "controller's `timeout_ms` at most: keep it below that"
        ),
    ),
    "max_connection_s": Said(
        meaning=(
            "for servers that serve no connection for longer: it is closed and made anew once nothing is "
            "outstanding, staged, under way or unproven. `0`: it stays"
        ),
    ),
    "turnaround_ms": Said(
        more="As in Modbus over serial line V1.02, 2.4.1",
    ),
    "gap_ms": Said(
        meaning=(
            "silence before each request, beyond the standard's 3.5 characters. The longest of this "
            "and of the `registers.gap_ms` of its axes holds for the line"
        ),
    ),
    "quiet_ms": Said(
        meaning=(
            "a request of a `monitor` goes directly after an exchange of a `motion` controller has "
            "ended, or after `quiet_ms` without one: the next motion command then finds the line free. "
            "Longer than the pauses inside one cycle of the motion controller, shorter than its cycle"
        ),
    ),
    "cut_through": Said(
        meaning=(
            "`true`: where controller and drives are both on serial ports a request that is known begins "
            "to leave while it still arrives, and so does its reply; all else is stored and forwarded. "
            "Of a write of one position 4 of 13 characters are waited for, of its reply 2 of 8. What turns "
            "out to be damaged, or may not pass, ends with a check sum of which both bytes are wrong: only "
            "for drives that look at the check sum of what they are told"
        ),
    ),
    "other_units": Said(
        meaning=(
            "unit ids of further devices on the line: what is for them passes as it is, and is no trouble. "
            "On Modbus/TCP with one axis a write to a unit id that is not named is refused with 0x0A where "
            "it would reach a position, trigger, mode or limit of the axis: many drives do not look at it. "
            "Between serial ports (`rtu` on both sides) such a device may also take and answer frames of "
            "another length than their function code says, as some inverters do: `05 03 01 01 30 B8`. All "
            "bytes between two silences are then one frame, which counts as a write and leaves some 30 ms "
            "after its last byte: let the controller wait for 100 ms at least. Never for unit id 0"
        ),
        default="none",
    ),
    "answers_as": Said(
        meaning=(
            "the unit id in the replies of a Modbus/TCP drive that answers with 0, 1 or 255 whatever it is "
            "asked. It is not told of any more (event `wrong-unit`)"
        ),
        default="its own",
    ),
    "monitor_max_wait_ms": Said(
        meaning=(
            "a request of a `monitor` that has waited for as long goes at the next gap, though it does "
            "not fit. All monitors of a line share this: only one such request in "
            "`monitor_max_wait_ms`, and only a tenth of the line's time for all of them. Where many "
            "monitors do not fit, give them a longer `timeout_ms` or let them ask less often. Warned "
            "of: a `timeout_ms` of such a controller that is not longer"
        ),
    ),
}

RS485: Final = Said(
    meaning=(
        "only with `rtu`: the kernel switches the direction of the line with RTS, before and after each "
        "frame (TIOCSRS485), with the delays of the device tree. A driver that cannot, as that of most USB "
        "adapters, refuses, and so does the start of the gateway: those adapters switch by themselves. "
        "`false`: it is left as it is"
    ),
)

DRIVES: Final[Texts] = {
    "rs485": RS485,
    "rtu": Said(
        meaning=(
            "serial port with Modbus RTU. A name from `/dev/serial/by-id` stays the same when adapters "
            "are replugged"
        ),
    ),
    "baudrate": Said(
        more="Only with `rtu`",
    ),
    "parity": Said(
        more="Only with `rtu`",
    ),
    "stop_bits": Said(
        more="Only with `rtu`",
    ),
    "data_bits": Said(
        more="Only with `rtu`",
    ),
    "echo": Said(
        meaning=(
            "only with `rtu`: the RS-485 adapter hears what it sends, so that what the gateway sends comes "
            "back, and is taken out. Of a controller's port the first reply tells without it"
        ),
    ),
    "low_latency": Said(
        meaning=(
            "only with `rtu`: the driver of the port is set to hand bytes over at once, where it can "
            "(see [operations.md](operations.md)); `false`: it is left as it is, and only shown"
        ),
    ),
}

CONTROLLERS: Final[Texts] = {
    "rs485": RS485,
    "rtu_over_tcp": Said(
        meaning=(
            "address to listen on for a controller that sends RTU frames over TCP: a device server that "
            "connects (its mode is often named TCP client), or a program. Silence where RTU has silence; no "
            "transaction ids, so one connection has one request at a time"
        ),
    ),
    "rtu": Said(
        meaning="serial port that the controller is wired to",
    ),
    "tcp": Said(
        meaning=(
            "address to listen on. `0.0.0.0` stands for all IPv4 addresses of this machine, `[::]` for its "
            'IPv6 addresses alone: for both write two controllers, `tcp = "0.0.0.0:502"` and '
            '`tcp = "[::]:502"`, each with `allow` networks of its own kind'
        ),
    ),
    "role": Said(
        meaning=(
            "`motion` may do everything and goes first; `operator` may read, and stop the axes; "
            "`monitor` may only read. What a role may not do is answered with exception 1"
        ),
    ),
    "read_only": Said(more="No stop either"),
    "unit_ids": Said(
        meaning=(
            "unit ids that it may speak to. On a serial line a broadcast (0) reaches every drive: it takes "
            "0 and the "
            "unit ids of all axes of the line"
        ),
        default="all",
    ),
    "function_codes": Said(meaning="function codes that it may use", default="all"),
    "readable": Said(
        meaning=(
            'addresses that it may read, as in `[0x0520, "0x0606-0x0607"]`; a request has to stay inside '
            "one of them. "
            "Registers, coils and inputs alike"
        ),
        kind="list of addresses",
        default="all",
    ),
    "writable": Said(
        meaning="addresses that it may write; in the same way", kind="list of addresses", default="all"
    ),
    "requests_per_s": Said(
        meaning=(
            "requests in a second over all its connections, in the mean; after a pause as many at once as "
            "in one second"
        ),
        default="no limit",
    ),
    "max_connections": Said(more="Not with `rtu`"),
    "connects_per_s": Said(
        meaning=(
            "connections that one host may open in a second, in the mean; after a pause as many at once as "
            "`max_connections`. One that got an answer before it ended is not counted, up to a thousand a "
            "second; with `tls` each is. Not with `rtu`"
        ),
    ),
    "idle_timeout_s": Said(
        meaning="a connection that sent no whole request for so long is closed. Not with `rtu`",
        default="never",
    ),
    "silent_after_s": Said(
        meaning=(
            "after so many seconds without a request of this controller its axes are not healthy any more: "
            "page, `status`, MQTT and metrics say since when (troubles `controller-absent`, "
            "`controller-silent`). Set it longer than the controller ever stays away: `90000` for one that "
            "comes once a day. `0`: it may stay away; no warning. A reload takes it over"
        ),
        default="5 for the motion controllers of a line together: one that asks is enough. Others: `0`",
    ),
    "allow": Said(
        meaning=(
            'who may connect, as in `["192.168.0.0/24", "fd00::/8"]`; with `[]` whoever reaches the '
            "address. Not with `rtu`"
        ),
    ),
    "tls": Said(
        more="Only with `tcp`, see below",
    ),
    "roles": Said(
        more="See below",
        kind="tables",
        default="none",
    ),
}

TLS: Final[Texts] = {
    "key": Said(
        meaning=(
            "file with the key of that certificate, not encrypted, readable by the gateway's user only; or "
            '`"credential:NAME"`, as systemd hands it over with `LoadCredential=`'
        ),
    ),
}

ROLES: Final[Texts] = {
    "role": CONTROLLERS["role"],
    "requests_per_s": Said(kind="number > 0"),
}
