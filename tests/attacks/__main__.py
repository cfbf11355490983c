"""``python -m tests.attacks``: every attack for some seconds, what it got, and what it cost the controller.

Prints a table; ``--write`` puts it into ``bench/attacks.md`` (``make attacks``). Takes about ten seconds an
attack, and wants a machine that does nothing else.
"""

import argparse
import re
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from tests.attacks.legitimate import Attack, ground_of, tried

SECONDS = 4.0
DOCUMENT = Path(__file__).parents[2] / "bench" / "attacks.md"
PART = re.compile(r"(<!-- make attacks -->\n)(.*?)(<!-- end -->)", re.DOTALL)
HEAD = "| attack | what it gets | in the log | p99 without, ms | meanwhile, ms |\n|---|---|---|---|---|\n"


def attacks() -> list[Attack]:
    """Return the ``ATTACKS`` of every module beside this one."""
    names = sorted(path.stem for path in Path(__file__).parent.glob("test_attacks_*.py"))
    return [attack for name in names for attack in import_module(f"tests.attacks.{name}").ATTACKS]


def row_of(attack: Attack, seconds: float) -> str:
    """Try an attack; return its row."""
    with tempfile.TemporaryDirectory() as folder, ground_of(attack, Path(folder)) as ground:
        outcome = tried(attack, ground, seconds)
    outcome.check()
    calm, meanwhile = outcome.calm.p99_us / 1000, outcome.meanwhile.p99_us / 1000
    return f"| {attack.name} | {outcome.got} | `{attack.event}` | {calm:.2f} | {meanwhile:.2f} |\n"


def written() -> dict[str, str]:
    """Return the rows that the document has, by the name of their attack."""
    found = PART.search(DOCUMENT.read_text())
    lines = found[2].splitlines(keepends=True)[2:] if found else []
    return {line.split(" | ")[0].removeprefix("| "): line for line in lines}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=SECONDS)
    parser.add_argument(
        "--write",
        action="store_true",
        help="put the table into bench/attacks.md; with names, those rows of it",
    )
    parser.add_argument("names", nargs="*", help="parts of names of attacks; none: all")
    options = parser.parse_args()
    rows = written() if options.names and options.write else {}
    for attack in attacks():
        if options.names and not any(part in attack.name for part in options.names):
            continue
        sys.stderr.write(f"{attack.name} ...\n")
        rows[attack.name] = row_of(attack, options.seconds)
        sys.stderr.write(rows[attack.name])
    table = HEAD + "".join(rows[attack.name] for attack in attacks() if attack.name in rows)
    if options.write:
        DOCUMENT.write_text(PART.sub(lambda found: found[1] + table + found[3], DOCUMENT.read_text()))
    else:
        sys.stdout.write(table)


if __name__ == "__main__":
    main()
