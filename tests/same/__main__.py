"""Compares this working tree with a commit of before, byte by byte: ``python -m tests.same``.

Both play the same: the lines of the ledger in virtual time, the sessions of controllers with every drive, the
corpus of the fuzzer, walks through the worlds of ``tests.verify`` with the records of axes, and a script of
commands to running processes. Frames on both wires with their order and times, replies, events with their
fields, counts, documents and exit codes have to be the same. Of events the sentences may differ: they are
shown by their code. ``differences.toml`` names what differs on purpose.

What was played stays in ``build/same``, and a run that was cut short goes on there. The commit stands in
``tests/same/baseline``; it gets an environment of its own.

Exit codes: 0 all is the same; 1 something differs; 2 the baseline cannot be made.
"""

import argparse
import difflib
import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Final

from tests.same.record import file_of

HERE: Final = Path(__file__).resolve().parent
ROOT: Final = HERE.parent.parent
WORK: Final = ROOT / "build" / "same"
SEEDS: Final = 10
REQUESTS: Final = 20_000
JOBS: Final = os.cpu_count() or 1
BATCH: Final = 60
SHOWN: Final = 5
"""Plays of which the first difference is printed."""
AROUND: Final = 4
"""Lines before it."""
DECIDES: Final = (
    "gateway",
    "tests/contract",
    "tests/exchange",
    "tests/fuzz",
    "tests/ledger",
    "tests/same",
    "tests/verify",
)
"""What decides how a working tree plays."""
SENTENCE: Final = re.compile(r"sentence ([\w-]+): (.*)")


@dataclass(frozen=True)
class Side:
    """A revision, how it is played, and where its transcripts are."""

    root: Path
    python: Path
    adapter: Path
    transcripts: Path

    def play(self, plays: Sequence[str]) -> None:
        """Play what has no transcript yet."""
        missing = [play for play in plays if not file_of(self.transcripts, play).exists()]
        batches = [missing[first : first + BATCH] for first in range(0, len(missing), BATCH)]
        ledgers = [[play] for batch in batches for play in batch if play.startswith("ledger:")]
        others = [[play for play in batch if not play.startswith("ledger:")] for batch in batches]
        with ThreadPoolExecutor(JOBS) as pool:
            for number, _ in enumerate(pool.map(self._record, [*ledgers, *filter(None, others)]), start=1):
                _say(f"\r{self.transcripts.name}: {number} of {len(ledgers) + len(others)} batches", end="")
        if missing:
            _say("")

    def names(self) -> list[str]:
        """Return the sessions, the corpus and the worlds."""
        return self._record([]).split()

    def _record(self, plays: Sequence[str]) -> str:
        command: list[str | Path] = [
            self.python,
            "-P",
            HERE / "record.py",
            self.adapter,
            self.transcripts,
            *plays,
        ]
        environment = {**os.environ, "PYTHONPATH": str(self.root), "PYTHONHASHSEED": "0"}
        done = subprocess.run(
            command, cwd=self.root, env=environment, stdout=subprocess.PIPE, text=True, check=True
        )
        return done.stdout


@dataclass
class Outcome:
    """What all plays together have shown."""

    plays: Counter[str] = field(default_factory=Counter)
    lines: Counter[str] = field(default_factory=Counter)
    different: list[tuple[str, list[str]]] = field(default_factory=list)
    sentences: dict[str, set[tuple[str, str]]] = field(default_factory=dict)


