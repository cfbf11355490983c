"""Signatures of table files: ``ssh-keygen -Y verify`` with a file of allowed signers (decision 59).

The bytes that become the table are those that are checked: they go to ``ssh-keygen`` through a pipe.
"""

import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Final

from gateway.files import FileMissingError, FileRefusedError, read_regular_file

PROGRAM: Final = "ssh-keygen"
NAMESPACE: Final = "pitch-gateway"
SUFFIX: Final = ".sig"
KEY: Final = ("gateway", "allowed_signers")
TIMEOUT_S: Final = 10.0
"""For each start of ``ssh-keygen``."""
LARGEST_SIGNATURE: Final = 65_536
"""Bytes. One of RSA with 16384 bits has some 6000."""
LARGEST_ALLOWED: Final = 1_000_000
INSTALL: Final = "install OpenSSH's client (Debian: apt install openssh-client)"


class SignatureRefusedError(Exception):
    """A signature that does not count: what was found, and what to do."""

    def __init__(self, found: str, remedy: str) -> None:
        super().__init__(f"{found}; {remedy}")
        self.found = found
        self.remedy = remedy


def signature_path(table: Path) -> Path:
    """Return where ``ssh-keygen -Y sign`` puts the signature of a file."""
    return table.with_name(f"{table.name}{SUFFIX}")


def sign_command(table: Path) -> str:
    """Return the line that signs a table."""
    return f"{PROGRAM} -Y sign -n {NAMESPACE} -f KEY {shlex.quote(str(table))}"


def check_tools(allowed: Path) -> None:
    """Check that signatures can be checked at all.

    Raises:
        SignatureRefusedError: ``ssh-keygen`` or the file of allowed signers is missing, or cannot be used.
    """
    if shutil.which(PROGRAM) is None:
        raise SignatureRefusedError(f"there is no {PROGRAM}, which checks signatures", INSTALL)
    try:
        read_regular_file(allowed, LARGEST_ALLOWED, "a file of allowed signers (man ssh-keygen)")
    except FileRefusedError as error:
        raise SignatureRefusedError(f"{allowed}: {error.found}", error.remedy) from None


def signer_of(table: Path, content: bytes, allowed: Path) -> str:
    """Return who signed a table with this content: a principal of the file of allowed signers.

    It starts ``ssh-keygen`` twice, more often where the signature does not count, and blocks meanwhile.

    Raises:
        SignatureRefusedError: unsigned, signed for another content or namespace, or by nobody who is allowed.
    """
    check_tools(allowed)
    signature = signature_path(table)
    try:
        read_regular_file(signature, LARGEST_SIGNATURE, "a signature")
    except FileMissingError:
        found = f"not signed: there is no {signature.name}"
        raise SignatureRefusedError(found, f"sign it: {sign_command(table)}") from None
    except FileRefusedError as error:
        raise SignatureRefusedError(f"{signature}: {error.found}", error.remedy) from None
    by_file = ("-n", NAMESPACE, "-s", str(signature))
    asked = _run(["find-principals", *by_file, "-f", str(allowed)], b"")
    said = asked.stderr
    for principal in asked.stdout.decode(errors="replace").splitlines():
        verified = _run(["verify", *by_file, "-f", str(allowed), "-I", principal], content)
        if verified.returncode == 0:
            return principal
        said = verified.stderr
    alone = _run(["check-novalidate", *by_file], content)
    if alone.returncode != 0:
        found = f"{signature.name} is no signature of this content ({_first(alone.stderr)})"
        raise SignatureRefusedError(found, f"sign it again: {sign_command(table)}")
    key = _first(alone.stdout).rpartition(" with ")[2]
    why = f" ({_first(said)})" if said.strip() else ""
    raise SignatureRefusedError(
        f"signed with {key}, which {allowed} does not allow{why}",
        f"sign it with an allowed key: {sign_command(table)}; or allow that key there",
    )


def _run(arguments: list[str], content: bytes) -> "subprocess.CompletedProcess[bytes]":
    try:
        return subprocess.run(  # noqa: S603 - no shell; each argument is a word or a path
            [PROGRAM, "-Y", *arguments],
            input=content,
            capture_output=True,
            timeout=TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise SignatureRefusedError(
            f"{PROGRAM} has not answered within {TIMEOUT_S:g} s", "check the load of this computer"
        ) from None
    except OSError as error:
        raise SignatureRefusedError(f"{PROGRAM}: {error.strerror or error}", INSTALL) from None


def _first(said: bytes) -> str:
    lines = said.decode(errors="replace").strip().splitlines()
    return lines[0] if lines else f"{PROGRAM} says nothing"
