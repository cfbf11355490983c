"""Modbus/TCP Security: what comes into the plan, and everything that is wrong before a listener opens."""

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.config.compile import compile_into_state
from gateway.config.load import Loaded, load
from gateway.exchange.plan import Role
from gateway.exchange.rights import RegisterSpan, Rights
from gateway.state.plan import RoleRights, TlsPlan, read_plan
from gateway.transport.certificates import TlsFiles
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal, refused, written
from tests.support.certificates import Shop, openssl

TLS = """\
tcp = "127.0.0.1:1502"

[line.xyz.controllers.tls]
certificate = "server.pem"
key = "server.key"
clients = "ca.pem"

[line.xyz.controllers.roles.Operator]
role = "motion"

[line.xyz.controllers.roles."Beobachter Süd"]
role = "monitor"
read_only = true
unit_ids = [1, 2]
readable = ["0x0500-0x05FF"]
"""
TEXT = edited(('tcp = "127.0.0.1:1502"\nrole = "monitor"\n', TLS))
WITHOUT_ROLES = TEXT[: TEXT.index("[line.xyz.controllers.roles")] + GOOD[GOOD.index("[axis.x]") :]
WITHOUT_TLS = TEXT[: TEXT.index("[line.xyz.controllers.tls")] + TEXT[TEXT.index("[line.xyz.controllers.ro") :]
PLACE = "line.xyz.controllers[2].tls"


@pytest.fixture
def shop(tmp_path: Path) -> Shop:
    shop = Shop(tmp_path)
    shop.server()
    return shop


def warnings_of(taken: Loaded) -> list[str]:
    return [f"{each.key}: {each.found}" for each in taken.warnings if ".tls" in each.key]


def test_files_and_roles_come_into_the_plan(tmp_path: Path, shop: Shop) -> None:
    taken = loaded(tmp_path, TEXT)
    assert warnings_of(taken) == []
    [_, link] = taken.plan.lines[0].controllers
    assert link.tls == TlsPlan(
        TlsFiles(*(str(tmp_path / name) for name in ("server.pem", "server.key", "ca.pem"))),
        {
            "Operator": RoleRights(Role.MOTION),
            "Beobachter Süd": RoleRights(
                Role.MONITOR,
                Rights(
                    is_read_only=True, unit_ids=frozenset({1, 2}), readable=(RegisterSpan(0x0500, 0x05FF),)
                ),
            ),
        },
    )
    assert link.plan.role is Role.MOTION  # the most that any of them may do


def test_the_relay_reads_the_same_out_of_the_state_folder(tmp_path: Path, shop: Shop) -> None:
    path = written(tmp_path, TEXT)
    taken = load(path)
    compile_into_state(taken)
    plan = read_plan(taken.state_folder, path).plan
    assert plan.lines[0].controllers == taken.plan.lines[0].controllers


@pytest.mark.parametrize(
    ("change", "key", "found", "remedy"),
    [
        (('key = "server.key"\n', ""), f"{PLACE}.key", "missing", "needed: file with the key"),
        (('clients = "ca.pem"\n', ""), f"{PLACE}.clients", "missing", "needed: file with the certificates"),
        (('"server.pem"', '"none.pem"'), f"{PLACE}.certificate", "/none.pem: no such file", "give the path"),
        (('"server.pem"', '"ca.pem"'), f"{PLACE}.certificate", "is not for a server", "certificate server"),
        (
            ('"ca.pem"', '"server.pem"'),
            f"{PLACE}.clients",
            "CN=server is not an authority",
            "the authority that",
        ),
        (
            ('"ca.pem"', '"server.key"'),
            f"{PLACE}.clients",
            "server.key: a private key, not a certificate",
            "in PEM",
        ),
        (('"ca.pem"', '"ca.pem"\nrevoked = "ca.pem"'), f"{PLACE}.revoked", "not a list of", "(CRL) in PEM"),
        (("controllers.tls]", "controllers.tsl]"), "line.xyz.controllers[2].tsl", "unknown key", "tls?"),
    ],
)
def test_a_file_that_is_something_else_is_named_with_the_remedy(
    tmp_path: Path, change: tuple[str, str], key: str, found: str, remedy: str
) -> None:
    Shop(tmp_path).server()
    text = edited(change, text=TEXT)
    [problem] = [each for each in refused(tmp_path, text) if each.key == key]
    assert found in problem.found
    assert remedy in problem.remedy
    place = f"{key.rpartition('.')[2]} = "
    assert problem.line == line_of(text, place if place in text else "[line.xyz.controllers.t")


