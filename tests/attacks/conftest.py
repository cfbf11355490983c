"""Gateways that attacks share, as strangers share one: each attack comes from a host of its own."""

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from tests.attacks.legitimate import Attack, Ground, ground_of, tried

Strike = Callable[[Attack], None]


@pytest.fixture(scope="module")
def strike(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Strike]:
    """Try an attack on a gateway that runs as it wants, and assert what holds for every attack.

    The next one of that configuration finds the same gateway, if it has stood this one.
    """
    standing: dict[object, Ground] = {}
    with ExitStack() as stack:

        def strike(attack: Attack) -> None:
            wanted = attack.configuration, attack.connect
            ground = standing.pop(wanted, None)
            if ground is None:
                ground = stack.enter_context(ground_of(attack, tmp_path_factory.mktemp("ground")))
            try:
                tried(attack, ground).check()
                standing[wanted] = ground
            finally:
                if wanted not in standing:
                    sys.stdout.writelines(f"{note}\n" for note in ground.events)

        yield strike
