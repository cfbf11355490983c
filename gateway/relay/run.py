"""The relay as a process: loop, signals, log, a clean end."""

import asyncio
import contextlib
import gc
import signal
import sys
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Final

from gateway.exchange.plan import CompensationMode
from gateway.ipc.plan import GatewayPlan
from gateway.relay.gateway import Relay
from gateway.relay.journal import Note, Severity

SWITCH_INTERVAL_S: Final = 1e-4
"""How long another thread may keep the interpreter from the loop. The relay has none of its own but the one
that looks up host names; the default of 5 ms would be fifty exchanges."""
AXIS_FIELDS: Final = (
    "compensation",
    "direction",
    "nominal_setpoint",
    "corrected_setpoint",
    "correction",
    "nominal_actual",
    "corrected_actual",
    "units",
)
SHADOW_MEANS: Final = "corrections are computed and shown; positions pass unchanged in both directions"


def run_relay(plan: GatewayPlan, write: Callable[[Note], None], status_every_s: float = 0.0) -> None:
    """Run until SIGTERM or SIGINT, then stop cleanly. ``status_every_s`` 0: no status lines.

    Raises:
        StartError: a listener or port cannot be opened.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    with asyncio.Runner(loop_factory=_loop_factory()) as runner:
        runner.run(_serve(plan, write, status_every_s))


def _loop_factory() -> Callable[[], asyncio.AbstractEventLoop]:
    """Take uvloop where it is installed; everything runs without it as well, a little slower."""
    try:
        factory: Callable[[], asyncio.AbstractEventLoop] = import_module("uvloop").new_event_loop
    except ImportError:
        return asyncio.new_event_loop
    return factory


async def _serve(plan: GatewayPlan, write: Callable[[Note], None], status_every_s: float) -> None:
    loop = asyncio.get_running_loop()
    stopping = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stopping.set)
    log = _Log(write)
    log.plan(plan, loop)
    relay = Relay(plan, write)
    await relay.start()
    log.ready(relay)
    gc.collect()
    gc.freeze()  # what was loaded stays for good: no collection needs to look at it again
    status = asyncio.create_task(_status_lines(relay, log, status_every_s))
    await stopping.wait()
    log.say("stopping", detail="the exchange on the wire is finished first")
    status.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await status
    await relay.stop()
    log.say("stopped")


async def _status_lines(relay: Relay, log: "_Log", every_s: float) -> None:
    while every_s > 0:
        await asyncio.sleep(every_s)
        log.status(relay.status())


class _Log:
    """What a person sees of the process itself."""

    def __init__(self, write: Callable[[Note], None]) -> None:
        self._write = write

    def say(self, event: str, severity: Severity = Severity.INFO, **fields: object) -> None:
        self._write(Note(severity, event, fields, time.time()))

    def plan(self, plan: GatewayPlan, loop: asyncio.AbstractEventLoop) -> None:
        self.say("starting", gateway=plan.name, loop=type(loop).__module__.partition(".")[0])
        for line in plan.lines:
            controllers = [f"{link.plan.name} ({link.plan.role.value})" for link in line.controllers]
            self.say("line", line=line.name, drives=str(line.drives), controllers=controllers)
            for axis in line.axes:
                self.say(
                    "axis",
                    line=line.name,
                    axis=axis.name,
                    unit_id=axis.unit_id,
                    compensation=axis.compensation.value,
                    table=axis.table_name or None,
                )
                if axis.compensation is CompensationMode.SHADOW:
                    self.say("shadow", Severity.WARNING, axis=axis.name, detail=SHADOW_MEANS)

    def ready(self, relay: Relay) -> None:
        addresses = {
            f"{line}/{controller}": [str(address) for address in where]
            for (line, controller), where in relay.addresses.items()
        }
        self.say("ready", addresses=addresses)

    def status(self, status: Mapping[str, Mapping[str, object]]) -> None:
        for name, axis in status["axes"].items():
            assert isinstance(axis, Mapping)
            self.say("status", axis=name, **{field: axis[field] for field in AXIS_FIELDS if field in axis})
        for name, line in status["lines"].items():
            assert isinstance(line, Mapping)
            self.say("status", line=name, state=line["state"], exchanges=line["exchanges"])
