"""Certificates that end while a gateway runs: when it is told of, how often, and how many days are left."""

import base64
import hashlib
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.catalogue.entry import EventEntry
from gateway.commissioning.certificates import make_authority, make_leaf, make_list
from gateway.transport.certificates import SOON, Endings, read_held
from tests.support.status_models import plain

BORN = datetime(2026, 3, 1, 12, tzinfo=UTC)
"""The certificate is good for 40 days from here: until 10 April, 12:00."""
END = datetime(2026, 4, 10, 12, tzinfo=UTC)
DAY, MINUTE = timedelta(days=1), timedelta(minutes=1)
SOON_SAID = "tls.certificate: CN=server expires on 2026-04-10"
ENDED_SAID = "tls.certificate: CN=server expired on 2026-04-10"


def digest_of(pem: bytes) -> str:
    """Of the one certificate or list of a file: its lines without the first and the last are Base64."""
    return hashlib.sha256(base64.b64decode(b"".join(pem.splitlines()[1:-1]))).hexdigest()


class Told:
    """What was told of, and whoever tells of it."""

    def __init__(self, folder: Path) -> None:
        self.events: list[tuple[str, dict[str, object]]] = []
        self.endings = Endings(self._tell, "tls")
        authority = make_authority("ca", BORN, 3650)
        leaf = make_leaf(authority, "server", [ExtendedKeyUsageOID.SERVER_AUTH], [], BORN, days=40)
        self.paths = {"certificate": folder / "server.pem", "clients": folder / "ca.pem"}
        for path, one in zip(self.paths.values(), (leaf, authority), strict=True):
            path.write_bytes(one.certificate.public_bytes(Encoding.PEM))
        self.list = make_list(authority, [], BORN)
        self.endings.take(read_held(self.paths))

    def _tell(self, event: EventEntry, fields: dict[str, object]) -> None:
        self.events.append((event.name, fields))

    def at(self, *times: datetime) -> list[tuple[str, object, object]]:
        """Look at these times; returns what was told of: the event, its detail, the days left."""
        self.events.clear()
        for time in times:
            if self.endings.is_due(time):
                self.endings.report(time)
        return [(name, fields["detail"], fields["days_left"]) for name, fields in self.events]


@pytest.fixture
def told(tmp_path: Path) -> Told:
    return Told(tmp_path)


def test_a_year_of_looks_tells_once_a_day_and_when_it_ends(told: Told) -> None:
    assert timedelta(days=30) == SOON
    # Every 5 s would be the same and take longer: 7 minutes do not divide a day.
    times = [BORN + n * timedelta(minutes=7) for n in range(42 * 24 * 60 // 7)]
    said = told.at(*times)
    assert said[0] == ("certificate-ends-soon", SOON_SAID, 29)
    names = [name for name, _, _ in said]
    # Each is told 24 h after the one before, to the next look: 30 days of 24:02 at most hold 30.
    assert names == ["certificate-ends-soon"] * 30 + ["certificate-ended"] * 2
    assert [detail for _, detail, _ in said[-2:]] == [ENDED_SAID] * 2
    assert [left for _, _, left in said[-2:]] == [-1, -2]


def test_nothing_is_told_a_moment_before_the_threshold(told: Told) -> None:
    assert told.at(END - SOON - MINUTE, END - SOON) == []
    assert told.at(END - SOON + MINUTE) == [("certificate-ends-soon", SOON_SAID, 29)]


def test_the_end_is_told_within_a_minute_though_it_was_told_of_that_day(told: Told) -> None:
    assert told.at(END - MINUTE) == [("certificate-ends-soon", SOON_SAID, 0)]
    assert told.at(END - timedelta(seconds=5)) == []
    assert told.at(END + MINUTE) == [("certificate-ended", ENDED_SAID, -1)]
    assert told.at(END + 2 * MINUTE, END + DAY) == []
    assert told.at(END + DAY + MINUTE) == [("certificate-ended", ENDED_SAID, -2)]


def test_a_clock_that_goes_back_does_not_keep_it_quiet(told: Told) -> None:
    assert len(told.at(END - DAY)) == 1
    assert len(told.at(END - 10 * DAY)) == 1
    assert told.at(END - 10 * DAY + MINUTE) == []
    assert told.at(BORN - DAY)[0][1] == "tls.certificate: CN=server is not valid before 2026-03-01"


def test_the_same_certificate_read_anew_is_told_of_no_more_often(told: Told) -> None:
    assert len(told.at(END - 9 * DAY)) == 1
    told.endings.take(read_held(told.paths))
    assert told.at(END - 9 * DAY + MINUTE) == []
    told.paths["certificate"].write_bytes(told.paths["clients"].read_bytes())
    told.endings.take(read_held(told.paths))
    assert told.at(END - 8 * DAY, END + DAY) == []
    assert told.endings._reported == {}


@pytest.mark.parametrize("is_own_first", [True, False])
def test_of_each_file_the_first_end_is_in_the_status(told: Told, tmp_path: Path, is_own_first: bool) -> None:
    own, authority = told.paths["certificate"], told.paths["clients"]
    both = [own.read_bytes(), authority.read_bytes()]
    own.write_bytes(b"".join(both if is_own_first else reversed(both)))
    revoked = tmp_path / "crl.pem"
    revoked.write_bytes(told.list)
    told.endings.take(read_held({**told.paths, "key": tmp_path / "none", "revoked": revoked}))
    status = told.endings.status(END - 3 * DAY - MINUTE)
    assert plain(status[0]) == {
        "key": "certificate",
        "file": str(own),
        "subject": "CN=server",
        "ends": "2026-04-10T12:00:00+00:00",
        "days_left": 3,
        "sha256": [digest_of(pem) for pem in (both if is_own_first else reversed(both))],
    }
    assert [each.sha256 for each in status[1:]] == [[digest_of(both[1])], [digest_of(told.list)]]
    # Ten years hold 3653 days: 2028, 2032 and 2036 have a 29th of February.
    assert (status[1].key, status[1].ends) == ("clients", "2036-02-27T12:00:00+00:00")
    assert [each.key for each in status] == ["certificate", "clients", "revoked"]
    assert told.endings.status(END)[0].days_left == 0
    assert told.endings.status(END + timedelta(seconds=1))[0].days_left == -1


def test_a_list_that_runs_out_is_told_of(told: Told, tmp_path: Path) -> None:
    authority = make_authority("short", BORN, 40)
    path = tmp_path / "crl.pem"
    path.write_bytes(make_list(authority, [], BORN))
    told.endings.take(read_held({"revoked": path}))
    [(name, detail, days_left)] = told.at(END - 9 * DAY)
    assert (name, days_left) == ("certificate-ends-soon", 9)
    assert detail == f"tls.revoked: {path} is good until 2026-04-10"
    assert told.events[0][1]["file"] == str(path)


def test_what_only_openssl_can_read_has_no_end_and_says_nothing(told: Told, tmp_path: Path) -> None:
    path = tmp_path / "odd.pem"
    path.write_text("nothing")
    told.endings.take(read_held({"certificate": path, "revoked": tmp_path / "gone"}))
    assert told.at(END, END + 1000 * DAY) == []
    assert [(each.days_left, each.sha256) for each in told.endings.status(END)] == [(None, []), (None, [])]