@pytest.mark.parametrize(
    ("text", "key", "found", "marked"),
    [
        (
            edited(("[line.xyz.controllers.tls]", 'role = "motion"\n[line.xyz.controllers.tls]'), text=TEXT),
            "line.xyz.controllers[2].role",
            "role beside tls",
            'role = "motion"',
        ),
        (WITHOUT_ROLES, PLACE, "tls without roles", "[line.xyz.controllers.tls]"),
        (
            edited(('tcp = "127.0.0.1:1502"', 'rtu = "/dev/ttyS9"'), text=TEXT),
            PLACE,
            "tls on a serial port",
            "[line.xyz.controllers.tls]",
        ),
        (
            WITHOUT_TLS,
            "line.xyz.controllers[2].roles",
            "roles without tls",
            "[line.xyz.controllers.roles.Operator]",
        ),
        (
            edited(('"Beobachter Süd"', f'"{65 * "x"}"'), text=TEXT),
            f"line.xyz.controllers[2].roles.{65 * 'x'}",
            f'found "{65 * "x"}"',
            65 * "x",
        ),
    ],
)  # fmt: skip
def test_keys_that_do_not_go_together_are_refused(
    tmp_path: Path, text: str, key: str, found: str, marked: str
) -> None:
    Shop(tmp_path).server()
    problem = refusal(tmp_path, text, key)
    assert problem.found == found
    assert problem.line == line_of(text, marked)


def ended(shop: Shop) -> None:
    shop.leaf("server", purpose=ExtendedKeyUsageOID.SERVER_AUTH, ended=timedelta(hours=30))


def not_begun(shop: Shop) -> None:
    shop.leaf("server", purpose=ExtendedKeyUsageOID.SERVER_AUTH, begins_in=timedelta(days=2))


def other_key(shop: Shop) -> None:
    certificate = (shop.folder / "server.pem").read_bytes()
    shop.server()
    (shop.folder / "server.pem").write_bytes(certificate)


def encrypted_key(shop: Shop) -> None:
    key = shop.authority.key.private_bytes(
        Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"secret")
    )
    (shop.folder / "server.key").write_bytes(key)


def open_key(shop: Shop) -> None:
    (shop.folder / "server.key").chmod(0o644)


def weak_key(shop: Shop) -> None:
    openssl(
        "req", "-x509", "-newkey", "rsa:1024", "-nodes", "-days", "99", "-subj", "/CN=server",
        "-addext", "extendedKeyUsage=serverAuth", "-addext", "subjectAltName=IP:127.0.0.1",
        "-keyout", str(shop.folder / "server.key"), "-out", str(shop.folder / "server.pem"),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("spoil", "key", "found", "remedy"),
    [
        (other_key, "key", "is not the key of", "the key that the certificate was made for"),
        (encrypted_key, "key", "the key is encrypted", "without a password"),
        (open_key, "key", "every user of this machine may read it (mode 0644)", "chmod o-r"),
        (weak_key, "certificate", "RSA of 1024 bits, fewer than 2048", "P-256"),
        (ended, "certificate", "CN=server expired on 20", "set the clock"),
        (not_begun, "certificate", "CN=server is not valid before 20", "wait until then"),
        (lambda shop: shop.leaf("server"), "certificate", "extended key usage serverAuth", "for a server"),
    ],
)
def test_a_certificate_or_key_that_is_not_good_enough_is_refused(
    tmp_path: Path, spoil: Callable[[Shop], object], key: str, found: str, remedy: str
) -> None:
    shop = Shop(tmp_path)
    shop.server()
    spoil(shop)
    problems = [each for each in refused(tmp_path, TEXT) if each.key == f"{PLACE}.{key}"]
    assert [found in each.found and remedy in each.remedy for each in problems] == [True], problems
    assert problems[0].line == line_of(TEXT, f"{key} = ")


def test_an_authority_that_ended_is_refused_and_one_that_soon_will_is_warned_of(tmp_path: Path) -> None:
    soon = Shop(tmp_path, days=20)
    soon.server()
    found = warnings_of(loaded(tmp_path, TEXT))
    assert [each.rpartition(" on ")[0] for each in found] == [
        f"{PLACE}.certificate: CN=server expires",
        f"{PLACE}.clients: CN=ca expires",
    ]
    ended = Shop(tmp_path, days=-1)
    ended.server()
    keys = [problem.key for problem in refused(tmp_path, TEXT)]
    assert keys == [f"{PLACE}.certificate", f"{PLACE}.clients"]


def test_a_certificate_that_names_no_host_is_warned_of(tmp_path: Path, shop: Shop) -> None:
    shop.leaf("server", purpose=ExtendedKeyUsageOID.SERVER_AUTH)
    found = warnings_of(loaded(tmp_path, TEXT))
    assert f"{PLACE}.certificate: {tmp_path}/server.pem names no host (subjectAltName): " in found[-1]


