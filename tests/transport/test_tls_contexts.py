"""The contexts of a listener with TLS: what they keep of sessions that have ended."""

import ssl
from contextlib import suppress
from pathlib import Path

from gateway.transport.certificates import TlsFileError, TlsFiles
from gateway.transport.tls import MOST_SESSIONS, ServerContexts
from tests.support.certificates import Shop, client_context


def talk(server: ssl.SSLContext, client: ssl.SSLContext) -> None:
    """Shake hands and part in good order: such a session OpenSSL keeps."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    near = client.wrap_bio(to_client, to_server, server_hostname="127.0.0.1")
    far = server.wrap_bio(to_server, to_client, server_side=True)
    for step in ("do_handshake",) * 3 + ("unwrap",) * 2:
        for end in (near, far):
            with suppress(ssl.SSLWantReadError):
                getattr(end, step)()
    assert near.version() == "TLSv1.2"


def test_sessions_of_tls_1_2_do_not_fill_the_memory(tmp_path: Path) -> None:
    shop = Shop(tmp_path)
    certificate, key = shop.server()
    told: list[TlsFileError | None] = []
    files = TlsFiles(str(certificate), str(key), str(shop.path), str(shop.revoke()))
    contexts = ServerContexts(files, lambda: told.append(None), told.append)
    contexts.open()
    client = client_context(shop.path, shop.controller("cnc", "Operator"))
    client.maximum_version = ssl.TLSVersion.TLSv1_2
    kept = []
    for _ in range(2 * MOST_SESSIONS + 2):
        context = contexts.current()
        talk(context, client)
        kept.append(context.session_stats()["number"])
    assert kept == [*range(1, MOST_SESSIONS + 1)] * 2 + [1, 2]
    assert told == []  # the files are the same
