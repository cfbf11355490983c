"""What became of connections and files of Modbus/TCP Security."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

CERTIFICATE_REFUSED: Final = EventEntry(
    "certificate-refused",
    Severity.WARNING,
    "a controller was refused because of its certificate",
    "no certificate; one that is expired, revoked or of another authority; or one without a role of `roles`",
    "check its file with `pitch-gateway certificate show FILE`. If it is missing or bad, make one with "
    "`pitch-gateway certificate controller DIR NAME --role ROLE`, under a new name, and copy both files to "
    "the controller. If only its role is missing, add that to `roles` and restart the gateway",
)
HANDSHAKE_FAILED: Final = EventEntry(
    "handshake-failed",
    Severity.WARNING,
    "a TLS handshake failed",
    "plain Modbus or an old TLS on a TLS port; a peer that trusts another authority, disconnects or is "
    "silent",
    "have the controller use TLS 1.2 or newer, trust `ca.pem`, and connect to a name or address in the "
    "gateway's certificate. Otherwise find out what connects",
)
CERTIFICATE_ENDS_SOON: Final = EventEntry(
    "certificate-ends-soon",
    Severity.WARNING,
    "a certificate in force, or a revocation list, expires within 30 days (`days_left`). Reported at the "
    "start and once a day",
    "its validity ends",
    "make another with `pitch-gateway certificate server DIR --host NAME --name NEW`, or have it "
    "renewed. Replace certificate and key; for the page then `pitch-gateway reload CONFIG`",
)
CERTIFICATE_ENDED: Final = EventEntry(
    "certificate-ended",
    Severity.ERROR,
    "a certificate in force, or a revocation list, has expired or is not yet valid by this machine's "
    "clock. New connections fail. Reported once a day",
    "it was not renewed, or the clock is wrong",
    "replace certificate and key as for `certificate-ends-soon`, or set the clock",
)
CERTIFICATES_RENEWED: Final = EventEntry(
    "certificates-renewed",
    Severity.INFO,
    "the changed files of `tls` apply to new connections; for the page after a reload",
    "a renewed certificate or revocation list",
)
CERTIFICATES_NOT_RENEWED: Final = EventEntry(
    "certificates-not-renewed",
    Severity.WARNING,
    "the changed files of `tls` are unusable: the earlier ones stay in force",
    "a certificate with the wrong key, a truncated file, or a key that every user may read",
    "run `pitch-gateway check CONFIG`, and replace the files",
)
