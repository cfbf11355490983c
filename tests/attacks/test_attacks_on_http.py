"""Attacks on the status page over TLS: refused, in the log, and neither a reader nor the machine notices."""

import contextlib
import socket
import ssl
from collections.abc import Callable

import pytest

from tests.attacks.conftest import Strike
from tests.attacks.guarded_page import READER, TOKEN, WRONG, bearer, guarded, page_of
from tests.attacks.legitimate import Attack, Ground, new_host
from tests.supervisor.http.doors import OTHER, write_token

CLOSED = ("/status", "/metrics", "/events", "/tables/x", "/page/page.js", "/reload")
PATHS = (
    "/../../../../etc/passwd",
    "/page/../../../../../etc/passwd",
    "/page/..%2f..%2f..%2f..%2fetc%2fpasswd",
    "/page/%2e%2e/%2e%2e/people.token",
    "/page/%252e%252e%252fpeople.token",
    "/page/..\\..\\people.token",
    "/page/..%5c..%5cpeople.token",
    "/page//etc/passwd",
    "//etc/passwd",
    "/tables/../people.token",
    "/tables/%2fetc%2fpasswd",
    "/tables/x%00.svg",
    "/page/%c0%ae%c0%ae/people.token",
    "file:///etc/passwd",
    "https://localhost/../people.token",
)
HOSTS = ("../../etc/passwd", "localhost/../../etc/passwd", "evil.example", "localhost@evil.example", "")


def look_without_a_token(ground: Ground) -> str:
    with page_of(ground) as page:
        for target in CLOSED:
            assert page.ask(target).status == 401
        assert page.ask("/reload", method="POST").status == 401
    return f"{len(CLOSED) + 1} × 401"


def leave_the_page(ground: Ground) -> str:
    with page_of(ground) as page:
        for more, statuses in (((bearer(TOKEN),), {404}), ((), {401, 404})):
            for target in PATHS:
                answer = page.ask(target, *more)
                assert answer.status in statuses, (target, answer)
                assert b"root:" not in answer.body
                assert TOKEN.encode() not in answer.body
    return f"{len(PATHS)} × 404 with a token, 401 without"


def lie_about_the_host(ground: Ground) -> str:
    with page_of(ground) as page:
        for host in HOSTS:
            head = f"GET /status HTTP/1.1\r\nHost: {host}\r\n{bearer(TOKEN)}\r\n\r\n"
            assert page.say(head.encode()).status in {400, 421}, host
    return f"{len(HOSTS)} × 421 or 400"


def replay(ground: Ground) -> str:
    ground.attacker = new_host()  # nobody is shut out for the tries of the round before
    with page_of(ground) as page:
        logged_in = page.log_in(TOKEN)
        assert logged_in.status == 200
        cookie = logged_in.headers["set-cookie"].partition(";")[0]
        shown = f"Cookie: {cookie}"
        assert page.ask("/status", shown).status == 200
        assert page.ask("/logout", shown, method="POST").status == 200
        of_another_gateway = f"Cookie: {cookie.partition('=')[0]}={'A' * 43}"
        bare = f"Cookie: {cookie.removeprefix('__Host-')}"
        for old in (shown, of_another_gateway, bare):
            assert page.ask("/status", old).status == 401
        kept = f"Cookie: {page.log_in(TOKEN).headers['set-cookie'].partition(';')[0]}"
        assert page.ask("/status", kept).status == 200
        write_token(ground.folder, OTHER)
        assert page.ask("/status", bearer(OTHER)).status == 200
        for old in (kept, bearer(TOKEN)):
            assert page.ask("/status", old).status == 401
        assert page.log_in(TOKEN).status == 401
        write_token(ground.folder, TOKEN)
        assert page.ask("/status", kept).status == 401
    return "401: logged out, rotated, another gateway's"


def guess(ground: Ground) -> str:
    with page_of(ground) as page:
        # A second round finds the address shut already.
        counts = {401: 0, 429: 0}
        for number in range(30):
            wrong = f"{WRONG}{number}"
            answer = page.ask("/status", bearer(wrong)) if number % 2 else page.log_in(wrong)
            counts[answer.status] += 1
        assert counts in ({401: 10, 429: 20}, {401: 0, 429: 30})
        assert page.ask("/status", bearer(TOKEN)).status == 429
    return "10 × 401, then 429 for a minute"


def send_heads_that_never_end(ground: Ground) -> str:
    with page_of(ground) as page, contextlib.ExitStack() as stack:
        slow = []
        for _ in range(300):
            connection = stack.enter_context(page.connect())
            connection.sendall(b"GET /status HTTP/1.1\r\nX-Slow: ")
            slow.append(connection)
        assert _is_closed(slow[0])  # there is room for 256, the reader among them
        assert page.ask("/status", bearer(READER), source="127.0.0.1").status == 200
    return "the oldest of 300 closed"