def test_a_list_of_revoked_certificates_that_is_out_of_date_is_refused(tmp_path: Path, shop: Shop) -> None:
    text = edited(('clients = "ca.pem"', 'clients = "ca.pem"\nrevoked = "crl.pem"'), text=TEXT)
    shop.revoke()
    assert warnings_of(loaded(tmp_path, text)) == []
    (tmp_path / "old").mkdir()
    Shop(tmp_path / "old", days=-1).revoke(ago=timedelta(days=3)).rename(tmp_path / "crl.pem")
    assert "is out of date since 20" in refusal(tmp_path, text, f"{PLACE}.revoked").found


def test_a_key_that_the_service_manager_hands_over_is_looked_at_where_it_is(
    tmp_path: Path, shop: Shop, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = edited(('key = "server.key"', 'key = "credential:modbus-key"'), text=TEXT)
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    taken = loaded(tmp_path, text)
    assert warnings_of(taken) == [
        f"{PLACE}.key: credential:modbus-key was not checked: only the service receives it"
    ]
    tls = taken.plan.lines[0].controllers[1].tls
    assert tls is not None
    assert tls.files.key == "credential:modbus-key"
    # The supervisor may have been given other secrets than the relay: that one would say what is wrong.
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    assert len(warnings_of(loaded(tmp_path, text))) == 1
    (tmp_path / "modbus-key").write_text("nothing")
    (tmp_path / "modbus-key").chmod(0o644)
    problem = refusal(tmp_path, text, f"{PLACE}.key")
    assert problem.found == f"{tmp_path}/modbus-key: every user of this machine may read it (mode 0644)"
    (tmp_path / "server.key").rename(tmp_path / "modbus-key")
    assert warnings_of(loaded(tmp_path, text)) == []


def test_a_listener_for_all_the_world_is_no_warning_behind_tls(tmp_path: Path, shop: Shop) -> None:
    taken = loaded(tmp_path, TEXT.replace("127.0.0.1:1502", "0.0.0.0:1802"))
    assert [each for each in taken.warnings if each.key.endswith(".tcp")] == []


# The rights of a role of certificates: checked as those of a controller are.


LISTENER = """tcp = "127.0.0.1:1502"

[line.xyz.controllers.tls]
certificate = "server.pem"
key = "server.key"
clients = "ca.pem"

[line.xyz.controllers.roles.Panel]
"""
ROLE = "line.xyz.controllers[2].roles.Panel"


def with_role(*keys: str) -> str:
    if not any(key.startswith("role =") for key in keys):
        keys = ('role = "motion"', *keys)
    return edited(('tcp = "127.0.0.1:1502"\nrole = "monitor"\n', LISTENER + "\n".join(keys) + "\n"))


@pytest.mark.parametrize(
    ("keys", "key", "found"),
    [
        *(
            ((f"{name} = []",), name, "an empty list, which would allow everything")
            for name in ("unit_ids", "function_codes", "readable", "writable")
        ),
        (('role = "monitor"', "writable = [1]"), "writable", "addresses that may be written, but role"),
        (('writable = ["0x0606"]',), "writable[1]", "0x0606-0x0606 holds a part of a command position"),
        (("read_only = true", "function_codes = [6]"), "function_codes", "only function codes that write"),
    ],
)
def test_rights_of_a_role_that_cannot_be_meant_are_refused(
    tmp_path: Path, shop: Shop, keys: tuple[str, ...], key: str, found: str
) -> None:
    assert found in refusal(tmp_path, with_role(*keys), f"{ROLE}.{key}").found


@pytest.mark.parametrize(
    ("keys", "remedy"),
    [
        (
            ('role = "monitor"', "writable = [1]"),
            "remove writable, or give it another role if it may write them",
        ),
        (
            ("read_only = true", "writable = [1]"),
            "remove writable, or write read_only = false if it may write them",
        ),
    ],
)
def test_who_may_write_nothing_names_no_addresses_to_write(
    tmp_path: Path, shop: Shop, keys: tuple[str, ...], remedy: str
) -> None:
    assert refusal(tmp_path, with_role(*keys), f"{ROLE}.writable").remedy == remedy


def test_a_role_that_does_not_say_what_it_is_gives_nothing(tmp_path: Path, shop: Shop) -> None:
    problem = refusal(
        tmp_path, edited(('tcp = "127.0.0.1:1502"\nrole = "monitor"\n', LISTENER)), f"{ROLE}.role"
    )
    assert (problem.found, problem.remedy) == ("missing", "needed: what a controller with this role may do")


def test_a_role_that_may_move_nothing_is_warned_of(tmp_path: Path, shop: Shop) -> None:
    [warning] = loaded(tmp_path, with_role("function_codes = [3]")).warnings
    assert (warning.key, warning.found) == (
        f"{ROLE}.role",
        'role = "motion", but its rights allow it to move no axis of this line',
    )
