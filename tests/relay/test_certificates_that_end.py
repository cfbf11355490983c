"""Certificates that end while a relay runs: told of in time, and renewed while nobody connects."""

from datetime import datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.clock import now_utc
from tests.relay.secure_site import Site
from tests.support.relay import Bench, eventually

DAY = timedelta(days=1)
SOON, ENDED = "certificate-ends-soon", "certificate-ended"


async def ending(bench: Bench, folder: Path) -> tuple[Site, Path, Path]:
    """Start a relay whose certificate is good for two days, of an authority that is for 100."""
    site = Site(bench, folder)
    certificate, key = site.shop.leaf("brief", purpose=ExtendedKeyUsageOID.SERVER_AUTH)
    await site.start(certificate=str(certificate), key=str(key))
    return site, certificate, key


def tick(site: Site, now: datetime) -> None:
    """What the relay does every five seconds, at a time of our own."""
    site.relay._lines[0]._controllers[0].tick(now)


def days_left(site: Site) -> dict[str, int]:
    return {each["key"]: each["days_left"] for each in site.status["certificates"]}


async def test_it_is_told_at_the_start_then_daily_and_when_it_ends(bench: Bench, tmp_path: Path) -> None:
    site, certificate, _ = await ending(bench, tmp_path)
    start = now_utc()
    await eventually(lambda: len(site.told(SOON)) == 1)
    ends = x509.load_pem_x509_certificate(certificate.read_bytes()).not_valid_after_utc
    assert site.told(SOON) == [f"tls.certificate: CN=brief expires on {ends.date()}"]
    [note] = [note for note in bench.notes if note.event == SOON]
    assert note.severity.value == "warning"
    assert {key: note.fields[key] for key in ("line", "controller", "file", "days_left")} == {
        "line": "line",
        "controller": "cnc",
        "file": str(certificate),
        "days_left": 1,
    }
    assert days_left(site) == {"certificate": 1, "clients": 99, "revoked": 99}
    tick(site, start + DAY / 2)
    tick(site, start + DAY + timedelta(minutes=5))
    await eventually(lambda: len(site.told(SOON)) == 2)
    tick(site, start + 2 * DAY + timedelta(minutes=5))
    await eventually(lambda: len(site.told(ENDED)) == 1)
    assert len(site.told(SOON)) == 2


async def test_one_that_was_renewed_while_nobody_connected_is_not_told(bench: Bench, tmp_path: Path) -> None:
    site, certificate, key = await ending(bench, tmp_path)
    await eventually(lambda: len(site.told(SOON)) == 1)
    new_certificate, new_key = site.shop.server("renewed")
    new_key.replace(key)
    new_certificate.replace(certificate)
    tick(site, now_utc() + DAY + timedelta(minutes=5))
    await eventually(lambda: len(site.told("certificates-renewed")) == 1)
    await eventually(lambda: days_left(site)["certificate"] == 99)
    tick(site, now_utc() + DAY + timedelta(minutes=10))
    await site.connect(site.shop.controller("mill", "Operator"))  # through the same thread: it has looked
    await eventually(lambda: len(site.status["sessions"]) == 1)
    assert (len(site.told(SOON)), site.told(ENDED)) == (1, [])


async def test_a_relay_that_stops_tells_no_more(bench: Bench, tmp_path: Path) -> None:
    site, _, _ = await ending(bench, tmp_path)
    await eventually(lambda: len(site.told(SOON)) == 1)
    await site.relay.stop()
    tick(site, now_utc() + 3 * DAY)
    assert site.told(ENDED) == []


async def test_certificates_that_last_are_told_of_by_nobody(bench: Bench, tmp_path: Path) -> None:
    site = Site(bench, tmp_path)
    await site.start()
    assert days_left(site) == {"certificate": 99, "clients": 99, "revoked": 99}
    tick(site, now_utc() + 60 * DAY)
    await site.connect(site.shop.controller("mill", "Operator"))
    await eventually(lambda: len(site.status["sessions"]) == 1)
    assert site.told(SOON) == []
