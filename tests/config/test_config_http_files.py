"""Tokens and certificates of the page: what nobody could be kept out with is refused, with the remedy."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography.x509.oid import ExtendedKeyUsageOID

from gateway.config.files import read_token
from gateway.config.load import load
from tests.config.config_bench import GOOD, loaded, refusal, written
from tests.support.certificates import Shop, authority, signed_by

TOKEN = "0123456789abcdefghijklmnopqrstuv"
OTHER = TOKEN[::-1]
assert len(TOKEN) == 32


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    authority(folder, "ca")
    signed_by(folder, "ca", "mill", "DNS:mill-1")
    signed_by(folder, "ca", "other", "DNS:other")
    for name in ("mill", "other"):
        (folder / f"{name}.key").chmod(0o600)
    (folder / "text.pem").write_text("no certificate\n")
    (folder / "open.key").write_bytes((folder / "mill.key").read_bytes())
    (folder / "open.key").chmod(0o644)
    return folder


def token(folder: Path, text: str | bytes = f"{TOKEN}\n", name: str = "a.token", mode: int = 0o600) -> None:
    (folder / name).write_bytes(text.encode() if isinstance(text, str) else text)
    (folder / name).chmod(mode)


def page(*lines: str, listen: str = "0.0.0.0:8480") -> str:
    return "\n".join((GOOD, "[http]", f'listen = "{listen}"', *lines, ""))


def tls(folder: Path, **files: str) -> str:
    named = {"certificate": "mill.crt", "key": "mill.key", **files}
    return "tls = { " + ", ".join(f'{key} = "{folder / name}"' for key, name in named.items() if name) + " }"


ONE = 'tokens = [{ name = "people", file = "a.token" }]'


@pytest.mark.parametrize(("days", "is_warned"), [(20.0, True), (100.0, False)])
def test_a_list_that_runs_out_is_warned_of(tmp_path: Path, days: float, is_warned: bool) -> None:
    """It is good as long as its authority, and nobody comes in with one that has run out."""
    shop = Shop(tmp_path, days=days)
    shop.server("mill")
    shop.revoke()
    files = {"certificate": "mill.pem", "key": "mill.key", "clients": "ca.pem", "revoked": "crl.pem"}
    warnings = loaded(tmp_path, page(tls(tmp_path, **files))).warnings
    found = [each.found for each in warnings if each.key == "http.tls.revoked"]
    assert [f"{tmp_path}/crl.pem is good until " in each for each in found] == ([True] if is_warned else [])


def test_a_token_and_tls_open_the_page_to_others(tmp_path: Path, certificates: Path) -> None:
    token(tmp_path)
    taken = loaded(tmp_path, page(ONE, tls(certificates)))
    assert taken.warnings == ()
    assert [one.name for one in taken.sections.http.tokens] == ["people"]
    assert TOKEN not in repr(taken)


def test_certificates_of_clients_are_enough(tmp_path: Path, certificates: Path) -> None:
    assert loaded(tmp_path, page(tls(certificates, clients="ca.crt"))).warnings == ()


def test_certificates_that_end_are_warned_of_and_axes_go_on(tmp_path: Path, certificates: Path) -> None:
    shop = Shop(tmp_path, days=20.0)
    shop.leaf("old", ended=timedelta(days=3), purpose=ExtendedKeyUsageOID.SERVER_AUTH)
    shop.leaf("early", begins_in=timedelta(days=3), purpose=ExtendedKeyUsageOID.SERVER_AUTH)
    day = (datetime.now(UTC) - timedelta(days=3)).date()
    for name, said in (("old", f"CN=old expired on {day}"), ("early", "CN=early is not valid before ")):
        files = {"certificate": f"{name}.pem", "key": f"{name}.key", "clients": "ca.pem"}
        found = loaded(tmp_path, page(tls(tmp_path, **files))).warnings
        assert [each.key for each in found] == ["http.tls.certificate", "http.tls.clients"]
        assert found[0].found.startswith(said)
        assert found[1].found.startswith("CN=ca expires on ")
        assert all(each.remedy for each in found)


def test_on_this_machine_tokens_need_no_tls(tmp_path: Path) -> None:
    token(tmp_path)
    assert loaded(tmp_path, page(ONE, listen="127.0.0.1:8480")).warnings == ()


def test_tokens_as_plain_text_over_a_network_are_refused(tmp_path: Path) -> None:
    token(tmp_path)
    problem = refusal(tmp_path, page(ONE), "http.listen")
    assert problem.found == (
        "anyone who reads the network traffic of 0.0.0.0:8480 could copy and use the tokens"
    )
    assert problem.remedy.startswith("add [http.tls] with certificate and key, or listen on 127.0.0.1")


def test_encrypted_for_everybody_is_refused(tmp_path: Path, certificates: Path) -> None:
    problem = refusal(tmp_path, page(tls(certificates)), "http.listen")
    assert problem.remedy.startswith("add tokens, or clients to [http.tls]")


@pytest.mark.parametrize(
    ("content", "mode", "said"),
    [
        (None, 0o600, "no such file"),
        ("", 0o600, "empty"),
        (f"{TOKEN}\n{OTHER}\n", 0o600, "more than one line"),
        (TOKEN, 0o604, "every user of this machine may read it (mode 0604)"),
        (TOKEN[:31], 0o600, "holds no 32 random characters or more"),
        ("a1b2c3d" * 5, 0o600, "holds no 32 random characters or more"),  # 35 of 7 different ones
        (f"{TOKEN} {TOKEN}", 0o600, "holds no 32 random characters or more"),
        (f"{TOKEN}ä", 0o600, "holds no 32 random characters or more"),
        ("x1" * 2500, 0o600, "more than 4096 bytes"),
        (b"\xff" * 40, 0o600, "not UTF-8"),
    ],
)
def test_files_that_hold_no_token(tmp_path: Path, content: str | bytes | None, mode: int, said: str) -> None:
    if content is not None:
        token(tmp_path, content, mode=mode)
    problem = refusal(tmp_path, page(ONE, listen="127.0.0.1:8480"), "http.tokens[1].file")
    assert said in problem.found
    assert TOKEN[:31] not in str(problem)
    assert problem.remedy


def test_what_a_file_ends_with_is_not_the_token(tmp_path: Path) -> None:
    token(tmp_path, f"{TOKEN}\r\n")
    assert read_token(("x",), "a.token", tmp_path) == TOKEN


def test_two_tokens_are_two(tmp_path: Path) -> None:
    token(tmp_path)
    token(tmp_path, name="b.token")
    two = 'tokens = [{ name = "people", file = "a.token" }, { name = "p", file = "b.token" }]'
    problem = refusal(tmp_path, page(two, listen="127.0.0.1:8480"), "http.tokens[2].file")
    assert problem.found == 'the same token as that of "people"'
    token(tmp_path, OTHER, "b.token")
    named = two.replace('"p"', '"people"')
    problem = refusal(tmp_path, page(named, listen="127.0.0.1:8480"), "http.tokens[2].name")
    assert problem.found == 'a second token "people"'
    loaded(tmp_path, page(two, listen="127.0.0.1:8480"))


@pytest.mark.parametrize(
    ("files", "key", "said"),
    [
        ({"certificate": "none.pem"}, "certificate", "no such file"),
        ({"key": ""}, "key", "missing"),
        ({"certificate": ""}, "certificate", "missing"),
        ({"key": "none.key"}, "key", "no such file"),
        ({"key": "open.key"}, "key", "every user of this machine may read it (mode 0644)"),
        ({"key": "other.key"}, "certificate", "key values mismatch"),
        ({"certificate": "text.pem"}, "certificate", "cannot be used together"),
        ({"clients": "text.pem"}, "clients", "no certificates"),
        ({"clients": "none.pem"}, "clients", "no such file"),
        ({"clients": "ca.crt", "revoked": "ca.crt"}, "revoked", "not a list of revoked certificates"),
        ({"clients": "ca.crt", "revoked": "none.pem"}, "revoked", "no such file"),
        ({"revoked": "text.pem"}, "revoked", "but no clients"),
    ],
)
def test_certificates_that_cannot_be_used(
    tmp_path: Path, certificates: Path, files: dict[str, str], key: str, said: str
) -> None:
    token(tmp_path)
    problem = refusal(tmp_path, page(ONE, tls(certificates, **files)), f"http.tls.{key}")
    assert said in problem.found
    assert problem.remedy


def test_a_credential_that_was_handed_over_and_cannot_be_opened_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", f"/{'a' * 300}")
    problem = refusal(tmp_path, page(CREDENTIAL, listen="127.0.0.1:8480"), "http.tokens[1].file")
    assert "File name too long" in problem.found


CREDENTIAL = 'tokens = [{ name = "people", file = "credential:page.token" }]'


@pytest.mark.parametrize("handed_over", [None, "others"])
def test_a_credential_of_another_service_is_not_looked_at_and_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, handed_over: str | None
) -> None:
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    if handed_over:
        monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    password = 'username = "m"\npassword_file = "credential:mqtt"'
    text = page(CREDENTIAL, listen="127.0.0.1:8480") + f"[mqtt]\n{password}\n"
    found = {warning.key: warning for warning in loaded(tmp_path, text).warnings}
    assert found.keys() == {"http.tokens[1].file", "mqtt.password_file"}
    assert found["mqtt.password_file"].found == (
        "credential:mqtt was not checked: only the service receives it"
    )
    assert "LoadCredential=page.token:PATH" in found["http.tokens[1].file"].remedy


@pytest.mark.parametrize("handed_over", [None, "others"])
@pytest.mark.parametrize("name", ["../http-key", "a b", "a:b", "%h"])
def test_a_name_that_no_credential_can_have_is_refused_wherever_it_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, handed_over: str | None
) -> None:
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    if handed_over:
        monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    text = page(CREDENTIAL.replace("page.token", name), listen="127.0.0.1:8480")
    problem = refusal(tmp_path, text, "http.tokens[1].file")
    assert problem.found == f"credential:{name} is no name of a credential"


def test_a_credential_that_was_handed_over_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    token(tmp_path, "short", "page.token")
    text = page(CREDENTIAL, listen="127.0.0.1:8480")
    assert "32 random characters" in refusal(tmp_path, text, "http.tokens[1].file").found
    token(tmp_path, name="page.token", mode=0o440)
    assert loaded(tmp_path, text).warnings == ()


def test_where_it_only_runs_again_nobody_has_its_secrets(tmp_path: Path) -> None:
    text = page(ONE, tls(tmp_path)) + '[mqtt]\nusername = "m"\npassword_file = "gone"\n'
    assert load(written(tmp_path, text), is_elsewhere=True).plan.name == "mill-1"
