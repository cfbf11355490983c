"""``pitch-gateway provision``: a folder for each machine of a site, and what a second run leaves as it is."""

import hashlib
import json
import re
import shutil
import stat
import tomllib
from base64 import b64decode
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509

from gateway.clock import now_utc
from gateway.commissioning.certificates import make_authority, make_server, pem_of, read_authority
from gateway.commissioning.provisioning import folder as provisioning
from gateway.commissioning.provisioning.site import Site
from gateway.config.load import load
from tests.support.commands import Typed, typed
from tests.support.config import RAMP, axis, line, section, tab, tcp

BASE = (
    section("[site]", {"name": "hall-2", "files": "common", "labels": {"hall": "2"}})
    + (line(502, {"cnc": {**tcp(1502), "timeout_ms": 1000}}) + axis(compensation="on", table="x.tab"))
    .replace("[line", "[base.line")
    .replace("[axis", "[base.axis")
    + section("[base.mqtt]", {"host": "127.0.0.1"})
)
MILL_1 = section("[machine.mill-1]", {"hosts": ["mill-1.plant", "192.168.0.11"], "files": "one"})
MILL_2 = section("[machine.mill-2]", {"axis.x.counts_per_unit": 2000.0, "labels": {"hall": "3"}})
SITE = BASE + MILL_1 + MILL_2
OF_A_MACHINE = {
    "gateway.toml",
    "tables/x.tab",
    "server.pem",
    "server.key",
    "ca.pem",
    "crl.pem",
    "people.token",
    "mqtt.password",
}


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A file for two machines, with a table for both."""
    for name in ("common", "one"):
        (tmp_path / name / "tables").mkdir(parents=True)
    (tmp_path / "common/tables/x.tab").write_text(RAMP)
    path = tmp_path / "site.toml"
    path.write_text(SITE)
    return path


def provision(site: Path, *options: str) -> Typed:
    return typed("provision", str(site), "--out", str(site.parent / "plant"), *options)


def made(site: Path) -> Path:
    """Provision a site for the first time; return its folder."""
    result = provision(site)
    assert result.returncode == 0, result.stderr
    return site.parent / "plant"


def content(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def states(result: Typed) -> dict[str, str]:
    """The state of each file that was not as it should be."""
    files = json.loads(result.stdout)["files"]
    return {each["file"]: each["state"] for each in files if each["state"] != "unchanged"}


def change(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert text.count(old) == 1, old
    path.write_text(text.replace(old, new))


def test_each_machine_gets_its_folder(site: Path) -> None:
    result = provision(site, "--json")
    assert result.returncode == 0, result.stderr
    plant = site.parent / "plant"
    of_site = {"ca/ca.key", "ca/ca.pem", "ca/crl.pem", "hosts.json", "provisioned.json"}
    of_site |= {"broker/pitch-gateway.acl", "broker/pitch-gateway.passwd"}
    of_site |= {f"prometheus/{name}" for name in ("ca.pem", "client.pem", "client.key")}
    of_site |= {"prometheus/mill-1.json", "prometheus/mill-2.json"}
    machines = {f"machines/{name}/{file}" for name in ("mill-1", "mill-2") for file in OF_A_MACHINE}
    assert set(content(plant)) == of_site | machines
    # 8 files of each machine; 3 of the authority, 5 of Prometheus, the inventory; 2 users in 2 files.
    counts = {"new": 29, "changed": 0, "unchanged": 0, "changed by hand": 0}
    assert json.loads(result.stdout)["counts"] == counts


def test_a_configuration_is_plain_and_means_what_base_and_machine_say(site: Path) -> None:
    plant = made(site)
    first, second = (
        tomllib.loads((plant / f"machines/{name}/gateway.toml").read_text()) for name in ("mill-1", "mill-2")
    )
    assert first["gateway"] == {"name": "mill-1", "tables": "tables", "state": "/var/lib/pitch-gateway"}
    assert first["line"]["xyz"]["controllers"] == [
        {"name": "cnc", "tcp": "127.0.0.1:1502", "timeout_ms": 1000}
    ]
    assert (first["axis"]["x"]["counts_per_unit"], second["axis"]["x"]["counts_per_unit"]) == (1000.0, 2000.0)
    assert {**first["axis"]["x"], "counts_per_unit": 2000.0} == second["axis"]["x"]
    assert first["mqtt"] == {"host": "127.0.0.1", "username": "mill-1", "password_file": "mqtt.password"}
    assert first["http"]["tokens"] == [{"name": "people", "file": "people.token"}]
    # The whole check, files and all, where it is.
    loaded = load(plant / "machines/mill-2/gateway.toml")
    assert (loaded.plan.name, list(loaded.tables)) == ("mill-2", ["x"])


def test_secrets_are_for_one_user_and_are_not_printed(site: Path) -> None:
    result = provision(site, "--json")
    plant = site.parent / "plant"
    modes = {str(path.relative_to(plant)): stat.S_IMODE(path.stat().st_mode) for path in plant.rglob("*")}
    secret = {name for name in modes if re.search(r"\.(key|token|password|passwd|acl)$|provisioned", name)}
    assert len(secret) == 11  # 3 of each machine, 2 keys of the site, 2 of the broker, the record
    assert {modes[name] for name in secret} == {0o600}
    assert {modes[name] for name in ("machines", "machines/mill-1", "ca", "broker")} == {0o700}
    said = result.stdout + result.stderr
    for name in ("people.token", "mqtt.password"):
        assert (plant / "machines/mill-1" / name).read_text().strip() not in said
    tokens = {(plant / f"machines/{name}/people.token").read_text() for name in ("mill-1", "mill-2")}
    assert len(tokens) == 2


def test_certificates_name_the_hosts_of_their_machine(site: Path) -> None:
    plant = made(site)
    authority = read_authority(plant / "ca", now_utc())
    for name, hosts in (("mill-1", ["mill-1.plant", "192.168.0.11"]), ("mill-2", ["mill-2"])):
        path = plant / f"machines/{name}/server.pem"
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
        certificate.verify_directly_issued_by(authority.certificate)
        named = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        assert [str(each.value) for each in named] == hosts


def test_targets_and_inventory_use_the_first_host(site: Path) -> None:
    plant = made(site)
    labels = {"machine": "mill-1", "site": "hall-2", "hall": "2"}
    found = json.loads((plant / "prometheus/mill-1.json").read_text())
    assert found == [{"targets": ["mill-1.plant:8480"], "labels": labels}]
    [other] = json.loads((plant / "prometheus/mill-2.json").read_text())
    assert (other["targets"], other["labels"]["hall"]) == (["mill-2:8480"], "3")
    hosts = {"mill-1": {"ansible_host": "mill-1.plant"}, "mill-2": {"ansible_host": "mill-2"}}
    assert json.loads((plant / "hosts.json").read_text()) == {"all": {"hosts": hosts}}


@pytest.mark.parametrize("name", ["ca", "broker", "prometheus", "client", "machines"])
def test_a_machine_may_have_the_name_of_a_folder(site: Path, name: str) -> None:
    site.write_text(BASE + section(f"[machine.{name}]", {}))
    made(site)
    assert provision(site).stdout.endswith(" unchanged\n")


def test_a_second_run_changes_nothing(site: Path) -> None:
    plant = made(site)
    before = {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in plant.rglob("*")}
    result = provision(site)
    assert (result.returncode, result.stdout) == (0, f"{plant}: 2 machines; files: 29 unchanged\n")
    assert {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in plant.rglob("*")} == before


def test_a_dry_run_writes_nothing(site: Path) -> None:
    result = provision(site, "--dry-run")
    assert result.returncode == 0
    assert result.stdout.endswith("2 machines; files: 29 new; nothing was written (--dry-run)\n")
    assert not (site.parent / "plant").exists()


def test_a_changed_site_changes_what_depends_on_it(site: Path) -> None:
    made(site)
    change(site, "2000.0", "4000.0")
    assert states(provision(site, "--json")) == {"machines/mill-2/gateway.toml": "changed"}
    (site.parent / "common/tables/x.tab").write_text(tab(0.0, 0.02, 0.04))
    found = states(provision(site, "--json"))
    assert found == {f"machines/{name}/tables/x.tab": "changed" for name in ("mill-1", "mill-2")}
    (site.parent / "one/tables/x.tab").write_text(tab(0.0, 0.01, 0.02))
    assert states(provision(site, "--json")) == {"machines/mill-1/tables/x.tab": "changed"}


def test_new_hosts_are_a_new_certificate_and_the_reason_is_said(site: Path) -> None:
    plant = made(site)
    token = (plant / "machines/mill-1/people.token").read_bytes()
    change(site, "192.168.0.11", "192.168.0.99")
    result = provision(site)
    assert "machines/mill-1/server.pem: changed (the hosts are others)\n" in result.stdout
    assert "machines/mill-1/server.key: changed (the hosts are others)\n" in result.stdout
    assert result.stdout.endswith("files: 2 changed, 27 unchanged\n")
    assert (plant / "machines/mill-1/people.token").read_bytes() == token


def at(days: float, site: Path, work: Path) -> provisioning.Provisioned:
    """Run it so many days from now."""
    work.mkdir()
    now = now_utc() + timedelta(days=days)
    return provisioning.provision(Site(site), site.parent / "plant", now, work, lambda _: None)


def test_a_certificate_is_renewed_thirty_days_before_its_end(site: Path, tmp_path: Path) -> None:
    made(site)  # for 825 days
    assert at(794, site, tmp_path / "w1").count("changed") == 0
    renewed = at(796, site, tmp_path / "w2")
    assert {name for name, (state, _) in renewed.files.items() if state == "changed"} == {
        *(f"machines/{name}/server.{kind}" for name in ("mill-1", "mill-2") for kind in ("key", "pem")),
        "prometheus/client.key",
        "prometheus/client.pem",
    }
    assert renewed.files["prometheus/client.pem"][1].startswith("the old one ends on 20")
    assert at(796, site, tmp_path / "w3").count("changed") == 0


def test_a_leaf_that_ends_with_its_authority_is_not_renewed_for_ever(site: Path, tmp_path: Path) -> None:
    made(site)
    at(3640, site, tmp_path / "w1")  # the authority has 3650
    assert at(3641, site, tmp_path / "w2").count("changed") == 0


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("machines/mill-1/gateway.toml", "max_speed", "max_speed"),
        ("machines/mill-2/tables/x.tab", "50.0 0.05", "50.0 0.06"),
        ("prometheus/mill-1.json", "hall-2", "hall-3"),
        ("hosts.json", "mill-1.plant", "10.0.0.1"),
        ("broker/pitch-gateway.acl", "mill-1/line/+", "mill-1/line/xyz"),
    ],
)
def test_a_file_that_was_changed_by_hand_stays_and_is_named(
    site: Path, name: str, old: str, new: str
) -> None:
    plant = made(site)
    path = plant / name
    if name.endswith("gateway.toml"):
        path.write_text(f"# mine\n{path.read_text()}")
    else:
        change(path, old, new)
    before = content(plant)
    result = provision(site)
    assert result.returncode == 1
    assert f"{path}" in result.stderr
    assert (
        "changed by hand: left as it is; take the change into site.toml, or delete the file" in result.stderr
    )
    assert content(plant) == before
    path.unlink()
    assert provision(site).returncode == 0
    assert old in path.read_text() or name.endswith("gateway.toml")


def test_a_change_by_hand_that_the_site_takes_over_is_none_any_more(site: Path) -> None:
    plant = made(site)
    for path, old in ((site, "2000.0"), (plant / "machines/mill-2/gateway.toml", "2000.0")):
        change(path, old, "3000.0")
    result = provision(site)
    assert (result.returncode, result.stdout) == (0, f"{plant}: 2 machines; files: 29 unchanged\n")


def test_what_was_changed_by_hand_is_checked_as_it_is(site: Path) -> None:
    plant = made(site)
    path = plant / "machines/mill-1/gateway.toml"
    change(path, "unit_id = 1", "unit_id = 999")
    line_of = path.read_text().split("unit_id")[0].count("\n") + 1
    result = provision(site)
    assert result.returncode == 1
    assert result.stderr.startswith(f"{path}:{line_of}: axis.x.unit_id: mill-1: found 999; allowed: ")


def test_a_machine_that_is_gone_is_named_and_stays(site: Path) -> None:
    plant = made(site)
    before = content(plant)
    site.write_text(BASE + MILL_1)
    result = provision(site)
    assert result.returncode == 0
    left = [f"broker/pitch-gateway.{kind}, user mill-2" for kind in ("acl", "passwd")]
    left += ["machines/mill-2", "prometheus/mill-2.json"]
    notes = [each for each in result.stderr.splitlines() if each.startswith("note: ")]
    assert notes == [f"note: {each}: not of site.toml any more; remove it yourself" for each in left]
    kept = {name: text for name, text in before.items() if name not in ("hosts.json", "provisioned.json")}
    assert kept.items() <= content(plant).items()


def test_users_of_others_at_the_broker_stay(site: Path) -> None:
    plant = made(site)
    access, passwords = (plant / f"broker/pitch-gateway.{kind}" for kind in ("acl", "passwd"))
    viewer = "\n# Who looks.\nuser viewer\ntopic read pitch-gateway/#\n\n# The end.\n"
    access.write_text(access.read_text() + viewer)
    passwords.write_text("viewer:$7$101$x$y\n" + passwords.read_text())
    site.write_text(SITE + section("[machine.mill-3]", {}))
    result = provision(site, "--json")
    assert result.returncode == 0, result.stderr
    assert {each for each in states(result) if each.startswith("broker/")} == {
        "broker/pitch-gateway.acl mill-3",
        "broker/pitch-gateway.passwd mill-3",
    }
    assert viewer in access.read_text()
    assert passwords.read_text().splitlines()[0] == "viewer:$7$101$x$y"
    assert [each.partition(":")[0] for each in passwords.read_text().splitlines()[1:]] == [
        "mill-1",
        "mill-2",
        "mill-3",
    ]


def test_the_access_of_a_machine_is_what_its_configuration_needs(site: Path) -> None:
    change(site, 'host = "127.0.0.1"', 'host = "127.0.0.1"\nbase_topic = "plant/gw"\ncommands = true')
    change(site, "axis.x.counts_per_unit = 2000.0", "mqtt.discovery = 'homeassistant'")
    change(
        site, 'table = "x.tab"', 'table = "x.tab"\nthermal = { alpha = 11e-6, source = { mqtt = "hall/t" } }'
    )
    plant = made(site)
    own = [
        f"write plant/gw/{{}}/{topic}"
        for topic in ("availability", "info", "journal", "event", "line/+", "axis/#")
    ]
    own += ["read plant/gw/{}/command/+", "read hall/t"]
    discovery = "write homeassistant/device/plant_gw_mill-2/+/config"
    for name, more in (("mill-1", set()), ("mill-2", {discovery})):
        text = (plant / "broker/pitch-gateway.acl").read_text()
        [block] = re.findall(rf"^user {name}\n((?:topic .*\n)*)", text, re.MULTILINE)
        assert set(block.splitlines()) == {f"topic {each.format(name)}" for each in own} | {
            f"topic {each}" for each in more
        }


def test_an_authority_that_is_there_is_used_and_left_alone(site: Path, tmp_path: Path) -> None:
    assert typed("certificate", "ca", str(tmp_path / "own")).returncode == 0
    change(site, "[site]\n", '[site]\nauthority = "own"\n')
    before = content(tmp_path / "own")
    plant = made(site)
    assert not (plant / "ca").exists()
    assert content(tmp_path / "own") == before
    assert (plant / "machines/mill-1/ca.pem").read_bytes() == before["ca.pem"]


def test_a_certificate_and_a_token_of_the_site_are_taken(site: Path, tmp_path: Path) -> None:
    now = now_utc()
    pem, key = pem_of(make_server(make_authority("other", now), "mill-1", ["mill-1.plant"], now))
    for name, text in (("server.pem", pem), ("server.key", key), ("people.token", b"abcdefgh" * 4)):
        (tmp_path / "one" / name).write_bytes(text)
        (tmp_path / "one" / name).chmod(0o600)
    plant = made(site)
    assert (plant / "machines/mill-1/server.pem").read_bytes() == pem
    assert (plant / "machines/mill-1/people.token").read_bytes() == b"abcdefgh" * 4


def test_a_page_that_only_the_machine_sees_needs_neither_certificate_nor_target(site: Path) -> None:
    site.write_text(SITE + section("[base.http]", {"listen": "127.0.0.1:8480"}))
    plant = made(site)
    assert set(content(plant / "machines/mill-1")) == {"gateway.toml", "tables/x.tab", "mqtt.password"}
    assert not (plant / "prometheus").exists()


def test_a_run_that_was_cut_off_goes_on(site: Path) -> None:
    """It has said in its record what it was about to write."""
    plant = made(site)
    for name in ("machines/mill-1/server.pem", "machines/mill-2/mqtt.password", "hosts.json"):
        (plant / name).unlink()
    result = provision(site)
    assert result.returncode == 0, result.stderr
    assert "machines/mill-1/server.key: changed (its certificate is not there)" in result.stdout
    load(plant / "machines/mill-1/gateway.toml")
    assert provision(site).stdout.endswith("29 unchanged\n")


def test_a_first_run_that_was_cut_off_in_the_authority_goes_on(site: Path) -> None:
    plant = made(site)
    for name in ("machines", "broker", "prometheus"):
        shutil.rmtree(plant / name)
    (plant / "ca/ca.pem").unlink()
    result = provision(site)
    assert result.returncode == 0, result.stderr
    assert provision(site).stdout.endswith("29 unchanged\n")


def test_an_authority_that_is_missing_is_not_replaced_unasked(site: Path) -> None:
    plant = made(site)
    (plant / "ca").rename(site.parent / "safe")
    before = content(plant)
    result = provision(site)
    assert (result.returncode, content(plant)) == (1, before)
    remedy = f"type: pitch-gateway certificate ca {plant / 'ca'}"
    assert result.stderr.startswith(f"{plant / 'ca/ca.pem'}: no such file, but machines have certificates")
    assert result.stderr.endswith(f"{remedy}\n")
    assert typed(*remedy.partition("pitch-gateway ")[2].split()).returncode == 0
    found = states(provision(site, "--json"))
    assert {name for name in found if name.endswith("server.pem")} == {
        "machines/mill-1/server.pem",
        "machines/mill-2/server.pem",
    }


def test_of_two_runs_at_once_the_later_writes_nothing(site: Path, tmp_path: Path) -> None:
    """Else machines would get certificates of two authorities."""
    plant = site.parent / "plant"
    (tmp_path / "work").mkdir()
    others: list[Typed] = []

    def say(step: str) -> None:
        if step.startswith("mill-2"):  # all of mill-1 has been read
            others.append(provision(site))

    with pytest.raises(provisioning.ProvisionError, match="another run has written here meanwhile"):
        provisioning.provision(Site(site), plant, now_utc(), tmp_path / "work", say)
    assert [other.returncode for other in others] == [0]
    assert provision(site).stdout.endswith("29 unchanged\n")


@pytest.mark.parametrize("name", ["plant", "plant/machines", "plant/machines/mill-1/people.token"])
def test_what_cannot_be_written_is_named(site: Path, name: str) -> None:
    path = site.parent / name
    if name.endswith("token"):
        path.mkdir(parents=True)
    else:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    result = provision(site)
    assert result.returncode == 1
    assert str(path) in result.stderr
    assert "Traceback" not in result.stderr


MISTAKES = [
    ("unit_id = 1", "unit_id = 999", "base.axis.x.unit_id: all 2 machines: found 999; allowed: "),
    (
        "counts_per_unit = 2000.0",
        "counts_per_unt = 2.0",
        "machine.mill-2.axis.x.counts_per_unt: mill-2: unknown",
    ),
    ('units = "mm"\n', "", "base.axis.x.units: all 2 machines: missing; needed: "),
    ("[base.mqtt]", "[base.mqqt]", "base.mqqt: unknown key; did you mean mqtt?"),
    ("[site]", "base.mqqt = 1\n[site]", "base.mqqt: unknown key; did you mean mqtt?"),
    ("[site]", "base.http = 1\n[site]", "base.http: all 2 machines: found 1; allowed: a table [http]"),
    ("[base.mqtt]", "[[base.capture]]\n[base.mqtt]", "base.capture: all 2 machines: found "),
    ('labels = { hall = "3" }', "label = 1", "machine.mill-2.label: unknown key; did you mean labels?"),
    ('files = "one"', 'files = "two"', "machine.mill-1.files: there is no folder "),
    ("mill-1.plant", "mill 1", "machine.mill-1.hosts: found "),
    ('name = "hall-2"', 'name = "hall 2"', "site.name: found "),
    ("machine.mill-2]", 'machine."mill 2"]', 'machine."mill 2": found the name "mill 2"; allowed: 1 to 32 '),
    ('labels = { hall = "2" }', 'labels = { machine = "2" }', "site.labels: found "),
    (
        "axis.x.counts_per_unit = 2000.0",
        "gateway.name = 'x'",
        "machine.mill-2.gateway.name: a name in a conf",
    ),
    ("[machine.mill-2]", "[machine.MILL-1]", "machine.MILL-1: there is also mill-1; choose names that"),
    ("[machine.mill-2]", "[machine.all]", "machine.all: found the name all; choose another name"),
    (
        'labels = { hall = "3" }',
        "hosts = ['Mill-1.plant']",
        "machine.mill-2.hosts: Mill-1.plant is also the first of mill-1; write its own",
    ),
    (
        'labels = { hall = "3" }',
        r'mqtt.username = "x\ntopic readwrite #"',
        r'machine.mill-2.mqtt.username: mill-2: found "x\ntopic readwrite #"; allowed: visible characters',
    ),
    ('host = "127.0.0.1"', "port = 70000", "base.mqtt.port: all 2 machines: found 70000; allowed: "),
]


@pytest.mark.parametrize(("old", "new", "said"), MISTAKES, ids=[said[:40] for _, _, said in MISTAKES])
def test_a_mistake_is_named_with_file_line_and_key(site: Path, old: str, new: str, said: str) -> None:
    number = site.read_text().split(old)[0].count("\n") + 1
    change(site, old, new)
    if not new:
        number = site.read_text().split("[base.axis.x]")[0].count("\n") + 1  # of the table around it
    result = provision(site)
    assert (result.returncode, result.stdout) == (1, "")
    assert f"{site}:{number}: {said}" in result.stderr, result.stderr
    assert "Traceback" not in result.stderr
    assert not (site.parent / "plant").exists()


def test_a_mistake_in_a_table_names_the_file_of_the_site(site: Path) -> None:
    path = site.parent / "common/tables/x.tab"
    path.write_text("nothing\n")
    result = provision(site)
    assert result.returncode == 1
    assert str(path) in result.stderr
    assert "/pitch-gateway-" not in result.stderr  # the folder of the checks


def test_a_secret_that_everybody_may_read_is_refused(site: Path) -> None:
    plant = made(site)
    path = plant / "machines/mill-1/people.token"
    path.chmod(0o644)
    result = provision(site)
    assert result.returncode == 1
    assert (
        f"{path}: mill-1: every user of this machine may read it (mode 0644); chmod o-r {path}"
        in result.stderr
    )


@pytest.mark.parametrize("name", ["ca/ca.key", "prometheus/client.key", "broker/pitch-gateway.passwd"])
def test_a_secret_of_the_site_that_everybody_may_read_is_refused(site: Path, name: str) -> None:
    path = made(site) / name
    path.chmod(0o644)
    result = provision(site)
    assert result.returncode == 1
    assert f"{path}: every user of this machine may read it (mode 0644); chmod o-r {path}" in result.stderr


def test_a_line_of_the_broker_that_was_damaged_counts_as_changed_by_hand(site: Path) -> None:
    path = made(site) / "broker/pitch-gateway.passwd"
    path.write_text(re.sub("^mill-1:.*", "mill-1:$7$0$A$B", path.read_text(), flags=re.MULTILINE))
    result = provision(site)
    assert result.returncode == 1
    assert f"{path} mill-1: changed by hand" in result.stderr
    path.write_bytes(b"\xff\n")
    assert f"{path}: not UTF-8; save the file as UTF-8 text" in provision(site).stderr


def test_a_password_of_the_site_may_begin_and_end_with_spaces(site: Path, tmp_path: Path) -> None:
    """The gateway takes the whole line, and so does the hash."""
    secret = tmp_path / "one/mqtt.password"
    secret.write_text(" s:e#c+ \n")
    secret.chmod(0o600)
    line = (made(site) / "broker/pitch-gateway.passwd").read_text().splitlines()[0]
    _, _, iterations, salt, digest = line.split("$")
    derived = hashlib.pbkdf2_hmac("sha512", b" s:e#c+ ", b64decode(salt), int(iterations))
    assert b64decode(digest) == derived


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "site: missing; needed: [site] with its name"),
        ("[site]\nname = 'x'\n", "machine: missing; needed: at least one [machine.NAME]"),
        ("[site]\nname = 'x'\n[machine]\nmill = 1\n", "machine.mill: found 1; allowed: a table"),
        ("base = 1\n[site]\nname = 'x'\n[machine.m]\n", "base: found 1; allowed: sections"),
        ("[sites]\n", "sites: unknown key; did you mean site?"),
        ("[site\n", "not TOML"),
    ],
)
def test_what_is_no_site_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "site.toml"
    path.write_text(text)
    result = provision(path)
    assert result.returncode == 1
    assert said in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("record", ["", "[]", '{"written": [1]}', '{"written": {"a": 1}}'])
def test_a_record_that_is_none_is_refused(site: Path, record: str) -> None:
    plant = made(site)
    (plant / "provisioned.json").write_text(record)
    result = provision(site)
    assert result.returncode == 1
    assert result.stderr.splitlines()[-1].startswith(
        f"{plant / 'provisioned.json'}: no record of an earlier run"
    )