def flood_with_headers(ground: Ground) -> str:
    with page_of(ground) as page:
        for _ in range(20):
            flood = "".join(f"X-{number}: {'a' * 100}\r\n" for number in range(1000))
            said = f"GET / HTTP/1.1\r\nHost: localhost\r\n{flood}\r\n"
            assert page.say(said.encode(), to_the_end=False).status == 431
    return "20 × 431"


def smuggle(ground: Ground) -> str:
    inside = f"GET /status HTTP/1.1\r\nHost: localhost\r\n{bearer(TOKEN)}\r\n\r\n"
    heads = (
        f"Content-Length: {len(inside)}\r\nTransfer-Encoding: chunked\r\n",
        f"Transfer-Encoding: chunked\r\nContent-Length: {len(inside)}\r\n",
        "Transfer-Encoding: chunked\r\n",
        "Transfer-Encoding: xchunked\r\n",
        f"Content-Length: {len(inside)}\r\nContent-Length: 0\r\n",
        "Content-Length: 0, 5\r\n",
        "Content-Length: +0\r\n",
        "Content-Length : 0\r\n",
        "X: a\r\n Content-Length: 0\r\nContent-Length: 9999\r\n",
    )
    with page_of(ground) as page:
        for head in heads:
            said = f"POST /login HTTP/1.1\r\nHost: localhost\r\n{head}\r\n0\r\n\r\n{inside}"
            answer = page.say(said.encode())
            assert answer.status in {400, 411, 413}, (head, answer)
            assert b"HTTP/1.1" not in answer.rest
    return f"{len(heads)} × 400, 411 or 413, and closed"


def post_from_elsewhere(ground: Ground) -> str:
    with page_of(ground) as page:
        for sent in ("Origin: https://evil.example", "Sec-Fetch-Site: cross-site", "Origin: null"):
            for target in ("/login", "/logout", "/reload"):
                answer = page.ask(target, sent, bearer(TOKEN), method="POST")
                assert answer.status == 403
                assert "set-cookie" not in answer.headers
                assert "access-control-allow-origin" not in answer.headers
    return "9 × 403"


def never_end_the_handshake(ground: Ground) -> str:
    with page_of(ground) as page, contextlib.ExitStack() as stack:
        waiting = []
        for number in range(100):
            connection = stack.enter_context(page.plain())
            with contextlib.suppress(ConnectionError):
                connection.sendall(b"\x16\x03\x01\x02\x00\x01"[: 1 + number % 6])
            waiting.append(connection)
        assert _is_closed(waiting[0])  # 16 from one address at once
        assert page.ask("/status", bearer(READER), source="127.0.0.1").status == 200
    return "the oldest of more than 16 closed, the others after 10 s"


def show_a_foreign_certificate(ground: Ground) -> str:
    with page_of(ground) as page:
        context = ssl.create_default_context(cafile=ground.folder / "ca.crt")
        context.load_cert_chain(ground.folder / "thief.crt", ground.folder / "thief.key")
        got = b""
        with (
            contextlib.suppress(ConnectionError, ssl.SSLError),
            context.wrap_socket(page.plain(), server_hostname="127.0.0.1") as connection,
        ):
            connection.sendall(b"GET /status HTTP/1.1\r\nHost: localhost\r\n\r\n")
            got = connection.recv(300)
        assert got == b""
    return "the handshake fails"


def _is_closed(connection: socket.socket) -> bool:
    try:
        return connection.recv(1) == b""
    except (ConnectionError, ssl.SSLError):
        return True


def _on_the_page(what: str, strike: Callable[[Ground], str], event: str) -> Attack:
    return Attack(f"status page: {what}", strike, event, guarded, secrets=(TOKEN, READER, WRONG, OTHER))


ATTACKS = [
    _on_the_page("without a token", look_without_a_token, "http-refused"),
    _on_the_page("path traversal", leave_the_page, "http-refused"),
    _on_the_page("a lying `Host`", lie_about_the_host, "http-refused"),
    _on_the_page("replayed tokens and sessions", replay, "token-refused"),
    _on_the_page("tokens guessed", guess, "token-refused"),
    _on_the_page("heads that never end", send_heads_that_never_end, "http-refused"),
    _on_the_page("header flood", flood_with_headers, "http-refused"),
    _on_the_page("request smuggling", smuggle, "http-refused"),
    _on_the_page("cross-site POST", post_from_elsewhere, "http-refused"),
    _on_the_page("a TLS handshake that never ends", never_end_the_handshake, "http-refused"),
    _on_the_page("a foreign certificate", show_a_foreign_certificate, "http-refused"),
]


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.name)
def test_an_attack_on_the_page_gets_nothing_and_nobody_notices(attack: Attack, strike: Strike) -> None:
    strike(attack)
