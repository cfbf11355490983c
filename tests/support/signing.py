"""Keys that sign tables, and who is allowed to: made by the real ``ssh-keygen``."""

import shutil
import subprocess
from pathlib import Path

import pytest

from gateway.config.signatures import NAMESPACE, PROGRAM, signature_path

needs_ssh_keygen = pytest.mark.skipif(
    shutil.which(PROGRAM) is None, reason="needs ssh-keygen (apt install openssh-client)"
)


class Signer:
    """A person with a key."""

    def __init__(self, folder: Path, name: str) -> None:
        self.name = name
        self.key = folder / name
        _run("-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(self.key))

    def line(self, options: str = "") -> str:
        """Return the line of a file of allowed signers."""
        kind, public, *_ = self.key.with_suffix(".pub").read_text().split()
        return " ".join(filter(None, (f"{self.name}@plant", options, kind, public))) + "\n"

    def sign(self, table: Path, namespace: str = NAMESPACE) -> Path:
        """Sign a file as it is now; return the signature."""
        signature_path(table).unlink(missing_ok=True)
        _run("-Y", "sign", "-n", namespace, "-f", str(self.key), str(table))
        return signature_path(table)


def _run(*arguments: str) -> None:
    subprocess.run([PROGRAM, *arguments], check=True, capture_output=True, timeout=60)
