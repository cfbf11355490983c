"""What became of connections and files of Modbus/TCP Security."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

CERTIFICATE_REFUSED: Final = EventEntry(
    "certificate-refused",
    Severity.WARNING,
    "a controller was not let in for its certificate; told once a minute for each host and reason",
    "no certificate, one that has expired, was revoked or is of another authority, or one without a role of "
    "`roles`",
    "look at its file with `pitch-gateway certificate show FILE`. Where there is none, or it is not good, "
    "make one with `pitch-gateway certificate controller DIR NAME --role ROLE` under a new name, and give "
    "both files to the controller. Where only its role is missing, add it to `roles` and start the gateway "
    "again",
)
HANDSHAKE_FAILED: Final = EventEntry(
    "handshake-failed",
    Severity.WARNING,
    "a TLS handshake came to nothing; told once a minute for each host and reason",
    "plain Modbus or an old TLS on a TLS port; a peer that trusts another authority, hangs up or is silent",
    "let the controller speak TLS 1.2 or newer, trust the gateway's authority (give it `ca.pem`), and "
    "connect to a name or an address that stands in the gateway's certificate; else find out who it is",
)
CERTIFICATE_ENDS_SOON: Final = EventEntry(
    "certificate-ends-soon",
    Severity.WARNING,
    "a certificate in force, or a list of revoked ones, ends within 30 days; told at the start and once a "
    "day, with `days_left`",
    "its time is nearly over",
    "make another one with `pitch-gateway certificate server DIR --host NAME --name NEW`, or have it "
    "renewed, and put it with its key in the place of the old one; for the page then `pitch-gateway reload "
    "CONFIG`",
)
CERTIFICATE_ENDED: Final = EventEntry(
    "certificate-ended",
    Severity.ERROR,
    "a certificate in force, or a list of revoked ones, is good no more, or not yet by the clock of this "
    "machine: whoever connects anew is turned away or hangs up; told once a day",
    "it was not renewed, or the clock is wrong",
    "put a good one with its key in its place, as `pitch-gateway explain certificate-ends-soon` says; for "
    "the page then `pitch-gateway reload CONFIG`. Or set the clock",
)
CERTIFICATES_RENEWED: Final = EventEntry(
    "certificates-renewed",
    Severity.INFO,
    "the files of `tls` had changed and are in force for new connections; of the page after a reload",
    "a certificate was renewed, or the list of revoked ones is another",
)
CERTIFICATES_NOT_RENEWED: Final = EventEntry(
    "certificates-not-renewed",
    Severity.WARNING,
    "the files of `tls` had changed and cannot be used: those of before stay in force",
    "a certificate and the key of another, a file that was cut short, or a key that every user may read",
    "run `pitch-gateway check CONFIG`, and put good files there",
)
