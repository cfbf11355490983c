"""Progress of a measuring run, for a person or a program."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import typer

from gateway.cli.output import Format, print_json
from gateway.commissioning.measure.running import Showing
from gateway.metrology.cycle import Stop
from gateway.metrology.readings import Reading

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID


class AsLines(Showing):
    """A line for each reading, on standard error."""

    def __init__(self, units: str) -> None:
        self._units = units
        self._total = 0
        self._done = 0

    def show(self, text: str) -> None:
        """See :class:`Showing`."""
        typer.echo(text, err=True)

    def begin(self, total: int, done: int) -> None:
        """See :class:`Showing`."""
        self._total, self._done = total, done

    def took(self, reading: Reading) -> None:
        """See :class:`Showing`."""
        self._done += 1
        self.show(line_of(self._done, self._total, reading, self._units))

    def took_back(self, count: int) -> None:
        """See :class:`Showing`."""
        self._done -= count


class AsDial(AsLines):
    """The same for the readings of a dial; ``gap`` is 1 if it opens while the axis moves forward, else -1."""

    def __init__(self, units: str, gap: float) -> None:
        super().__init__(units)
        self._gap = gap

    def took(self, reading: Reading) -> None:
        """See :class:`Showing`."""
        self._done += 1
        self.show(dial_line_of(self._done, self._total, reading, self._units, self._gap))


class AsBar(AsLines):
    """A bar on a terminal, with the lines above it."""

    def __init__(self, units: str) -> None:
        super().__init__(units)
        self._bar: Progress | None = None
        self._task: TaskID | None = None

    def show(self, text: str) -> None:
        """See :class:`Showing`."""
        if self._bar is None:
            super().show(text)
        else:
            self._bar.console.print(text, highlight=False, markup=False)

    def begin(self, total: int, done: int) -> None:
        """See :class:`Showing`."""
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

        super().begin(total, done)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        self._bar = Progress(*columns, console=Console(stderr=True))
        self._task = self._bar.add_task("", total=total, completed=done)
        self._bar.start()

    def going(self, stop: Stop) -> None:
        """See :class:`Showing`."""
        if self._bar is not None and self._task is not None:
            self._bar.update(self._task, description=f"to {stop.nominal:.9g} {self._units}")

    def took(self, reading: Reading) -> None:
        """See :class:`Showing`."""
        super().took(reading)
        if self._bar is not None and self._task is not None:
            self._bar.advance(self._task)

    def end(self) -> None:
        """See :class:`Showing`."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


class AsJson(AsLines):
    """A line of JSON on standard output for each event; sentences on standard error."""

    def begin(self, total: int, done: int) -> None:
        """See :class:`Showing`."""
        super().begin(total, done)
        self.happened("begin", {"readings": total, "done": done})

    def going(self, stop: Stop) -> None:
        """See :class:`Showing`."""
        self.happened("going", {"target": stop.nominal, "measure": stop.measure, "run": stop.run})

    def waiting(self, stop: Stop) -> None:
        """See :class:`Showing`."""
        way = stop.direction.name.lower()
        self.happened("waiting", {"target": stop.nominal, "direction": way, "run": stop.run})

    def took(self, reading: Reading) -> None:
        """See :class:`Showing`."""
        self._done += 1
        facts: dict[str, Any] = {
            "target": reading.target,
            "direction": reading.direction.name.lower(),
            "run": reading.run,
        }
        if reading.block:
            facts["block"] = reading.block
        self.happened("reading", {**facts, "measured": reading.measured})

    def happened(self, event: str, facts: Mapping[str, Any]) -> None:
        """See :class:`Showing`."""
        print_json({"event": event, **facts}, Format.JSON)


def line_of(number: int, total: int, reading: Reading, units: str) -> str:
    """Return a reading as text for a person.

    >>> from gateway.compensation.direction import Direction
    >>> line_of(3, 110, Reading(50.0, Direction.FORWARD, 50.0123), "mm")
    '3/110  run 1  50 mm forward: 50.0123, deviation +0.0123'
    """
    way = reading.direction.name.lower()
    return (
        f"{number}/{total}  run {reading.run}  {reading.target:.9g} {units} {way}: "
        f"{reading.measured:.9g}, deviation {reading.deviation:+.4f}"
    )


def dial_line_of(number: int, total: int, reading: Reading, units: str, gap: float) -> str:
    """Return a reading of a dial as text for a person.

    >>> from gateway.compensation.direction import Direction
    >>> dial_line_of(3, 200, Reading(52.5, Direction.FORWARD, 52.5123, 1, block=50.0), "mm", 1.0)
    '3/200  placement 1  52.5 mm forward over the block: dial +2.5123'
    """
    way, over = reading.direction.name.lower(), " over the block" if reading.block else ""
    where = f"{number}/{total}  placement {reading.run}  {reading.target:.9g} {units} {way}{over}"
    return f"{where}: dial {gap * (reading.measured - reading.block):+.4f}"
