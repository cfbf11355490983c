"""``python -m tests.attacks``: every attack for some seconds, what it got, and what it cost the controller.

Prints the table of ``docs/security.md``. Takes about ten seconds an attack.
"""

import argparse
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from tests.attacks.legitimate import Attack, tried

SECONDS = 4.0


def attacks() -> list[Attack]:
    """Return the ``ATTACKS`` of every module beside this one."""
    names = sorted(path.stem for path in Path(__file__).parent.glob("test_attacks_*.py"))
    return [attack for name in names for attack in import_module(f"tests.attacks.{name}").ATTACKS]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument("names", nargs="*", help="parts of names of attacks; none: all")
    options = parser.parse_args()
    print("| attack | what it gets | in the log | p99 without | p99 meanwhile |")
    print("|---|---|---|---|---|")
    for attack in attacks():
        if options.names and not any(part in attack.name for part in options.names):
            continue
        sys.stderr.write(f"{attack.name} ...\n")
        with tempfile.TemporaryDirectory() as folder:
            outcome = tried(attack, Path(folder), options.seconds)
        outcome.check()
        calm, meanwhile = outcome.calm.p99_us / 1000, outcome.meanwhile.p99_us / 1000
        print(
            f"| {attack.name} | {outcome.got} | `{attack.event}` | {calm:.2f} ms | {meanwhile:.2f} ms |",
            flush=True,
        )


if __name__ == "__main__":
    main()
