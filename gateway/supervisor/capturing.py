"""Writes frames to a file when an event happens that ``[capture] on`` names.

The relay does nothing for this: the supervisor reads its trace buffers (``recording.capture``).
"""

import asyncio
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

from gateway.catalogue.process_events import CAPTURE_FAILED, CAPTURED
from gateway.config.gateway_model import CaptureSection
from gateway.config.load import Loaded
from gateway.config.recording_header import header_of
from gateway.ipc.address import socket_path
from gateway.ipc.client import NoGatewayError
from gateway.recording import traffic
from gateway.recording.capture import Capture, NoCaptureError, write_recording
from gateway.state.folder import problem_of
from gateway.supervisor.in_thread import in_thread

AFTER_S: Final = 2.0
"""Waiting time after an event: the frames after it matter as much as those before it."""
PAUSE_S: Final = 60.0
PREFIX: Final = "capture-"
SUFFIX: Final = ".jsonl"
OWN: Final = frozenset({CAPTURED.name, CAPTURE_FAILED.name})
"""Always ignored: each of these events would cause the next capture."""


class Capturing:
    """Waits for events; ``log`` gets the result of each capture."""

    def __init__(self, state: Path, log: Callable[..., None]) -> None:
        self._state = state
        self._log = log
        self._loaded: Loaded | None = None
        self._event = ""
        self._is_requested = asyncio.Event()
        self._next_s = 0.0

    def follow(self, loaded: Loaded) -> None:
        """Use the settings of a configuration."""
        self._loaded = loaded

    def happened(self, event: str) -> None:
        """Request a capture for an event. Of several together the first one counts."""
        loaded = self._loaded
        if loaded is None or event in OWN or event not in loaded.sections.capture.on:
            return
        if not self._is_requested.is_set() and time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + PAUSE_S
            self._event = event
            self._is_requested.set()

    async def run(self) -> None:
        """Write the requested captures until cancelled."""
        while True:
            await self._is_requested.wait()
            await asyncio.sleep(AFTER_S)
            assert self._loaded is not None
            work = partial(write_capture, self._state, self._loaded, self._event, datetime.now(UTC))
            try:
                file, frames = await in_thread(work)
            except (NoGatewayError, NoCaptureError) as error:
                self._log(CAPTURE_FAILED, on=self._event, detail=str(error))
            except OSError as error:
                self._log(CAPTURE_FAILED, on=self._event, detail=str(problem_of(error, self._state)))
            else:
                self._log(CAPTURED, on=self._event, file=str(file), entries=frames)
            self._is_requested.clear()


def write_capture(state: Path, loaded: Loaded, event: str, now: datetime) -> tuple[Path, int]:
    """Write what the trace buffers hold and remove the oldest files.

    Return the file and its number of entries.

    Raises:
        NoGatewayError, NoCaptureError: there are no trace buffers to read.
        OSError: the file cannot be written.
    """
    capture = Capture(socket_path(state))
    try:
        timed, _ = capture.new()
    finally:
        capture.close()
    file = state / f"{PREFIX}{now:%Y%m%dT%H%M%SZ}-{event}{SUFFIX}"
    number = write_recording(file, header_of(loaded, traffic.CAPTURED), (entry for _, entry in timed))
    _make_room(state, loaded.sections.capture)
    return file, number


def _make_room(state: Path, section: CaptureSection) -> None:
    """Remove the oldest files: their names begin with the time."""
    for old in sorted(state.glob(f"{PREFIX}*{SUFFIX}"))[: -section.keep]:
        old.unlink(missing_ok=True)
