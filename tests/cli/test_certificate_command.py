"""An authority, and what it signs: files that openssl agrees with, and that nothing overwrites."""

import json
import re
import stat
import subprocess
from pathlib import Path

import pytest
from cryptography import x509
from typer.testing import CliRunner, Result

from gateway.cli.app import app
from tests.support.certificates import Shop


def command(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["certificate", *map(str, arguments)])


def made(folder: Path) -> Path:
    """A folder with an authority, a gateway's certificate and a controller's."""
    for arguments in (
        ("ca", folder),
        ("server", folder, "--host", "mill-1.local", "--host", "192.168.0.5", "--host", "fd00::5"),
        ("controller", folder, "cnc", "--role", "Beobachter Süd"),
    ):
        result = command(*arguments)
        assert result.exit_code == 0, result.output
    return folder


def openssl(*arguments: object) -> str:
    done = subprocess.run(["openssl", *map(str, arguments)], capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def test_openssl_finds_good_what_was_made(tmp_path: Path) -> None:
    folder = made(tmp_path / "ca")
    ca, server, cnc = (folder / f"{name}.pem" for name in ("ca", "server", "cnc"))
    assert (
        openssl("verify", "-x509_strict", "-CAfile", ca, "-purpose", "sslserver", server) == f"{server}: OK\n"
    )
    assert openssl("verify", "-x509_strict", "-CAfile", ca, "-purpose", "sslclient", cnc) == f"{cnc}: OK\n"
    assert "unsuitable certificate purpose" in openssl("verify", "-CAfile", ca, "-purpose", "sslserver", cnc)
    text = openssl("x509", "-in", server, "-noout", "-text")
    assert "DNS:mill-1.local, IP Address:192.168.0.5, IP Address:FD00:0:0:0:0:0:0:5" in text
    assert "NIST CURVE: P-256" in text
    # UTF8String (0C) of 15 bytes: ü is two.
    assert "1.3.6.1.4.1.50316.802.1" in openssl("x509", "-in", cnc, "-noout", "-text")
    parsed = openssl("asn1parse", "-in", cnc)
    assert "0C0F" + "Beobachter Süd".encode().hex().upper() in parsed


def test_keys_are_for_one_user_and_leafs_are_good_for_825_days(tmp_path: Path) -> None:
    folder = made(tmp_path / "ca")
    assert {path.name: stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {
        **dict.fromkeys(("ca.key", "server.key", "cnc.key"), 0o600),
        **dict.fromkeys(("ca.pem", "server.pem", "cnc.pem", "crl.pem"), 0o644),
    }
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    for name, days in (("ca", 3650), ("server", 825), ("cnc", 825)):
        certificate = x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())
        lasts = certificate.not_valid_after_utc - certificate.not_valid_before_utc
        assert (lasts.days, lasts.seconds) == (days, 3600)  # and an hour for clocks that differ


@pytest.mark.parametrize(
    ("arguments", "file"),
    [
        (("ca",), "crl.pem"),
        (("server", "--host", "other"), "server.pem"),
        (("controller", "cnc", "--role", "Operator"), "cnc.pem"),
    ],
)
def test_nothing_is_overwritten(tmp_path: Path, arguments: tuple[str, ...], file: str) -> None:
    folder = made(tmp_path / "ca")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    result = command(arguments[0], folder, *arguments[1:])
    assert result.exit_code == 1
    assert result.stderr.startswith(f"{folder / file} exists already and is not overwritten; ")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_what_is_revoked_is_bad_for_openssl_too(tmp_path: Path) -> None:
    folder = made(tmp_path / "ca")
    check = ("verify", "-crl_check", "-CAfile", folder / "ca.pem", "-CRLfile", folder / "crl.pem")
    assert openssl(*check, folder / "cnc.pem") == f"{folder}/cnc.pem: OK\n"
    assert command("controller", folder, "hmi", "--role", "Viewer").exit_code == 0
    for name in ("cnc", "hmi"):
        result = command("revoke", folder, name)
        assert (result.exit_code, result.stdout) == (0, f"{folder}/crl.pem\n")
        assert "certificate revoked" in openssl(*check, folder / f"{name}.pem")
    assert "certificate revoked" in openssl(*check, folder / "cnc.pem")
    assert openssl(*check, folder / "server.pem") == f"{folder}/server.pem: OK\n"
    again = command("revoke", folder, "cnc")
    assert (again.exit_code, again.stderr) == (1, f"{folder}/cnc.pem: is already in {folder}/crl.pem\n")


def test_a_certificate_is_shown_to_people_and_to_programs(tmp_path: Path) -> None:
    folder = made(tmp_path / "ca")
    shown = command("show", folder / "cnc.pem").stdout
    assert shown.startswith("controller: CN=cnc\n  role    Beobachter Süd\n  valid   from 20")
    assert re.search(r"\(82[45] days left\)\n  key     secp256r1\n", shown)
    [found] = json.loads(command("show", folder / "server.pem", "--json").stdout)["certificates"]
    assert (found["kind"], found["hosts"]) == ("server", ["mill-1.local", "192.168.0.5", "fd00::5"])
    assert (found["role"], found["issuer"]) == (None, "CN=pitch-gateway CA")
    assert command("show", folder / "ca.pem").stdout.startswith("authority: CN=pitch-gateway CA\n")
    command("revoke", folder, "cnc")
    assert command("show", folder / "crl.pem").stdout.startswith(
        "a list of revoked certificates: 1, valid until "
    )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("server", "EMPTY", "--host", "x"), "no authority (ca.pem, ca.key): no such file; "),
        (("revoke", "FOLDER", "nobody"), "/nobody.pem: no such file; give the path of a certificate"),
        (("show", "FOLDER/ca.key"), "/ca.key: a private key, not a certificate;"),
        (("revoke", "FOLDER", "foreign"), "not a certificate of the authority of "),
    ],
)
def test_what_cannot_be_done_is_one_line_with_the_remedy(
    tmp_path: Path, arguments: tuple[str, ...], said: str
) -> None:
    folder = made(tmp_path / "folder")
    (tmp_path / "other").mkdir()
    Shop(tmp_path / "other").controller("foreign", "Operator")[0].rename(folder / "foreign.pem")
    places = [
        one.replace("FOLDER", str(folder)).replace("EMPTY", str(tmp_path / "other2")) for one in arguments
    ]
    result = command(*places)
    assert result.exit_code == 1
    assert said in result.stderr
    assert result.stderr.count("\n") == 1


def test_an_authority_that_ended_signs_nothing(tmp_path: Path) -> None:
    Shop(tmp_path, days=-1)
    result = command("controller", tmp_path, "cnc", "--role", "Operator")
    assert result.exit_code == 1
    assert re.fullmatch(rf"{tmp_path}/ca\.pem expired on 20\d\d-\d\d-\d\d; make a new .*\n", result.stderr)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ca.key", "ca.pem"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("controller", "FOLDER", "../cnc", "--role", "Operator"),
        ("controller", "FOLDER", "ca", "--role", "Operator"),
        ("controller", "FOLDER", "cnc", "--role", ""),
        ("controller", "FOLDER", "cnc", "--role", 65 * "x"),
        ("controller", "FOLDER", "cnc"),
        ("server", "FOLDER"),
        ("server", "FOLDER", "--host", "mill 1"),
    ],
)
def test_wrong_usage_makes_nothing(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    assert command("ca", tmp_path / "ca").exit_code == 0
    result = command(*[str(tmp_path / "ca") if one == "FOLDER" else one for one in arguments])
    assert result.exit_code == 2
    assert sorted(path.name for path in (tmp_path / "ca").iterdir()) == ["ca.key", "ca.pem", "crl.pem"]
