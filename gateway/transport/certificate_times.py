"""From when until when a certificate is good, and what is said of one that has ended or soon will."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Final, Protocol

SOON: Final = timedelta(days=30)
"""So long before its end a certificate is warned of, by ``check`` and while the gateway runs."""


class Timed(Protocol):
    """Somebody's certificate, as far as its time goes."""

    @property
    def subject(self) -> str:
        """Whose it is."""
        ...

    @property
    def begins(self) -> datetime:
        """From when on it is good."""
        ...

    @property
    def ends(self) -> datetime:
        """When it is good no more."""
        ...


@dataclass(frozen=True, slots=True)
class Life:
    """A certificate of which nothing else was read: that is soon done."""

    subject: str
    begins: datetime
    ends: datetime


@dataclass(frozen=True, slots=True)
class TimeProblem:
    """What is wrong with the time of a certificate; ``is_good_now``: nothing yet."""

    found: str
    remedy: str
    is_good_now: bool


def time_problem(facts: Timed, now: datetime) -> TimeProblem | None:
    """Return what is to be said of a certificate's time, None for nothing."""
    if facts.ends < now:
        found = f"{facts.subject} expired on {day(facts.ends)}"
        return TimeProblem(found, "give one that is good; if this is, set the clock", is_good_now=False)
    if facts.begins > now:
        found = f"{facts.subject} is good from {day(facts.begins)} on only"
        return TimeProblem(found, "wait until then, or set the clock if it is wrong", is_good_now=False)
    if facts.ends < now + SOON:
        found = f"{facts.subject} expires on {day(facts.ends)}"
        return TimeProblem(found, "have it renewed before", is_good_now=True)
    return None


def list_problem(name: str, ends: datetime | None, now: datetime) -> TimeProblem | None:
    """Return what is to be said of a list of revoked certificates that has run out, or soon will."""
    if ends is None or ends >= now + SOON:
        return None
    when = "out of date since" if ends < now else "good until"
    remedy = "have the authority write a new list: with one that is out of date nobody comes in"
    return TimeProblem(f"{name} is {when} {day(ends)}", remedy, is_good_now=ends >= now)


def day(when: datetime) -> str:
    """Return the day of a time, for people."""
    return when.date().isoformat()
