"""Play the ledger: ``python -m tests.ledger --seed 7 --requests 20000``; ``--seeds 100``: many in a row."""

import argparse
import sys
from collections import Counter

from tests.ledger.events import KEPT, Book, ViolationError
from tests.ledger.world import SETUPS, play


def main() -> int:
    options = _options()
    each = options.requests // options.seeds
    seen: Counter[str] = Counter()
    broken: Counter[str] = Counter()
    stories: dict[str, str] = {}
    for seed in range(options.seed, options.seed + options.seeds):
        try:
            book = _play(seed, each, options)
        except ViolationError as violation:
            _say(f"{violation}\n\nagain with: python -m tests.ledger --seed {seed} --requests {each}")
            return 1
        seen += book.seen
        broken += book.violations
        for kind, found in book.stories.items():
            stories.setdefault(kind, found[0])
        if options.seeds > 1:
            _say(f"seed {seed}: {seen['requests']} requests, {sum(broken.values())} violations")
    _say("\n".join(f"{count:10d}  {name}" for name, count in sorted(seen.items())))
    _say("\n\n".join(stories.values()))
    _say("\n".join(f"{count:10d}  VIOLATION {kind}" for kind, count in broken.most_common()))
    return 1 if broken else 0


def _play(seed: int, requests: int, options: argparse.Namespace) -> Book:
    return play(
        seed,
        requests,
        fault_share=options.faults,
        stops_at_first=not options.count,
        only=options.line,
        kept=options.events,
    )


def _say(text: str) -> None:
    if text:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.ledger", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    parser.add_argument("--seeds", type=int, default=1, help="how many seeds, one after the other")
    parser.add_argument("--requests", type=int, default=20_000, help="of all seeds and lines together")
    parser.add_argument("--faults", type=float, default=0.05, help="share of exchanges that go wrong")
    names = ", ".join(f'"{setup.name}"' for setup in SETUPS)
    parser.add_argument("--line", default="", help=f"only lines whose name begins so: {names}")
    parser.add_argument("--count", action="store_true", help="count violations, do not end at the first")
    parser.add_argument("--events", type=int, default=KEPT, help="events printed with a violation")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