def main() -> int:
    """Make the baseline, play both, compare."""
    parser = argparse.ArgumentParser(prog="python -m tests.same", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of the ledger (%(default)s)")
    parser.add_argument("--requests", type=int, default=REQUESTS, help="of each seed (%(default)s)")
    parser.add_argument(
        "--only", default="", help="plays whose name begins so: ledger, session, fuzz, world, plan, commands"
    )
    asked = parser.parse_args()
    baseline = _baseline()
    if baseline is None:
        return 2
    here = Side(ROOT, Path(sys.executable), HERE / "adapter.py", WORK / f"here-{_digest_here()}")
    plays = [f"ledger:{seed}x{asked.requests}" for seed in range(1, asked.seeds + 1)]
    plays += [*baseline.names(), "commands:script"]
    plays = [play for play in plays if play.startswith(asked.only)]
    for side in (baseline, here):
        side.play(plays)
    return _tell(compared(plays, baseline.transcripts, here.transcripts, _on_purpose()))


def _baseline() -> Side | None:
    commit = (HERE / "baseline").read_text().split()[0]
    root = WORK / commit
    made = root / ".made"
    if not made.exists():
        shutil.rmtree(root, ignore_errors=True)
        root.mkdir(parents=True)
        git = shutil.which("git") or "git"
        archived = subprocess.run([git, "archive", commit], cwd=ROOT, capture_output=True, check=False)
        if archived.returncode:
            sys.stderr.write(f"{HERE / 'baseline'}: {commit}: {archived.stderr.decode().strip()}\n")
            return None
        with tarfile.open(fileobj=io.BytesIO(archived.stdout)) as archive:
            archive.extractall(root, filter="data")
        environment = {**os.environ, "VENV": str(root / ".venv")}
        subprocess.run([root / "tools/bootstrap.sh"], cwd=root, env=environment, check=True)
        made.touch()
    python = root / ".venv" / "bin" / "python"
    return Side(root, python, HERE / "baseline_adapter.py", WORK / f"baseline-{commit[:12]}")


def _digest_here() -> str:
    digest = hashlib.blake2b(digest_size=6)
    for folder in DECIDES:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _on_purpose() -> list[re.Pattern[str]]:
    """Return the lines that are left out on both sides, each with its reason in ``differences.toml``."""
    found = tomllib.loads((HERE / "differences.toml").read_text(encoding="utf-8"))
    return [re.compile(entry["line"]) for entry in found.get("difference", [])]


def compared(plays: Iterable[str], before: Path, after: Path, on_purpose: list[re.Pattern[str]]) -> Outcome:
    """Compare the transcripts of two sides."""
    outcome = Outcome()
    for play in plays:
        kind = play.partition(":")[0]
        one, other = (list(_lines(file_of(folder, play), on_purpose)) for folder in (before, after))
        outcome.plays[kind] += 1
        outcome.lines[kind] += len(one)
        found = _first_difference(one, other, outcome.sentences)
        if found:
            outcome.different.append((play, found))
    return outcome


def _lines(path: Path, on_purpose: list[re.Pattern[str]]) -> Iterator[str]:
    for line in path.read_text(encoding="utf-8").splitlines():
        if not any(each.search(line) for each in on_purpose):
            yield line


def _first_difference(
    one: list[str], other: list[str], sentences: dict[str, set[tuple[str, str]]]
) -> list[str]:
    for number, (before, after) in enumerate(zip_longest(one, other)):
        if before == after:
            continue
        said = SENTENCE.fullmatch(before or ""), SENTENCE.fullmatch(after or "")
        if said[0] is not None and said[1] is not None and said[0][1] == said[1][1]:
            sentences.setdefault(said[0][1], set()).add((said[0][2], said[1][2]))
            continue
        first = max(number - AROUND, 0)
        return list(difflib.ndiff(one[first : number + AROUND], other[first : number + AROUND]))
    return []


def _tell(outcome: Outcome) -> int:
    for code, pairs in sorted(outcome.sentences.items()):
        before, after = min(pairs)
        _say(f"sentence of {code}, {len(pairs)} times otherwise:\n  - {before}\n  + {after}")
    for play, lines in outcome.different[:SHOWN]:
        _say(f"{play} differs:\n  " + "\n  ".join(lines))
    for kind, count in outcome.plays.items():
        _say(f"{kind}: {count} plays, {outcome.lines[kind]} lines")
    total = sum(outcome.plays.values())
    _say(
        f"{len(outcome.different)} of {total} plays differ"
        if outcome.different
        else f"{total} plays are the same"
    )
    return 1 if outcome.different else 0


def _say(text: str, end: str = "\n") -> None:
    sys.stdout.write(text + end)
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
