"""The certificates of the page while it is served: told of before and at their end, and in the status."""

from datetime import datetime, timedelta
from pathlib import Path

import pytest
import yaml
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.catalogue.tls_events import CERTIFICATE_ENDS_SOON
from gateway.clock import now_utc
from gateway.supervisor.http.listener import http_settings_of
from gateway.transport.certificates import SOON
from tests.supervisor.http.doors import asking, section
from tests.supervisor.http.exposition import samples
from tests.supervisor.http.http_bench import CERTIFICATE, CONTROLLER, model, snapshot, until
from tests.support.certificates import Shop

ALERTS = Path(__file__).parents[3] / "deploy" / "monitoring" / "alerts.yml"


def two_days(folder: Path) -> None:
    """Make a certificate for the page that is good for two days, of an authority that is for 100."""
    folder.mkdir()
    shop = Shop(folder)
    shop.leaf("page", purpose=ExtendedKeyUsageOID.SERVER_AUTH)
    for path in folder.glob("*.pem"):
        path.rename(path.with_suffix(".crt"))


async def test_the_end_of_the_pages_certificate_is_told_before_and_when_it_comes(tmp_path: Path) -> None:
    folder = tmp_path / "certificates"
    two_days(folder)
    start = now_utc()
    clock = [start]

    def now() -> datetime:
        return clock[0]

    async with asking(tmp_path, folder, clients=True, now=now) as visitor:
        soon = await visitor.event("certificate-ends-soon")
        page = folder / "page.crt"
        ends = x509.load_pem_x509_certificate(page.read_bytes()).not_valid_after_utc
        # It was made a moment before the clock was read: not quite two days are left, and not quite 100.
        assert (soon["file"], soon["days_left"]) == (str(page), 1)
        assert soon["detail"] == f"http.tls.certificate: CN=page expires on {ends.date()}"
        certificates = visitor.served.service.status.certificates
        assert [(each.key, each.days_left) for each in certificates] == [
            ("certificate", 1),
            ("clients", 99),
        ]
        clock[0] = start + timedelta(days=2, minutes=2)
        ended = await visitor.event("certificate-ended")
        assert (ended["days_left"], ended["remedy"]) == (
            -1,
            "give a valid one; if this one is valid, set the clock",
        )
        assert len(visitor.events("certificate-ends-soon")) == 1


def test_files_are_named_from_the_root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    two_days(tmp_path / "certificates")
    monkeypatch.chdir(tmp_path)
    wanted = http_settings_of(section(1, Path("certificates")), "mill-1", Path())
    assert wanted is not None
    assert [held.file for held in wanted.held()] == [str(tmp_path / "certificates" / "page.crt")]


async def test_serving_anew_does_not_tell_of_the_same_certificate_again(tmp_path: Path) -> None:
    folder = tmp_path / "certificates"
    two_days(folder)
    async with asking(tmp_path, folder) as visitor:
        await visitor.event("certificate-ends-soon")
        before = len(visitor.events("http-ready"))
        wanted = section(visitor.served.port, folder, clients=True)
        visitor.served.service.configure(wanted, "mill-1", tmp_path)
        await until(lambda: len(visitor.events("http-ready")) > before)
        assert len(visitor.served.service.status.certificates) == 2
        assert len(visitor.events("certificate-ends-soon")) == 1
        assert visitor.events("certificates-renewed") == []
        visitor.served.service.configure(section(visitor.served.port, None), "mill-1", tmp_path)
        await until(lambda: visitor.served.service.status.certificates == [])


def test_each_file_of_certificates_says_when_it_ends() -> None:
    own = {**CERTIFICATE, "file": "/etc/s.pem", "ends": "2001-09-09T02:46:41+01:00"}
    forever = {**CERTIFICATE, "key": "revoked", "ends": None, "days_left": None}
    cnc = {**CONTROLLER, "tls": {"certificates": [own, forever]}}
    found = samples(model(snapshot(line={"controllers": [cnc]})))
    ends = {
        (of["where"], of["key"], of["file"], of["subject"]): value
        for (name, labels), value in found.items()
        if name == "pitch_gateway_certificate_end_timestamp_seconds" and (of := dict(labels))
    }
    # 1 000 000 000 s of Unix time are 2001-09-09 01:46:40 UTC.
    assert ends == {
        ("http", "certificate", "/etc/page.pem", "CN=mill"): 1_000_000_000,
        ("line xyz, controller cnc", "certificate", "/etc/s.pem", "CN=mill"): 1_000_000_001,
    }


def test_event_and_alert_come_when_the_check_warns() -> None:
    rules = yaml.safe_load(ALERTS.read_text())["groups"][0]["rules"]
    [rule] = [rule for rule in rules if rule["alert"] == "PitchGatewayCertificateEndsSoon"]
    assert rule["expr"].endswith(f" - time() < {SOON.days} * 86400")
    assert f"expires within {SOON.days} days " in CERTIFICATE_ENDS_SOON.description
