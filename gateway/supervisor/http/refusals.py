"""Refused requests of the page: counted, reported by address, and limited for wrong tokens."""

from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from ipaddress import IPv6Address, ip_network
from typing import Final

from gateway.catalogue.entry import EventEntry
from gateway.limits import Reports
from gateway.supervisor.event_log import LogEvent
from gateway.times import NS_PER_S
from gateway.transport.endpoints import address_of

# --- Wrong tokens: after ten within a minute, tokens from that address are not checked for a minute

MOST_WRONG: Final = 10
WITHIN_S: Final = 60.0
SHUT_S: Final = 60.0
MOST_SITES: Final = 1024
"""Maximum number of addresses kept. One more removes the address that was quiet for longest."""
ONE_SITE_BITS: Final = 64
"""Prefix length of an IPv6 site: a client that has one address has all that share the prefix."""


@dataclass(slots=True)
class _Site:
    wrong: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=MOST_WRONG))
    """The newest different wrong tokens, each as a hash that only this process can compute, with its time."""
    shut_until_s: float = 0.0


class WrongTries:
    """Counts wrong tokens by address; times are seconds of the monotonic clock."""

    def __init__(self) -> None:
        self._sites: OrderedDict[str, _Site] = OrderedDict()

    def __len__(self) -> int:
        return len(self._sites)

    def shut_s(self, address: str, now_s: float) -> float:
        """Return for how long tokens from an address are not checked; 0 if they are."""
        site = self._sites.get(site_of(address))
        return 0.0 if site is None else max(0.0, site.shut_until_s - now_s)

    def add(self, address: str, token: str, now_s: float) -> None:
        """Count a wrong token."""
        name, shown = site_of(address), hash(token)
        site = self._sites.setdefault(name, _Site())
        self._sites.move_to_end(name)
        if all(shown != other for other, _ in site.wrong):
            site.wrong.append((shown, now_s))
            if len(site.wrong) == MOST_WRONG and now_s - site.wrong[0][1] < WITHIN_S:
                site.shut_until_s = now_s + SHUT_S
                site.wrong.clear()
        while len(self._sites) > MOST_SITES:
            self._sites.popitem(last=False)


def site_of(address: str) -> str:
    """Return the site of an address: all addresses that one client can have.

    >>> site_of("192.0.2.7"), site_of("2001:db8:1:2:3::4"), site_of("")
    ('192.0.2.7', '2001:db8:1:2::/64', '')
    >>> site_of("::ffff:192.0.2.7")  # one socket for both families
    '192.0.2.7'
    """
    try:
        parsed = address_of(address)
    except ValueError:
        return address
    if isinstance(parsed, IPv6Address) and not parsed.is_loopback:
        return str(ip_network((parsed, ONE_SITE_BITS), strict=False))
    return str(parsed)


# --- Refused clients: the first refusal is reported immediately, then a count once a minute

MOST: Final = 1024
"""Addresses reported by name; all others are reported together, so that a flood does not fill the log."""
OTHERS: Final = "further addresses"


Refused = Callable[[str, str], None]
"""Called with the address of a refused client, and why it was refused."""


def ignore_refused(_peer: str, _why: str) -> None:
    """Report nothing: clients of the Unix socket are on this machine."""


def _others(key: tuple[EventEntry, str]) -> tuple[EventEntry, str]:
    return key[0], OTHERS


class HttpRefusals:
    """Reports refusals by event and address, never the credentials."""

    def __init__(self, log: LogEvent) -> None:
        self._log = log
        self._reports: Reports[tuple[EventEntry, str]] = Reports(most=MOST, others=_others)
        self._reasons: dict[tuple[EventEntry, str], str] = {}
        """Reason of the newest refusal of each."""

    def add(self, event: EventEntry, address: str, reason: str, now_s: float) -> None:
        """Count a refusal. Report it if none from that address was reported for a minute."""
        now_ns = int(now_s * NS_PER_S)
        key = self._reports.counted_as((event, site_of(address)))
        self._reasons[key] = reason
        if count := self._reports.due(key, now_ns):
            self._report(key, count)

    def sweep(self, now_s: float) -> None:
        """Report the counts that are due, and remove addresses that have been quiet since."""
        for key, count in self._reports.held_back(int(now_s * NS_PER_S)):
            self._report(key, count)
        self._reasons = {key: reason for key, reason in self._reasons.items() if self._reports.knows(key)}

    def _report(self, key: tuple[EventEntry, str], times: int) -> None:
        event, address = key
        self._log(event, peer=address, detail=self._reasons[key], times=times)
