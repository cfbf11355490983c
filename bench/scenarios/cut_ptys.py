"""Cut-through over pseudo terminals with paced wires, while the machine is idle and while it is busy."""

import json
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, Final

from bench.context import Bench
from bench.errors import BenchError
from bench.figures import Interval
from bench.gateway_process import gateway_command, start_gateway
from bench.gateway_setup import Controller, GatewaySetup, LineSetup
from bench.measuring import Load, Way, start_drive
from bench.places import ROOT
from bench.processes import Process, Processes, environment
from bench.realtime import realtime_refused
from bench.results import Goal, Section, Table
from bench.serial_times import BITS_PER_CHARACTER, round_trip_ns
from gateway.exchange.cut_through.delay import guard_ns
from gateway.simulator.pty import Pty
from gateway.times import NS_PER_S, NS_PER_US

BAUDRATE: Final = 9600
GUARD: Final = guard_ns(BITS_PER_CHARACTER * NS_PER_S // BAUDRATE)
RELAY_PRIORITY: Final = 50
ENDS_PRIORITY: Final = 60
"""Wires, controller and drive keep better time than what is measured, where that is allowed."""
WITNESS_PRIORITY: Final = 99
WITNESS_PERIOD_US: Final = 100
WITNESS_LATE_US: Final = 50
"""A witness on each processor, above all others, notes when it came so late: what stood still then was the
machine, whatever else is late."""
Late = Sequence[Sequence[int]]
"""What one witness noted: when it should have run, and how late it was, in ns."""
ENDLESS: Final = "while True: pass"
KINDS: Final = ("write", "cycle")
ROUND: Final = 150
"""Exchanges of each kind in a round: one ends after ten that went wrong."""
LEARNED: Final = 120
"""The first exchanges of each kind, from which the ports learn what they need."""
BUSY_FIFO: Final = "a busy machine, `fifo`"


@dataclass(frozen=True)
class Case:
    """One way to run the gateway."""

    name: str
    rounds: int
    cuts_through: bool = True
    fifo: bool = False
    is_busy: bool = False


CASES: Final = (
    Case("stored, an idle machine", 1, cuts_through=False),
    Case("an idle machine", 3),
    Case(BUSY_FIFO, 12, fifo=True, is_busy=True),
    Case("a busy machine", 3, is_busy=True),
)


@dataclass
class Seen:
    """What was seen of one case."""

    writes_ns: list[int]
    """How long writes took, of those that were measured."""
    answered: int = 0
    failed: int = 0
    """Replies that did not come, or that were no frame."""
    written: int = 0
    """Writes that the drive took beyond those that its controller sent."""
    pauses_us: list[int] = field(default_factory=list)
    """Pauses inside of frames, how long."""
    excused: int = 0
    """Of these pauses, those that would not have been had no processor stood still."""
    stood: int = 0
    """How often one stood still for longer than the guard."""
    stood_us: int = 0
    """And the longest of that."""
    through: str = ""
    spoilt: str = ""

    torn: int = 0
    """Frames that the gateway says it may have torn, by the clock before and after each write."""

    @property
    def own(self) -> Interval:
        """Those of them that were its own doing.

        Nobody knows which of them had the pauses that are excused: at least what is left without these, at
        most all of them.
        """
        least = max(0, self.torn - self.excused)
        return Interval(least, least, self.torn)


def add_to(section: Section, bench: Bench) -> None:
    """Measure all cases, and add them to a section."""
    refused = realtime_refused(ENDS_PRIORITY)
    section.text.append(
        f"In real time: wires of {BAUDRATE} Bd with 10 bits for a character between pseudo terminals, as "
        "processes of their own, a controller and a drive in C, all of them on another processor than the "
        "gateway: real wires and drives take none of its time. The controller writes positions; then it "
        "writes one, reads it back and reads four registers in turns. *Pauses* is how often a wire was "
        "silent inside of a frame, for less than half of the silence between two: what is longer passes for "
        "one; *asked again* how many replies did not come or were no frame. Busy: an endless loop for each "
        "processor, at the usual priority. A witness on each "
        f"processor asks for it every {WITNESS_PERIOD_US} µs with SCHED_FIFO {WITNESS_PRIORITY}, above "
        "everything else: *stood still* is how often it came later than the guard of a frame "
        f"({GUARD // NS_PER_US} µs), and the longest. Then the kernel or the host of a virtual machine "
        "had the processor, and no program could have written. *Torn* is what the gateway says of itself, by "
        "the clock before and after each write. What it wrote in time can come late on the wire all the "
        "same: between pseudo terminals a worker of the kernel carries it, at the usual priority. A pause is "
        "excused where one processor, by its witness, stood still for at least as long as the pause, between "
        "one guard before the wire was empty and the next byte: without that it would not have been. Nobody "
        "knows which torn frames these pauses were in: the gateway's own doing are at least as many as are "
        "left without them, and at most all."
    )
    if refused:
        section.text.append(f"This machine refuses real-time scheduling: {refused}.")
    rows = []
    for case in CASES:
        if case.fifo and refused:
            continue
        bench.say(f"cut-through between pseudo terminals: {case.name}")
        seen = _seen(bench, case, 0 if refused else ENDS_PRIORITY)
        rows.append(_row(case, seen))
        section.goals += _goals(case, seen)
    heads = (
        "", "write p50 ms", "added ÷ direct", "exchanges", "cut through", "spoilt", "asked again",
        "pauses", "of them excused", "longest µs", "torn", "stood still", "longest µs",
    )  # fmt: skip
    caption = f"Between pseudo terminals, {BAUDRATE} Bd. Cut through and spoilt: requests + replies."
    section.tables.append(Table(heads, tuple(rows), caption))


def _row(case: Case, seen: Seen) -> tuple[str, ...]:
    write_ns = median(seen.writes_ns)
    added = write_ns / round_trip_ns(BAUDRATE, 1) - 1
    counts = (
        seen.answered, seen.through, seen.spoilt, seen.failed, len(seen.pauses_us), seen.excused,
        max(seen.pauses_us, default=0), seen.torn, seen.stood, seen.stood_us,
    )  # fmt: skip
    return (case.name, f"{write_ns / 1e6:.2f}", f"{added:.3f}", *map(str, counts))


def _goals(case: Case, seen: Seen) -> list[Goal]:
    if not case.cuts_through:
        return []
    what = f"cut-through between pseudo terminals, {case.name}, {seen.answered} exchanges"
    goals = [
        Goal(f"{what}: writes that a drive took and its controller had not sent", 0.0, _sure(seen.written))
    ]
    if case.name == BUSY_FIFO:
        remark = f"{seen.torn} torn, {seen.excused} pauses because a processor stood still"
        goals.append(Goal(f"{what}: frames torn by the gateway", 0.0, seen.own, remark=remark))
    return goals


def _sure(number: int) -> Interval:
    return Interval(number, number, number)


def _seen(bench: Bench, case: Case, priority: int) -> Seen:
    seen, ends = Seen([]), bench.processors.other
    with ExitStack() as stack:
        processes = stack.enter_context(Processes())
        wires: list[Process] = []

        def wire() -> tuple[Pty, Pty]:
            left, right = (stack.enter_context(closing(Pty())) for _ in range(2))
            fds = (left.master_fd, right.master_fd)
            words = [str(bench.programs.wire), *map(str, (BAUDRATE, *fds, priority))]
            wires.append(
                processes.start(f"cut-wire-{len(wires)}", words, cpus=ends, fds=fds, is_talking=True)
            )
            return left, right

        (near, front), (back, far) = wire(), wire()
        line = LineSetup(
            (Controller(tty=front.path),),
            drive_tty=back.path,
            baudrate=BAUDRATE,
            cuts_through=case.cuts_through,
        )
        setup = GatewaySetup((line,), fifo=RELAY_PRIORITY if case.fifo else None)
        gateway = start_gateway(processes, "gateway-cut", setup, cpus=bench.processors.one)
        drive = start_drive(processes, bench.programs, [f"tty:{far.path}"], fifo=priority, cpus=ends)
        way = Way.tty(near.path)
        for _ in range(2):  # the first may have been answered what was asked before the gateway was there
            bench.meter.wait_until_serving(way)
        sent = 0
        for kind in KINDS:
            sent += _writes(kind, bench.meter.attempt(way, Load(LEARNED, kind, warmup=0))[0]["sent"])
        for number in range(len(os.sched_getaffinity(0)) if case.is_busy else 0):
            processes.start(f"busy-{number}", [sys.executable, "-c", ENDLESS])
        witnesses = _witnesses(bench, processes) if priority else []
        for _ in range(bench.effort.of(case.rounds, 1)):
            for kind in KINDS:
                said, took_ns = bench.meter.attempt(
                    way, Load(ROUND, kind, warmup=0, fifo=priority, cpus=ends)
                )
                seen.answered += said["answered"]
                seen.failed += said["timeouts"] + said["wrong"]
                sent += _writes(kind, said["sent"])
                seen.writes_ns += took_ns if kind == "write" else []
        if case.cuts_through:
            seen.through, seen.spoilt, seen.torn = _status(gateway.config)
        seen.written = drive.stop()["writes"] - sent
        pauses = [pause for each in wires for pause in json.loads(processes.stop(each))]
        late = [json.loads(processes.stop(witness)) for witness in witnesses]
    seen.pauses_us = [pause_ns // NS_PER_US for _, pause_ns in pauses]
    seen.excused = sum(is_excused(pause, late) for pause in pauses)
    longer = [late_ns for each in late for _, late_ns in each if late_ns > GUARD]
    seen.stood, seen.stood_us = len(longer), max(longer, default=0) // NS_PER_US
    return seen


def _witnesses(bench: Bench, processes: Processes) -> list[Process]:
    words = [str(bench.programs.witness), *map(str, (WITNESS_PERIOD_US, WITNESS_LATE_US, WITNESS_PRIORITY))]
    return [
        processes.start(f"witness-{cpu}", words, cpus=(cpu,), is_talking=True)
        for cpu in sorted(os.sched_getaffinity(0))
    ]


def is_excused(pause: Sequence[int], witnesses: Iterable[Late]) -> bool:
    """Whether the byte behind a pause would have come in time had no processor stood still.

    One of them did so for as long as the pause, since the guard of the frame was due.

    Args:
        pause: when the byte behind it came, and how long it was, in ns.
        witnesses: what that of each processor noted.
    """
    came_ns, pause_ns = pause
    guarded_ns = came_ns - pause_ns - GUARD
    stood_ns = (
        sum(max(0, min(due_ns + late_ns, came_ns) - max(due_ns, guarded_ns)) for due_ns, late_ns in late)
        for late in witnesses
    )
    return any(each_ns >= pause_ns for each_ns in stood_ns)


def _writes(kind: str, sent: int) -> int:
    """Return how many of so many requests were writes: all of them, or the first of each three."""
    return sent if kind == "write" else -(-sent // 3)


def _status(config: Path) -> tuple[str, str, int]:
    """Return how many requests and replies were cut through, how many were spoilt, and how many torn."""
    done = subprocess.run(
        gateway_command("status", config, "--json"),
        capture_output=True, text=True, check=False, cwd=ROOT, env=environment(), timeout=60,
    )  # fmt: skip
    if done.returncode:
        raise BenchError(f"the gateway does not say what it cut through: {done.stderr or done.stdout}")
    (line,) = json.loads(done.stdout)["lines"].values()
    both: list[dict[str, Any]] = [line["cut_through"][what] for what in ("requests", "replies")]
    through = " + ".join(str(each["cut_through"]) for each in both)
    spoilt = " + ".join(str(sum(each["spoilt"].values())) for each in both)
    return through, spoilt, line["cut_through"]["torn"]
