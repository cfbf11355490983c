"""The state folder: real files, of which a power cut keeps what had reached the disk.

A file that is written whole and synced is on the disk. The records of the axes are mapped: the kernel writes
their pages back within half a minute. At a power cut each page has its old content, its new, or a mixture of
both by sectors.
"""

import os
import random
from pathlib import Path
from typing import Final

from gateway.relay.axis_record import SUFFIX

WRITTEN_BACK_S: Final = (1.0, 30.0)
"""Time between two rounds of writing back (``dirty_expire_centisecs`` is 3000)."""
SECTOR: Final = 512


class Disk:
    """The files of one folder, as they are on the disk."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._kept: dict[Path, bytes] = {}

    def write_back(self) -> None:
        """Everything reaches the disk."""
        self._kept = {path: path.read_bytes() for path in self._files()}

    def sync(self, now_ns: int) -> None:
        """What was written whole has reached the disk; what is new in it is from now."""
        for path in self._files():
            if path.suffix != SUFFIX and self._kept.get(path) != path.read_bytes():
                self._kept[path] = path.read_bytes()
                os.utime(path, ns=(now_ns, now_ns))
        self._kept = {path: data for path, data in self._kept.items() if path.exists()}

    def cut(self, rng: random.Random) -> None:
        """The power is cut, and comes back: what had not reached the disk is lost or torn."""
        for path in self._files():
            before = self._kept.get(path)
            if before is None:
                path.unlink()
                continue
            now = path.read_bytes()
            if now != before:
                path.write_bytes(_torn(before, now, rng))
        for path in self.folder.glob("*.sock"):
            path.unlink()

    def content(self) -> dict[str, bytes]:
        """Return every file by its name in the folder."""
        return {str(path.relative_to(self.folder)): path.read_bytes() for path in self._files()}

    def _files(self) -> list[Path]:
        return sorted(path for path in self.folder.rglob("*") if path.is_file())


def _torn(before: bytes, now: bytes, rng: random.Random) -> bytes:
    if len(before) != len(now):
        return rng.choice((before, now))
    sectors = range(0, len(now), SECTOR)
    return b"".join((now if rng.random() < 0.5 else before)[at : at + SECTOR] for at in sectors)
