"""Play a machine in simulated time: ``python -m tests.year 7 --until 3600``; without a seed many of them."""

import argparse
import json
import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

from tests.year import standins
from tests.year.many import play_many


def main() -> int:
    """Play one seed, or many; print what was seen, and return 1 if something is wrong."""
    options = _options()
    if options.seed is None:
        return play_many(options.hours, options.first, options.faults, options.jobs)
    if os.environ.get("PYTHONHASHSEED") != "0":  # sets have the same order in each run
        command = [sys.executable, "-m", "tests.year", *sys.argv[1:]]
        os.execve(sys.executable, command, {**os.environ, "PYTHONHASHSEED": "0"})
    standins.install()
    warnings.simplefilter("ignore", ResourceWarning)  # a killed process closes nothing
    return _play(options)


def _play(options: argparse.Namespace) -> int:
    from gateway.compiled import is_compiled
    from tests.year.machine import S
    from tests.year.system import MACHINE
    from tests.year.world import World

    began_s = time.process_time()
    with tempfile.TemporaryDirectory(prefix="year-") as folder:
        world = World(options.seed, Path(folder), options.faults, options.without)
        if options.trace:
            world.book.trace = _say
        world.run(int(options.until * S))
    took_s = time.process_time() - began_s
    book, simulated_s = world.book, MACHINE.now_ns / S
    faults = {f"fault {kind}": count for kind, count in world.faults.seen.items()}
    result = {
        "seed": options.seed,
        "simulated_s": simulated_s,
        "took_s": took_s,
        "digest": book.digest(),
        "finding": book.finding,
        "is_compiled": is_compiled(),
        "seen": dict(sorted({**book.seen, **faults}.items())),
    }
    if options.json:
        _say(json.dumps(result))
        return 1 if book.finding else 0
    for name, count in sorted({**book.seen, **faults}.items()):
        _say(f"{count:10d}  {name}")
    _say(
        f"seed {options.seed}: {simulated_s:.0f} s simulated in {took_s:.1f} s of a core, "
        f"{simulated_s / took_s:.0f} a second; {book.seen['exchanges'] / simulated_s:.1f} exchanges in each; "
        f"digest {book.digest()}"
    )
    if book.finding:
        _say(f"\n{book.story()}\n\nFOUND {book.finding}")
    return 1 if book.finding else 0


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.year", description=__doc__)
    parser.add_argument("seed", type=int, nargs="?", help="the seed to play; without it: many")
    parser.add_argument("--until", type=float, default=3600.0, help="simulated seconds of the seed")
    parser.add_argument("--faults", default="calm", help="how often: none, calm, rough or absurd")
    parser.add_argument("--without", nargs="*", default=(), help="kinds of faults to leave out")
    parser.add_argument("--trace", action="store_true", help="print everything that happens")
    parser.add_argument("--json", action="store_true", help="print the result as one line of JSON")
    parser.add_argument("--hours", type=float, default=8.0, help="simulated hours of all seeds together")
    parser.add_argument("--first", type=int, default=1, help="the first of many seeds")
    parser.add_argument("--jobs", type=int, default=2, help="how many seeds at once")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
