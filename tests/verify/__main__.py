"""``python -m tests.verify [WORLD ...]``: walks the small worlds, two at a time (make verify).

A world is walked breadth first until nothing is new, to ``--depth``, or for ``--seconds``; where it did not
close, random steps follow. Ends with 1 where a rule was broken, and prints the shortest trace as a test.
"""

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed

from tests.verify.designs import BY_NAME, DESIGNS
from tests.verify.explore import Outcome, as_test
from tests.verify.running import walked

EXAMPLES = """examples:
  python -m tests.verify                               every world, as make verify does
  python -m tests.verify direct --seconds 60           one world, for a minute
  python -m tests.verify staged --depth 9 --random 0   all traces of up to nine events, nothing else
  python -m tests.verify --list                        what there is
"""
SECONDS = 150.0
RANDOM_STEPS = 100_000
JOBS = 2


def shown(outcome: Outcome) -> str:
    """Return an outcome as one line."""
    how = "closed" if outcome.is_closed else f"open, {outcome.random_steps} random steps"
    return (
        f"{outcome.world:16} {outcome.states:9,} states  {outcome.transitions:10,} transitions  "
        f"depth {outcome.depth:3}  {outcome.seconds:5.0f} s  {outcome.rate:6,.0f}/s  {how}"
    )


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the arguments of a command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.verify",
        description="Walks every state that small worlds around the gateway can reach.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("worlds", nargs="*", metavar="WORLD", help="which worlds; without one, every world")
    parser.add_argument("--depth", type=int, default=0, metavar="N", help="stop after N events in a row")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, metavar="S", help="of each world (%(default)s)"
    )
    parser.add_argument(
        "--random", type=int, default=RANDOM_STEPS, metavar="N",
        help="random steps in worlds that did not close (%(default)s)",
    )  # fmt: skip
    parser.add_argument("--jobs", type=int, default=JOBS, metavar="N", help="worlds at a time (%(default)s)")
    parser.add_argument(
        "--broken", type=int, default=1, metavar="N", help="go on until N rules are broken (%(default)s)"
    )
    parser.add_argument("--list", action="store_true", help="say what worlds there are")
    found = parser.parse_args(arguments)
    unknown = sorted(set(found.worlds) - set(BY_NAME))
    if unknown:
        parser.error(f"there is no world {', '.join(unknown)}; there are {', '.join(BY_NAME)}")
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Walk the worlds; return the exit code."""
    asked = parsed(arguments)
    if asked.list:
        for design in DESIGNS:
            print(f"{design.name:16} {design.about}")
        return 0
    names = asked.worlds or [design.name for design in DESIGNS]
    outcomes = []
    with ProcessPoolExecutor(max_workers=asked.jobs, max_tasks_per_child=1) as pool:
        waiting = [
            pool.submit(walked, name, asked.depth, asked.seconds, asked.random, asked.broken)
            for name in names
        ]
        for each in as_completed(waiting):
            outcome = each.result()
            outcomes.append(outcome)
            print(shown(outcome), flush=True)
            for broken in outcome.broken:
                print(f"  broken: {broken.what}")
                print(as_test(BY_NAME[outcome.world], broken), flush=True)
    met = sorted({name for outcome in outcomes for name in outcome.met})
    print(f"longest wait of a stop: {max(outcome.stop_ticks for outcome in outcomes)} ticks of 80 ms")
    print(f"met ({len(met)}): {', '.join(met)}")
    total = sum(outcome.transitions + outcome.random_steps for outcome in outcomes)
    states, seconds = sum(o.states for o in outcomes), sum(o.seconds for o in outcomes)
    print(f"{states:,} states, {total:,} transitions, {seconds:,.0f} s")
    return 1 if any(outcome.broken for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
