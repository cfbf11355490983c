"""Modbus/TCP Security: who has no good certificate gets nothing, and costs nobody else anything."""

import contextlib
import socket
import ssl
import subprocess
import time
import warnings
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509

from gateway.commissioning.certificates import role_extension
from gateway.transport.certificates import ROLE_OID
from gateway.transport.handshakes import AT_ONCE_OF_A_HOST, BURST_OF_A_HOST, PER_S_OF_A_HOST
from tests.attacks.conftest import Strike
from tests.attacks.controller import PATIENCE_S
from tests.attacks.legitimate import Attack, Ground, Legitimate
from tests.support.certificates import Shop, client_context

WRITE = bytes.fromhex("0001 0000 000b 01 10 0064 0002 04 00000000")
TLS = """
[line.xyz.controllers.tls]
certificate = "server.pem"
key = "server.key"
clients = "ca.pem"
revoked = "crl.pem"

[line.xyz.controllers.roles.Operator]
role = "motion"
"""
PLAIN = '\n[[line.xyz.controllers]]\nname = "secure"\ntcp = "127.0.0.1:{port}"\n'
Certificate = tuple[Path, Path] | None


def secured(ground: Ground, text: str) -> str:
    """The controller at work has a certificate, and connects by TLS."""
    _make(ground)
    return text.replace("\n[axis.x]", f"{TLS}\n[axis.x]")


def beside(ground: Ground, text: str) -> str:
    """The controller at work has a plain listener of its own; TLS is on another one of the same line."""
    _make(ground)
    listener = PLAIN.format(port=ground.free("secure")) + TLS
    return text.replace("\n[axis.x]", f'{listener}\n[axis.x]\nwriters = "any"')


def _make(ground: Ground) -> None:
    shop = Shop(ground.folder)
    shop.server()
    cnc = shop.controller("cnc", "Operator")
    assert cnc[0].exists()
    shop.revoke()


def by_tls(ground: Ground, legitimate: Legitimate) -> None:
    legitimate.connect(ground.port, *(ground.folder / name for name in ("ca.pem", "cnc.pem", "cnc.key")))


def port_of(ground: Ground) -> int:
    return ground.others.get("secure", ground.port)


def connected(ground: Ground) -> socket.socket:
    return socket.create_connection(
        ("127.0.0.1", port_of(ground)), timeout=PATIENCE_S, source_address=(ground.attacker, 0)
    )


def gets_nothing(ground: Ground, context: ssl.SSLContext) -> None:
    """Command a move: in vain, whether the handshake ends already or what comes behind it."""
    raw = connected(ground)
    try:
        with context.wrap_socket(raw, server_hostname="127.0.0.1") as connection:
            connection.sendall(WRITE)
            assert connection.recv(300) == b""
    except (ssl.SSLError, ConnectionError):
        raw.close()


def with_certificate(make: Callable[[Ground], Certificate]) -> Callable[[Ground], str]:
    def strike(ground: Ground) -> str:
        context = client_context(ground.folder / "ca.pem", make(ground))
        for _ in range(AT_ONCE_OF_A_HOST):
            gets_nothing(ground, context)
        return "the connection ends; no answer"

    return strike


def expired(ground: Ground) -> Certificate:
    return _own(ground).leaf("expired", [role_extension("Operator")], ended=timedelta(minutes=30))


def foreign(ground: Ground) -> Certificate:
    folder = ground.folder / "foreign"
    folder.mkdir(exist_ok=True)
    return Shop(folder).controller("cnc", "Operator")


def without_role(ground: Ground) -> Certificate:
    return _own(ground).leaf("roleless")


def of_unknown_role(ground: Ground) -> Certificate:
    return _own(ground).controller("unknown", "operator")  # not "Operator"


def with_two_roles(ground: Ground) -> Certificate:
    both = role_extension("Operator").value + role_extension("Operator").value
    return _own(ground).leaf("two", [x509.UnrecognizedExtension(x509.ObjectIdentifier(ROLE_OID), both)])


def revoked(ground: Ground) -> Certificate:
    shop = _own(ground)
    shown = shop.controller("revoked", "Operator")
    shop.revoke(shown[0])
    return shown


def none(_ground: Ground) -> Certificate:
    return None


def _own(ground: Ground) -> Shop:
    return Shop.found(ground.folder)


def with_old_tls(ground: Ground) -> str:
    context = client_context(ground.folder / "ca.pem", (ground.folder / "cnc.pem", ground.folder / "cnc.key"))
    context.set_ciphers("DEFAULT@SECLEVEL=0")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that it is old is the point
        context.minimum_version = context.maximum_version = ssl.TLSVersion.TLSv1_1
    gets_nothing(ground, context)
    return "the handshake fails"


