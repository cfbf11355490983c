"""Which retained messages of ours a broker may hold: what is not wanted any more has to be taken away.

An axis that is gone, or discovery that was switched off, would else stay at the broker for ever. What was
published is noted in the state folder, because it is a restart that takes an axis away.
"""

import contextlib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

from gateway.files import FileRefusedError, read_regular_file
from gateway.state.folder import write_whole

RETAINED_NAME: Final = "mqtt-retained.json"
LARGEST: Final = 1_000_000
"""Bytes. 64 axes have some 20 000."""


class Ledger:
    """The topics that were published retained, on disk. It blocks; one thread at a time."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.topics = self._read()
        """What the broker may hold, as far as it was noted."""

    def note(self, topics: Iterable[str]) -> None:
        """Note exactly these.

        Raises:
            OSError: it cannot be written; what was noted before is still there.
        """
        wanted = frozenset(topics)
        if wanted != self.topics:
            self.topics = wanted
            write_whole(self._path, msgspec.json.encode(sorted(wanted)))

    def _read(self) -> frozenset[str]:
        with contextlib.suppress(FileRefusedError, msgspec.MsgspecError, UnicodeDecodeError):
            content = read_regular_file(self._path, LARGEST, "a file")
            return frozenset(msgspec.json.decode(content, type=list[str]))
        return frozenset()
