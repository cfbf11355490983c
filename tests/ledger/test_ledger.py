"""The ledger in ``make test``: 30 000 requests; ``make soak`` plays 2 000 000."""

import sys
from collections import Counter

import pytest

from tests.ledger.world import play

SEEDS = (1, 2, 3, 4)
HAPPENS = (
    "held setpoints",
    "setpoints after a whole way",
    "connections closed by controllers",
    "connections closed by the gateway",
    "half requests",
    "jogs on the panel",
    "standstills",
    "writes to unit ids without an axis refused",
)
REQUESTS = 30_000


def test_no_write_is_lost_doubled_or_invented_and_every_axis_stands_where_it_should(
    capsys: pytest.CaptureFixture[str],
) -> None:
    seen: Counter[str] = Counter()
    for seed in SEEDS:
        seen += play(seed, REQUESTS // len(SEEDS)).seen
    with capsys.disabled():
        counts = ", ".join(f"{count} {name}" for name, count in sorted(seen.items()))
        sys.stdout.write(f"\nledger: {counts}\n")
    assert seen["requests"] >= REQUESTS
    faults = sum(count for name, count in seen.items() if name.startswith("fault: "))
    assert 0.04 < faults / seen["frames"] < 0.06
    moves = seen["certain moves"] + seen["ambiguous moves"] + seen["repeats"]
    assert seen["certain moves"] > 0.7 * moves
    assert seen["unsure moves"] < 0.02 * moves
    assert seen["triggers refused with care"] < 0.001 * seen["requests"]
    assert seen["settled axes"] > 500
    assert seen["exact readbacks"] > 2_000
    assert seen["restaged"] > 100
    assert all(seen[what] > 50 for what in HAPPENS)
    # Between two serial wires, on half of the lines.
    assert seen["requests of cut lines"] > 4_000
    assert seen["cut line: requests cut through"] > 100
    assert seen["cut line: replies cut through"] > 100
    assert seen["spoilt frames to the drives"] > 10
    assert seen["cut line: torn"] == 0


def test_the_same_seed_is_the_same_ledger() -> None:
    assert play(7, 1_500).seen == play(7, 1_500).seen