def without_forward_secrecy(ground: Ground) -> str:
    context = client_context(ground.folder / "ca.pem", (ground.folder / "cnc.pem", ground.folder / "cnc.key"))
    context.maximum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers("AES128-SHA256:ECDHE-ECDSA-AES128-SHA256")
    gets_nothing(ground, context)
    return "the handshake fails"


def with_plain_modbus(ground: Ground) -> str:
    for _ in range(AT_ONCE_OF_A_HOST):
        with connected(ground) as connection, contextlib.suppress(ConnectionError):
            connection.sendall(WRITE)
            assert connection.recv(300) == b""
    return "the connection ends; no answer"


def without_end(ground: Ground) -> str:
    """Begin handshakes and say nothing more: in the middle of a record, before one, and behind one."""
    hello = client_hello(ground)
    connections = []
    for number in range(AT_ONCE_OF_A_HOST):
        connection = connected(ground)
        connection.settimeout(30.0)
        with contextlib.suppress(ConnectionError):
            connection.sendall((b"", hello[:1], hello[:50], hello)[number % 4])
        connections.append(connection)
    for connection in connections:
        with connection, contextlib.suppress(ConnectionError):
            while connection.recv(4096):
                pass
    return "ended after 5 s"


def client_hello(ground: Ground) -> bytes:
    incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
    context = client_context(ground.folder / "ca.pem", None)
    client = context.wrap_bio(incoming, outgoing, server_hostname="127.0.0.1")
    with contextlib.suppress(ssl.SSLWantReadError):
        client.do_handshake()
    return outgoing.read()


def five_hundred(ground: Ground) -> str:
    """Connect so often at once, and begin a handshake each time; count who is answered with one."""
    hello = client_hello(ground)
    began_s = time.monotonic()
    connections = []
    for _ in range(500):
        with contextlib.suppress(OSError):
            connection = connected(ground)
            connection.sendall(hello)
            connections.append(connection)
    answered = 0
    for connection in connections:
        with connection, contextlib.suppress(OSError):
            answered += bool(connection.recv(1))
    most = BURST_OF_A_HOST + PER_S_OF_A_HOST * (time.monotonic() - began_s) + 1
    assert answered <= most, (answered, most)
    return "10 handshakes at once and 5 a second from one address; the others are closed"


def renegotiating(ground: Ground) -> str:
    """Ask for a new handshake in a session of TLS 1.2, with a good certificate; Python cannot."""
    command = [
        *(
            "openssl",
            "s_client",
            "-connect",
            f"127.0.0.1:{port_of(ground)}",
            "-tls1_2",
            "-legacy_renegotiation",
        ),
        *("-CAfile", str(ground.folder / "ca.pem"), "-cert", str(ground.folder / "cnc.pem")),
        *("-key", str(ground.folder / "cnc.key"), "-bind", f"{ground.attacker}:0"),
    ]
    time.sleep(1.0 / PER_S_OF_A_HOST)  # an attacker who keeps below what is bounded already
    done = subprocess.run(command, input="R\n", capture_output=True, text=True, timeout=30, check=False)
    said = done.stdout + done.stderr
    assert "RENEGOTIATING" in said, said
    assert "no renegotiation" in said, said
    return "answered with `no renegotiation`"


REFUSED, FAILED, TOO_MANY = "certificate-refused", "handshake-failed", "connection-refused"
ATTACKS = [
    Attack("TLS without a certificate", with_certificate(none), REFUSED, secured, by_tls),
    Attack("an expired certificate", with_certificate(expired), REFUSED, secured, by_tls),
    Attack("a certificate of a foreign authority", with_certificate(foreign), REFUSED, secured, by_tls),
    Attack("a revoked certificate", with_certificate(revoked), REFUSED, secured, by_tls),
    Attack("a certificate without a role", with_certificate(without_role), REFUSED, secured, by_tls),
    Attack("a certificate with an unknown role", with_certificate(of_unknown_role), REFUSED, secured, by_tls),
    Attack("a certificate with two roles", with_certificate(with_two_roles), REFUSED, secured, by_tls),
    Attack("TLS 1.1", with_old_tls, FAILED, secured, by_tls),
    Attack("TLS 1.2 without forward secrecy", without_forward_secrecy, FAILED, secured, by_tls),
    Attack("plain Modbus on a TLS port", with_plain_modbus, FAILED, secured, by_tls),
    Attack("TLS handshakes that never end", without_end, FAILED, secured, by_tls),
    Attack("renegotiation", renegotiating, "ready", secured, by_tls, names_attacker=False),
    Attack("500 TLS handshakes at once", five_hundred, TOO_MANY, secured, by_tls),
    Attack("500 TLS handshakes at once beside a plain listener", five_hundred, TOO_MANY, beside),
]  # fmt: skip


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.name)
def test_an_attack_gets_nothing_and_the_controller_notices_nothing(attack: Attack, strike: Strike) -> None:
    strike(attack)
