"""What was refused at the page: counted, told by host, and slowed down where somebody guesses."""

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

# --- Who tries tokens: after ten wrong ones within a minute nothing from there is tried for a minute

MOST_WRONG: Final = 10
WITHIN_S: Final = 60.0
SHUT_S: Final = 60.0
MOST_SITES: Final = 1024
"""Of which something is kept; for one more the one that was heard of longest ago is forgotten."""
ONE_SITE_BITS: Final = 64
"""Of an IPv6 address: who has one has all that share them."""


@dataclass(slots=True)
class _Site:
    wrong: deque[tuple[int, float]] = field(default_factory=lambda: deque(maxlen=MOST_WRONG))
    """The newest different ones, each by its hash, which only this process can work out, and when it came."""
    shut_until_s: float = 0.0


class WrongTries:
    """Counts by address; times are seconds of the monotonic clock."""

    def __init__(self) -> None:
        self._sites: OrderedDict[str, _Site] = OrderedDict()

    def __len__(self) -> int:
        return len(self._sites)

    def shut_s(self, address: str, now_s: float) -> float:
        """Return for how long nothing from an address is tried any more; 0 where it is."""
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
    """Return what stands for everything that one visitor can call his address.

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


# --- Clients that were refused: the first refusal is reported at once, and then one a minute with how often

MOST: Final = 1024
"""So many addresses are reported by name, all others together: a flood must not fill the log."""
OTHERS: Final = "further addresses"


Refused = Callable[[str, str], None]
"""Is told of who was refused, by his address, and why."""


def ignore_refused(_peer: str, _why: str) -> None:
    """Tell nobody: on the Unix socket whoever asks is this machine's own."""


def _others(key: tuple[EventEntry, str]) -> tuple[EventEntry, str]:
    return key[0], OTHERS


class HttpRefusals:
    """Reports refusals by event and address, never what was shown."""

    def __init__(self, log: LogEvent) -> None:
        self._log = log
        self._reports: Reports[tuple[EventEntry, str]] = Reports(most=MOST, others=_others)
        self._reasons: dict[tuple[EventEntry, str], str] = {}
        """Of the newest refusal of each."""

    def add(self, event: EventEntry, address: str, reason: str, now_s: float) -> None:
        """Count a refusal, and report it where none of that address was reported for a minute."""
        now_ns = int(now_s * NS_PER_S)
        key = self._reports.counted_as((event, site_of(address)))
        self._reasons[key] = reason
        if count := self._reports.due(key, now_ns):
            self._report(key, count)

    def sweep(self, now_s: float) -> None:
        """Report what was held back, and forget the addresses that have been quiet since."""
        for key, count in self._reports.held_back(int(now_s * NS_PER_S)):
            self._report(key, count)
        self._reasons = {key: reason for key, reason in self._reasons.items() if self._reports.knows(key)}

    def _report(self, key: tuple[EventEntry, str], times: int) -> None:
        event, address = key
        self._log(event, peer=address, detail=self._reasons[key], times=times)
