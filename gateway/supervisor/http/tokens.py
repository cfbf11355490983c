"""The tokens that are in force: read from their files, again as soon as those change, and never shown."""

import hmac
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

from gateway.config.files import NamedFileError, path_of, read_token
from gateway.config.http_model import TokenSection

SETTLED_NS: Final = 2_000_000_000
"""A file that was written later than so long ago is read each time: two saves can have one time."""
Seen = tuple[int, int, int, int]


@dataclass(slots=True)
class _File:
    """One token as its file had it when it was looked at last."""

    key: tuple[str | int, ...]
    section: TokenSection
    seen: Seen | None = None
    digest: bytes = b""
    """SHA-256 of the token; empty: there is none that could be used, and nobody gets in by it."""
    problem: str | None = None


class Tokens:
    """Tells whose token one is. Files are small and local: they are looked at on the loop."""

    def __init__(
        self, sections: Iterable[TokenSection], folder: Path, complain: Callable[[str], None]
    ) -> None:
        self._folder = folder
        self._complain = complain
        self._files = [
            _File(("http", "tokens", index, "file"), section) for index, section in enumerate(sections)
        ]
        self.look()

    @property
    def problems(self) -> list[str]:
        """Why tokens cannot be used, a sentence each."""
        return [file.problem for file in self._files if file.problem is not None]

    def look(self) -> None:
        """Read the files that have changed; a token that is in its file no more is in force no more."""
        for file in self._files:
            try:
                seen = _look_at(path_of(file.key, file.section.file, self._folder))
                if seen is None or seen != file.seen:
                    token = read_token(file.key, file.section.file, self._folder)
                    file.digest, file.seen, file.problem = _digest(token), seen, None
            except NamedFileError as error:
                why = f'token "{file.section.name}": {error}'
                is_new = why != file.problem
                file.digest, file.seen, file.problem = b"", None, why
                if is_new:
                    self._complain(why)

    def name_of(self, token: str) -> str | None:
        """Return whose token this is; takes as long for a wrong one as for a right one."""
        digest, found = _digest(token), None
        for file in self._files:
            if hmac.compare_digest(digest, file.digest):
                found = file.section.name
        return found

    def may_acknowledge(self, name: str) -> bool:
        """Whether the token of a name has the right to acknowledge alarms."""
        return any(file.section.name == name and file.section.acknowledge for file in self._files)

    def digest_of(self, name: str) -> bytes:
        """Return what the token of a name is known by; empty where there is none."""
        return next((file.digest for file in self._files if file.section.name == name), b"")


def _digest(token: str) -> bytes:
    return sha256(token.encode("utf-8", "surrogatepass")).digest()


def _look_at(path: Path) -> Seen | None:
    """Return by what a change of a file is noticed; None: it has to be read to know."""
    try:
        status = path.stat()
    except OSError:
        return None
    if time.time_ns() - max(status.st_mtime_ns, status.st_ctime_ns) < SETTLED_NS:
        return None
    # The time of change counts too: with it comes another mode, by which others may read it.
    return status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
