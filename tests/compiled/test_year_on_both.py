"""Simulated machines on the compiled gateway, and on its sources: the same bytes, events and files."""

from pathlib import Path

import pytest

from gateway.compiled import is_compiled
from tests.compiled.conftest import ROOT
from tests.year.many import play_seed

pytestmark = pytest.mark.skipif(not is_compiled(), reason="make test-compiled: there is nothing to compare")

AT_STORES = ("kill-at-store", "power-cut-at-store", "slow-store")
"""Faults within a store, which cannot be put into compiled code."""
SEEDS = (2, 3, 4, 6)
"""They have each kind of line."""


@pytest.mark.parametrize("seed", SEEDS)
def test_both_do_the_same_in_a_simulated_machine(sources: Path, seed: int) -> None:
    compiled, plain = (play_seed(seed, 300.0, "absurd", AT_STORES, folder) for folder in (ROOT, sources))
    assert (compiled.is_compiled, plain.is_compiled) == (True, False)
    assert (compiled.finding, plain.finding) == ("", "")
    assert compiled.digest == plain.digest
    assert compiled.seen == plain.seen
