"""When a table file that somebody is saving may be read: once it stands still, and once it is really gone.

Editors write in place, write beside and rename, move the old file away first; a slow link takes its time.
What is read in the middle of that is another table than anybody wrote.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Final

STILL_S: Final = 0.5
"""Nothing may have changed for so long: longer than an editor's pauses, and than a clock's tick."""
GONE_S: Final = 5.0
"""A file has to be missing for so long; editors move it away and back within a fraction of that."""


@dataclass(frozen=True, slots=True)
class FileStamp:
    """What can be seen of a file without reading it; two sights of the same content are equal."""

    is_there: bool
    """Whether there is a file to be read, or one that cannot be."""
    mark: tuple[object, ...] = ()
    """Device, inode, size and times, or the error."""
    is_being_written: bool = False
    """Whether a program has it open for writing, as far as the system tells."""


class FileStability(Enum):
    """What a look says about the file."""

    SAME = "same"
    """As it was read last."""
    MOVING = "moving"
    """It changes, or has been gone for a short time only."""
    READY = "ready"
    """It is another than was read last, and stands still; or it is really gone."""


class FileDebounce:
    """Follows one file; time comes with each look, in seconds of any clock that never goes back."""

    def __init__(self) -> None:
        self._taken: tuple[bool, tuple[object, ...]] | None = None
        self._is_taken_early = False
        self._seen: FileStamp | None = None
        self._since_s = 0.0

    def observe(self, stamp: FileStamp, now_s: float) -> FileStability:
        """Take what is seen now."""
        if stamp != self._seen:
            self._seen, self._since_s = stamp, now_s
        is_still = now_s - self._since_s >= (STILL_S if stamp.is_there else GONE_S)
        if (stamp.is_there, stamp.mark) == self._taken:
            is_ready = self._is_taken_early and is_still and not stamp.is_being_written
            return FileStability.READY if is_ready else FileStability.SAME
        if stamp.is_being_written:
            return FileStability.MOVING
        return FileStability.READY if is_still else FileStability.MOVING

    def take(self, stamp: FileStamp, now_s: float) -> None:
        """Note that the file has been read as it was seen.

        One that had not stood still is read once more as soon as it has: within a tick of the file system's
        clock it may have been changed, and look the same.
        """
        if stamp != self._seen:
            self._seen, self._since_s = stamp, now_s
        self._taken = (stamp.is_there, stamp.mark)
        self._is_taken_early = stamp.is_there and now_s - self._since_s < STILL_S

    def forget(self) -> None:
        """Read it again as soon as it stands still, whatever it looks like."""
        self._taken = None
