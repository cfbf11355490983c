"""A contact that opens when something is wrong: a coil or a GPIO line, kept closed while all is well.

It is written again and again. So the watchdog of a Modbus device opens the contact if the supervisor, its
computer or the cable dies. The device is on no line of drives, so neither the relay nor a drive waits for it.
A GPIO line has no watchdog: the kernel takes it back when the supervisor ends.
"""

import asyncio
import contextlib
from collections.abc import Callable
from typing import Final

from gateway.backoff import Backoff
from gateway.catalogue.sensor_events import ALARM_OUTPUT_FAILED, ALARM_OUTPUT_WORKS
from gateway.config.gateway_model import AlarmOutputSection
from gateway.status.model import AlarmOutputStatus, Model
from gateway.supervisor.active_alarms import is_fresh
from gateway.supervisor.contacts import ContactError, Switch, connected, contact_of, name_of
from gateway.supervisor.event_log import LogEvent

FIRST_PAUSE_S: Final = 0.1
LONGEST_PAUSE_S: Final = 3.0
"""Before the next attempt, while the device cannot be reached or does not reply."""
ENDS_WITHIN_S: Final = 2.0
"""At the end of the supervisor the contact is opened, or left to the watchdog of its device."""
WELL: Final = {"error": ("healthy", "waiting", "warning"), "warning": ("healthy", "waiting")}
"""By ``opens_on``: verdicts at which the contact is closed."""


class AlarmOutput:
    """Keeps the contact of a configuration.

    ``model`` returns the newest status; None: there is none yet.
    """

    def __init__(self, model: Callable[[], Model | None], log: LogEvent) -> None:
        self._model = model
        self._log = log
        self._section: AlarmOutputSection | None = None
        self._writer: asyncio.Task[None] | None = None
        self._ends = asyncio.Event()
        """Set: the writer opens the contact and ends."""
        self._wakes = asyncio.Event()
        """Set: the writer does not wait for its next write."""
        self._is_closed: bool | None = None
        self._problem: str | None = None

    @property
    def status(self) -> AlarmOutputStatus:
        """Return the contact, and as what it was last acknowledged."""
        section = self._section
        if section is None:
            return AlarmOutputStatus()
        return AlarmOutputStatus(
            contact=", ".join(contact_of(section)), is_closed=self._is_closed, problem=self._problem
        )

    def follow(self, section: AlarmOutputSection | None) -> None:
        """Use the contact of a configuration. One that is no longer in it is opened."""
        if section == self._section:
            return
        self._section, self._is_closed, self._problem = section, None, None
        self._ends.set()
        self._wakes.set()
        if section is not None:
            self._ends, self._wakes = asyncio.Event(), asyncio.Event()
            self._writer = asyncio.create_task(self._write(section, self._ends, self._wakes, self._writer))

    def changed(self) -> None:
        """Compare the contact with the newest status: it is switched immediately."""
        section = self._section
        if section is not None and self._is_closed is not None and self._is_closed != self._is_well(section):
            self._wakes.set()

    async def run(self) -> None:
        """Wait until cancelled; then open the contact."""
        try:
            await asyncio.get_running_loop().create_future()
        finally:
            self._ends.set()
            self._wakes.set()
            if self._writer is not None:
                await asyncio.wait([self._writer], timeout=ENDS_WITHIN_S)
                self._writer.cancel()

    def _is_well(self, section: AlarmOutputSection) -> bool:
        model = self._model()
        return model is not None and is_fresh(model) and model.verdict.state in WELL[section.opens_on]

    async def _write(
        self,
        section: AlarmOutputSection,
        ends: asyncio.Event,
        wakes: asyncio.Event,
        before: asyncio.Task[None] | None,
    ) -> None:
        """Switch the contact until ``ends`` is set; ``before`` opens its own contact first."""
        if before is not None:
            await asyncio.wait([before])
        pause = Backoff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        while not ends.is_set():
            try:
                await self._write_connected(section, ends, wakes, pause)
            except ContactError as error:
                self._fail(section, str(error))
                await _at_most(ends, pause.next_s())

    async def _write_connected(
        self, section: AlarmOutputSection, ends: asyncio.Event, wakes: asyncio.Event, pause: Backoff
    ) -> None:
        async with connected(section) as switch:
            while not ends.is_set():
                await self._switch(switch, section, is_closed=self._is_well(section))
                pause.reset()
                await _at_most(wakes, section.every_s)
                wakes.clear()
            after = self._section
            if after is section or after is None or contact_of(after) != contact_of(section):
                await self._switch(switch, section, is_closed=False)

    async def _switch(self, switch: Switch, section: AlarmOutputSection, *, is_closed: bool) -> None:
        problem = await switch(is_closed)
        if section is not self._section:  # replaced meanwhile: the status shows another one
            return
        if problem is not None:
            self._fail(section, problem)
        else:
            if self._problem is not None:
                self._problem = None
                self._log(ALARM_OUTPUT_WORKS)
            self._is_closed = is_closed

    def _fail(self, section: AlarmOutputSection, why: str) -> None:
        if section is not self._section:
            return
        self._is_closed = None
        is_new = self._problem is None
        self._problem = f"{name_of(section)}: {why}"
        if is_new:
            self._log(ALARM_OUTPUT_FAILED, detail=self._problem)


async def _at_most(event: asyncio.Event, wait_s: float) -> None:
    """Wait for an event, but not longer than ``wait_s``."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(wait_s):
            await event.wait()
