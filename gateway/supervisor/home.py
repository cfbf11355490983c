"""The folder in which the tables were: whether an empty one in its place is still that folder.

A share that is not mounted leaves the folder that it is mounted on, empty. That is no sign that somebody took
the tables away.
"""

from collections.abc import Iterable
from pathlib import Path

from gateway.config.readings import TableReading
from gateway.tabfile import TableState


class Home:
    """Remembers the folder that held a table last."""

    def __init__(self) -> None:
        self._known: tuple[Path, int, int] | None = None
        """Its path, device and inode."""

    def what_is_strange(self, folder: Path, readings: Iterable[TableReading]) -> str:
        """Return what is wrong with a folder whose tables were just looked for; "" when nothing is.

        It is strange that every table is missing and the folder at this path is another one than before.
        """
        states = {reading.state for reading in readings}
        now = _identity(folder)
        if states & {TableState.PRESENT, TableState.OFF}:
            self._known = now
        if states != {TableState.MISSING} or now is None or self._known is None:
            return ""
        if now == self._known or now[0] != self._known[0]:
            return ""
        return (
            f"{folder} holds none of the tables and is not the folder that held them (a share that is not "
            "mounted?): mount it, or put the tables there; to go on without them restart the gateway"
        )


def _identity(folder: Path) -> tuple[Path, int, int] | None:
    try:
        status = folder.stat()
    except OSError:
        return None
    return folder, status.st_dev, status.st_ino
