"""Listening on a working line, as one call: a serial line, or the path from a controller to a drive.

    heard = listen_serial("/dev/ttyUSB0", ListenOptions(seconds=600.0, baudrate=9600))
    print(heard.configuration)

It never sends. The result depends on what the machine does during this time.
"""

import asyncio
import signal
import termios
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from gateway.clock import boot_ns
from gateway.commissioning.listen.options import AS_LONG_AS_USUAL, SERIAL_S, ListenOptions
from gateway.commissioning.listen.proposal import ListenPoint, proposed, unit_data, unit_lines
from gateway.commissioning.listen.proxy import Proxy
from gateway.commissioning.listen.serial_line import SILENCE_MS, Sniffer, Trial, find_setting, settings_to_try
from gateway.commissioning.listen.traffic import TrafficStatistics
from gateway.options import OptionError
from gateway.plain import JsonObject
from gateway.times import NS_PER_S
from gateway.transport.endpoints import PARITIES, TcpEndpoint

PROGRESS_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Heard:
    """The traffic, by unit id and location."""

    statistics: TrafficStatistics
    listen_point: ListenPoint
    where: dict[str, Any]
    """The same for a program: the port with its settings, or both ends of the proxy."""

    @property
    def is_understood(self) -> bool:
        """Whether there was a complete frame."""
        return bool(self.statistics.units)

    @property
    def configuration(self) -> str:
        """A configuration to begin with; empty if no unit id received a target."""
        return proposed(self.listen_point, self.statistics.units)

    def as_data(self) -> JsonObject:
        """Return everything as plain data."""
        units = {
            str(unit_id): unit_data(unit_id, unit) for unit_id, unit in sorted(self.statistics.units.items())
        }
        return {**self.where, "units": units, "configuration": self.configuration}

    def lines(self) -> Iterator[str]:
        """Yield it in words, without the configuration."""
        for unit_id, unit in sorted(self.statistics.units.items()):
            yield from unit_lines(unit_id, unit)


def listen_serial(
    device: str, options: ListenOptions = AS_LONG_AS_USUAL, *, report: Callable[[str], None] = lambda _: None
) -> Heard:
    """Listen on a serial port, opened for reading only, with one setting after the other.

    Settings that the options give are not varied. ``report`` gets a sentence for each tried setting, and the
    progress. Ctrl-C ends it early; so does a port that is removed.

    Raises:
        TransportError: the port does not exist, is in use, or is not a serial port.
    """
    statistics = TrafficStatistics()
    trial: Trial | None = None
    letter = next((letter for letter, word in PARITIES.items() if word == options.parity), None)
    seconds = SERIAL_S if options.seconds is None else options.seconds
    until_ns = boot_ns() + int(seconds * NS_PER_S)
    try:
        with Sniffer(device) as sniffer, suppress(KeyboardInterrupt):
            if sniffer.is_pty:
                report(f"{device}: a pseudo terminal has no parity: only baud rates are tried")
            settings = settings_to_try(options.baudrate, letter, has_parity=not sniffer.is_pty)
            trial, heard = find_setting(sniffer, settings, until_ns, report)
            statistics.add(heard)
            if trial is not None and trial.is_right:
                report(f"{trial.setting}: whole frames received")
                _go_on(sniffer, trial, statistics, until_ns, report)
    except (OSError, termios.error) as error:
        report(f"{device}: {error}; the traffic received before follows")
    if trial is None:
        return Heard(statistics, ListenPoint(), {"port": device, "serial": None})
    return Heard(
        statistics, ListenPoint(setting=trial.setting), {"port": device, "serial": _serial_data(trial)}
    )


def listen_proxy(
    near: TcpEndpoint,
    far: TcpEndpoint,
    options: ListenOptions = AS_LONG_AS_USUAL,
    *,
    report: Callable[[str], None] = lambda _: None,
) -> Heard:
    """Listen on ``near`` in place of the drive at ``far``, and forward every byte unchanged.

    Without ``seconds`` it ends with SIGINT or SIGTERM. ``report`` gets a sentence for each connection, and
    the progress.

    Raises:
        OptionError: the options set a serial line.
        TransportError: the address is not on this computer, or in use.
    """
    for field, value in (("baudrate", options.baudrate), ("parity", options.parity)):
        if value is not None:
            raise OptionError(field, "TCP has neither baud rate nor parity; leave it out")
    statistics = TrafficStatistics()
    asyncio.run(_serve(near, far, statistics, options.seconds, report))
    return Heard(statistics, ListenPoint(near=near, far=far), {"port": str(near), "to": str(far)})


def _go_on(
    sniffer: Sniffer,
    trial: Trial,
    statistics: TrafficStatistics,
    until_ns: int,
    report: Callable[[str], None],
) -> None:
    reported_ns = boot_ns()
    while (now_ns := boot_ns()) < until_ns:
        data = sniffer.read(SILENCE_MS)
        statistics.add(trial.feed(data) if data else trial.line.silent())
        if now_ns - reported_ns >= PROGRESS_S * NS_PER_S:
            reported_ns = now_ns
            left = f"{(until_ns - now_ns) / NS_PER_S:.0f} s to go (Ctrl-C ends)"
            report(f"{_progress(statistics)}, {trial.line.bad_bytes} bytes damaged; {left}")


def _progress(statistics: TrafficStatistics) -> str:
    ids = ", ".join(str(unit_id) for unit_id in sorted(statistics.units)) or "none yet"
    return f"{statistics.requests} requests, unit ids {ids}"


def _serial_data(trial: Trial) -> JsonObject:
    return {
        "baudrate": trial.setting.baudrate,
        "parity": PARITIES[trial.setting.parity],
        "is_sure": trial.is_right,
        "frames": trial.line.frames,
        "damaged_bytes": trial.line.bad_bytes,
        "wrong_characters": trial.unmarking.errors,
    }


async def _serve(
    near: TcpEndpoint,
    far: TcpEndpoint,
    statistics: TrafficStatistics,
    seconds: float | None,
    report: Callable[[str], None],
) -> None:
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    if seconds is not None:
        loop.call_later(seconds, ended.set)
    proxy = Proxy(near, far, statistics, report)
    await proxy.open()
    report(f"connect the controller to {near.host}:{proxy.port} in place of {far}; Ctrl-C ends the proxy")
    last = ""
    try:
        while not ended.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(PROGRESS_S):
                    await ended.wait()
            if (now := _progress(statistics)) != last:
                last = now
                report(now)
    finally:
        await proxy.close()
