"""Who is not in ``allow`` gets nothing."""

import contextlib
import socket

import pytest

from tests.attacks.conftest import Strike
from tests.attacks.controller import PATIENCE_S
from tests.attacks.legitimate import Attack, Ground


def connect_as_a_stranger(ground: Ground) -> str:
    for _ in range(100):
        connection = socket.create_connection(
            ("127.0.0.1", ground.port), timeout=PATIENCE_S, source_address=(ground.attacker, 0)
        )
        with connection, contextlib.suppress(ConnectionError):
            connection.sendall(bytes.fromhex("0001 0000 000b 01 10 0064 0002 04 00000000"))
            assert connection.recv(300) == b""
    return "100 connections closed before a byte was read"


ATTACKS = [
    Attack(
        "commands from an address outside `allow`",
        connect_as_a_stranger,
        "connection-refused",
        lambda _ground, text: text.replace('name = "cnc"', 'name = "cnc"\nallow = ["127.0.0.1"]'),
    )
]


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.name)
def test_an_attack_gets_nothing_and_the_controller_notices_nothing(attack: Attack, strike: Strike) -> None:
    strike(attack)
