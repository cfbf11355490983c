"""``python -m tests.verify [WORLD ...]``: walks the small worlds, two at a time (make verify).

A world that closes (``designs.CLOSES``) is walked breadth first until nothing is new, any other for
``--seconds``. Steps at random (``--random``) are shared out among those that did not close, by how fast each
is. Ends with 1 where a rule was broken, and prints the shortest trace as a test. A run of all worlds does so
too where one did not close that should have, or where it did not meet what it should have (``sometimes``).

The gateway is walked as it is imported. Compiled, it goes the same ways as its sources: of a walk that is not
cut off by time all that is printed is the same, but for the times (``tests/compiled``). Only the rows of its
tables are not seen there.
"""

import argparse
import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from hashlib import blake2b
from itertools import accumulate, pairwise

from gateway.compiled import is_compiled
from tests.verify.designs import BY_NAME, CLOSES, CLOSES_LATER
from tests.verify.explore import Outcome, as_test
from tests.verify.running import walked, wandered
from tests.verify.sometimes import missing

EXAMPLES = """examples:
  python -m tests.verify                               every world, as make verify does
  python -m tests.verify direct --seconds 60           one world, for a minute
  python -m tests.verify staged --depth 9 --random 0   all traces of up to nine events, nothing else
  python -m tests.verify --later                       those that take minutes to close
  python -m tests.verify --list                        what there is
"""
SECONDS = 2.5
"""Of the processor, for each world that does not close: a run takes 30 minutes on two cores at most."""
LONGEST_S = 300.0
"""So long a world may take to close, which takes a minute at most where this was written."""
LATER_S = 3600.0
"""The same of those that are walked with ``--later``."""
RANDOM_STEPS = 10_000_000
JOBS = 2


def shown(outcome: Outcome) -> str:
    """Return an outcome as one row of a table in Markdown."""
    how = "closed" if outcome.is_closed else f"{outcome.random_steps:,} random steps"
    return (
        f"| `{outcome.world}` | {outcome.states:,} | {outcome.transitions:,} | {outcome.depth} "
        f"| {outcome.seconds:.0f} s | {how} |"
    )


HEAD = "| world | states | transitions | depth | time | closed, or else |\n|---|---|---|---|---|---|"


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
        "--seconds",
        type=float,
        default=None,
        metavar="S",
        help=f"of each world (of one that does not close {SECONDS:g}, of the others until they do)",
    )
    parser.add_argument(
        "--random", type=int, default=RANDOM_STEPS, metavar="N",
        help="random steps, over all worlds that did not close (%(default)s)",
    )  # fmt: skip
    parser.add_argument("--jobs", type=int, default=JOBS, metavar="N", help="worlds at a time (%(default)s)")
    parser.add_argument(
        "--broken", type=int, default=1, metavar="N", help="go on until N rules are broken (%(default)s)"
    )
    parser.add_argument("--later", action="store_true", help="the worlds that take minutes to close")
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
        for design in BY_NAME.values():
            print(f"{design.name:24} {design.about}")
        return 0
    names = asked.worlds or [name for name in BY_NAME if (name in CLOSES_LATER) is asked.later]
    outcomes: dict[str, Outcome] = {}
    context = multiprocessing.get_context("forkserver")  # imports once, and not once for each world
    context.set_forkserver_preload(["tests.verify.running"])
    with ProcessPoolExecutor(asked.jobs, mp_context=context, max_tasks_per_child=1) as pool:
        waiting = []
        for name in names:
            seconds = asked.seconds or (
                LONGEST_S if name in CLOSES else LATER_S if name in CLOSES_LATER else SECONDS
            )
            waiting.append(pool.submit(walked, name, asked.depth, seconds, 0, asked.broken))
        print(HEAD)
        for each in as_completed(waiting):
            outcome = outcomes[each.result().world] = each.result()
            if outcome.is_closed or outcome.broken or not asked.random:
                _tell(outcome)
        rest = [outcomes[name] for name in names]
        rest = [each for each in rest if not (each.is_closed or each.broken)]
        shares = shared_out(asked.random, [each.rate for each in rest])
        waiting = [
            pool.submit(wandered, each.world, steps, asked.broken)
            for each, steps in zip(rest, shares, strict=True)
            if steps
        ]
        for each in as_completed(waiting):
            outcome = outcomes[each.result().world]
            outcome.add(each.result())
            _tell(outcome)
    return _sum_up(
        list(outcomes.values()),
        is_whole=not (asked.worlds or asked.depth or asked.later),
        should_close=frozenset() if asked.depth or asked.seconds else CLOSES | CLOSES_LATER,
    )


def shared_out(steps: int, rates: Sequence[float]) -> list[int]:
    """Share random steps out among worlds that take so many a second: each walks for about as long."""
    until = list(accumulate(rates))
    ends = [round(steps * each / until[-1]) for each in until]
    return [end - before for before, end in pairwise((0, *ends))]


def _tell(outcome: Outcome) -> None:
    print(shown(outcome), flush=True)
    for broken in outcome.broken:
        print(f"  broken: {broken.what}")
        print(as_test(BY_NAME[outcome.world], broken), flush=True)


def _sum_up(outcomes: Sequence[Outcome], *, is_whole: bool, should_close: frozenset[str]) -> int:
    """Print what all walks together have shown; return the exit code."""
    met = sorted({name for outcome in outcomes for name in outcome.met})
    print(f"longest wait of a stop: {max(outcome.stop_ticks for outcome in outcomes)} ticks of 80 ms")
    print(f"met ({len(met)}): {', '.join(met)}")
    total, steps = sum(o.transitions for o in outcomes), sum(o.random_steps for o in outcomes)
    states, seconds = sum(o.states for o in outcomes), sum(o.seconds for o in outcomes)
    closed = sum(o.is_closed for o in outcomes)
    print(
        f"{closed} of {len(outcomes)} worlds closed; {states:,} states, {total:,} transitions, "
        f"{steps:,} random steps, {seconds:,.0f} s of one core"
    )
    passed = "".join(each.digest for each in sorted(outcomes, key=lambda each: each.world))
    print(
        f"of all that left, was answered and was told: {blake2b(passed.encode(), digest_size=8).hexdigest()}"
    )
    print(f"the gateway is {'compiled' if is_compiled() else 'not compiled'}")
    unmet = missing(met) if is_whole else []
    still_open = sorted(o.world for o in outcomes if o.world in should_close and not o.is_closed)
    if still_open:
        print(f"did not close, and should have ({len(still_open)}): {', '.join(still_open)}")
    if is_compiled():
        unmet = [each for each in unmet if not each.startswith("row ")]
    if unmet:
        print(f"not met, and not in the list of what no world meets ({len(unmet)}): {', '.join(unmet)}")
    return 1 if unmet or still_open or any(outcome.broken for outcome in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())
