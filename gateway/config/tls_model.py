"""``[line.NAME.controllers.tls]``: Modbus/TCP Security on the listener of a controller."""

import os
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, Field

from gateway.config.values import FileName
from gateway.drives.strict import Secret, StrictModel, documented
from gateway.secret_files import CREDENTIAL
from gateway.transport.certificates import LONGEST_ROLE, TlsFiles


def read_role_name(raw: object) -> str:
    """Check the name of a role, as in certificates.

    Raises:
        ValueError: empty, too long, or with invisible characters.
    """
    if not isinstance(raw, str) or not raw.isprintable() or not 0 < len(raw) <= LONGEST_ROLE:
        raise ValueError(f"allowed: 1 to {LONGEST_ROLE} characters, exactly as in the certificates")
    return raw


RoleName = Annotated[str, BeforeValidator(read_role_name)]


class ControllerTls(StrictModel):
    """The gateway's certificate, and which clients may connect."""

    certificate: FileName = Field(
        description="file with the gateway's certificate in PEM, those of authorities between behind it; "
        "relative to the configuration file",
        json_schema_extra=documented(
            text=(
                "PEM file with the gateway's certificate, followed by intermediate authorities; relative "
                "to the configuration file"
            )
        ),
    )
    key: Secret[FileName] = Field(
        description='file with the key of that certificate, or "credential:NAME" of the service manager',
        json_schema_extra=documented(
            text=(
                "file with the key of that certificate, unencrypted, readable only by the gateway's "
                'user; or `"credential:NAME"` from systemd\'s `LoadCredential=`'
            )
        ),
    )
    clients: FileName = Field(
        description=("file with the certificates of the authorities that sign controllers")
    )
    revoked: FileName | None = Field(
        default=None,
        description="file with the authority's list of revoked certificates; left out: none",
        json_schema_extra=documented(text=("file with the authority's revocation list")),
    )

    def files(self, folder: Path) -> TlsFiles:
        """Return the files with absolute paths; ``folder`` is that of the configuration file."""

        def resolved(name: str) -> str:
            return os.fspath((folder / name).absolute())

        key = self.key if self.key.startswith(CREDENTIAL) else resolved(self.key)
        revoked = "" if self.revoked is None else resolved(self.revoked)
        return TlsFiles(resolved(self.certificate), key, resolved(self.clients), revoked)
