"""Sessions of browsers: a person shows the token once, and the browser a random number from then on."""

import secrets
from collections import OrderedDict
from dataclasses import dataclass
from hashlib import sha256
from typing import Final

LIFE_S: Final = 12 * 3600.0
"""A shift and the way home."""
MOST: Final = 64
"""At once; for one more the oldest ends."""
_BYTES: Final = 32


@dataclass(frozen=True, slots=True)
class Session:
    """One browser that is let in."""

    token: str
    """Name of the token that was shown for it."""
    digest: bytes
    """What that token was known by: with another one in its file the session is over."""
    ends_s: float
    """On the monotonic clock."""


class Sessions:
    """Kept here only: a restart ends all of them. Known by digests, so that a look-up tells nothing."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[bytes, Session] = OrderedDict()

    def __len__(self) -> int:
        return len(self._sessions)

    def open(self, token: str, digest: bytes, now_s: float) -> str:
        """Begin a session; returns what the browser has to show for it."""
        value = secrets.token_urlsafe(_BYTES)
        while len(self._sessions) >= MOST:
            self._sessions.popitem(last=False)
        self._sessions[_key(value)] = Session(token, digest, now_s + LIFE_S)
        return value

    def find(self, value: str, now_s: float) -> Session | None:
        """Return the session of what a browser shows; None where there is none, or not any more."""
        session = self._sessions.get(_key(value))
        if session is not None and session.ends_s <= now_s:
            self.close(value)
            return None
        return session

    def has(self, session: Session, now_s: float) -> bool:
        """Whether a session goes on."""
        return session.ends_s > now_s and any(session is one for one in self._sessions.values())

    def close(self, value: str) -> None:
        """End a session."""
        self._sessions.pop(_key(value), None)


def _key(value: str) -> bytes:
    return sha256(value.encode("utf-8", "surrogatepass")).digest()
