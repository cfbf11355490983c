"""Certificates that are thrown away: an authority, a server and a client, made with the openssl command."""

import shutil
import subprocess
from pathlib import Path


def openssl(*arguments: str) -> None:
    program = shutil.which("openssl")
    assert program, "openssl is not installed: apt-get install openssl"
    subprocess.run([program, *arguments], check=True, capture_output=True)


def authority(folder: Path, name: str) -> Path:
    """Make an authority; returns its certificate."""
    cert, key = folder / f"{name}.crt", folder / f"{name}.key"
    openssl(
        "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2",
        "-subj", f"/CN={name}", "-addext", "keyUsage=critical,keyCertSign",
        "-keyout", str(key), "-out", str(cert),
    )  # fmt: skip
    return cert


def signed_by(folder: Path, signer: str, name: str, subject_alt_name: str) -> tuple[Path, Path]:
    """Make a certificate and its key."""
    cert, key, request = (folder / f"{name}.{kind}" for kind in ("crt", "key", "csr"))
    openssl(
        "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes",
        "-subj", f"/CN={name}", "-keyout", str(key), "-out", str(request),
    )  # fmt: skip
    extension = folder / f"{name}.ext"
    extension.write_text(f"subjectAltName={subject_alt_name}\n")
    openssl(
        "x509", "-req", "-in", str(request), "-days", "2", "-CA", str(folder / f"{signer}.crt"),
        "-CAkey", str(folder / f"{signer}.key"), "-CAcreateserial", "-extfile", str(extension),
        "-out", str(cert),
    )  # fmt: skip
    return cert, key
