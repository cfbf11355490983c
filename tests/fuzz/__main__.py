"""``python -m tests.fuzz [TARGET …] --seconds 60``: fuzzes targets one after the other (make fuzz).

What a target has found so far stays in ``build/fuzz/TARGET/corpus``, and the next run goes on from there. An
input that breaks a rule goes to ``tests/fuzz/crashes/TARGET``, where the tests run it from then on. With
``--keep`` nothing is fuzzed: what was found and reaches code that the seeds do not goes to
``tests/fuzz/corpus/TARGET.txt``, as few and as small inputs as do.
"""

import argparse
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from tests.fuzz import targets
from tests.fuzz.targets import CORPUS, CRASHES, TARGETS, name_of

ROOT: Final = Path(__file__).parents[2]
BUILD: Final = ROOT / "build" / "fuzz"
PROGRESS: Final = re.compile(
    r"#(?P<runs>\d+)\s.* cov: (?P<cov>\d+) ft: \d+ corp: \d+/\S+ .*?exec/s: (?P<rate>\d+)"
)
STATISTIC: Final = re.compile(r"stat::(?P<name>\w+):\s+(?P<value>\d+)")
RAISED: Final = "=== Uncaught Python exception: ==="
MERGED: Final = "MERGE-OUTER: successful"
BROKEN: Final = ("crash-", "timeout-", "oom-")
"""How libFuzzer calls the inputs that it gives up at."""
SAY_EVERY_S: Final = 10.0
TIMEOUT_S: Final = 20
"""An input that takes as long is a crash: the others take milliseconds."""
LARGEST_MB: Final = 2048


@dataclass(slots=True)
class Outcome:
    """What came of one target."""

    name: str
    executions: int = 0
    per_s: int = 0
    coverage: int = 0
    """Branches of the gateway's own code that were reached, as libFuzzer counts them."""
    broken: list[Path] = field(default_factory=list)
    why: str = ""
    """What was raised."""
    _is_raised: bool = False
    trouble: str = ""
    """Why it ended without an input that could be kept."""

    def hear(self, line: str) -> None:
        """Take note of a line of libFuzzer."""
        if self._is_raised:
            self.why, self._is_raised = line.strip(), False
        elif RAISED in line:
            self._is_raised = True
        elif found := PROGRESS.match(line):
            self.executions, self.coverage, self.per_s = (int(found[key]) for key in ("runs", "cov", "rate"))
        elif found := STATISTIC.match(line):
            value = int(found["value"])
            if found["name"] == "number_of_executed_units":
                self.executions = value
            elif found["name"] == "average_exec_per_sec":
                self.per_s = value


def chosen(asked: Sequence[str]) -> list[str]:
    """Return the targets of some names, or of the beginnings of names; of none all. Raises SystemExit."""
    for wanted in asked:
        if not any(is_meant(name, wanted) for name in TARGETS):
            raise SystemExit(f"there is no target {wanted}; there are {', '.join(TARGETS)}")
    return [name for name in TARGETS if not asked or any(is_meant(name, wanted) for wanted in asked)]


def is_meant(name: str, wanted: str) -> bool:
    """Whether a name asks for a target: for itself, or for all that begin with it.

    >>> is_meant("tables-csv", "tables"), is_meant("mbap", "mb")
    (True, False)
    """
    return name == wanted or name.startswith(f"{wanted}-")


def write_inputs(folder: Path, inputs: Iterable[bytes]) -> Path:
    """Put inputs into a folder that holds nothing else."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for data in inputs:
        (folder / name_of(data)).write_bytes(data)
    return folder


def command(name: str, *options: str) -> list[str]:
    """Return how libFuzzer is started with a target."""
    common = (f"-timeout={TIMEOUT_S}", f"-rss_limit_mb={LARGEST_MB}", f"-max_len={TARGETS[name].longest}")
    return [sys.executable, "-m", "tests.fuzz.one", name, *common, *options]


def fuzz(name: str, seconds: int) -> Outcome:
    """Run one target for some seconds, or until an input breaks a rule; says how far it is."""
    place = BUILD / name
    seeds = write_inputs(place / "seeds", TARGETS[name].seeds())
    corpus, artifacts = place / "corpus", place / "artifacts"
    corpus.mkdir(exist_ok=True)
    artifacts.mkdir(exist_ok=True)
    words = place / "words"
    words.write_text("".join(f'"{escaped(word)}"\n' for word in TARGETS[name].words()))
    kept = [str(write_inputs(place / "kept", targets.corpus(name).values()))]
    kept += [str(CRASHES / name)] if (CRASHES / name).is_dir() else []
    options = [f"-max_total_time={seconds}", "-print_final_stats=1", f"-artifact_prefix={artifacts}/"]
    options += [f"-dict={words}"] if words.stat().st_size else []
    outcome = Outcome(name)
    log = place / "log"
    with (
        log.open("w") as written,
        subprocess.Popen(
            command(name, *options, str(corpus), str(seeds), *kept),
            cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        ) as process,
    ):  # fmt: skip
        assert process.stdout is not None
        due_s = time.monotonic() + SAY_EVERY_S
        for line in process.stdout:
            written.write(line)
            outcome.hear(line)
            if time.monotonic() >= due_s:
                due_s = time.monotonic() + SAY_EVERY_S
                print(f"{name}: {outcome.executions} executions, coverage {outcome.coverage}", flush=True)
    outcome.broken = list(taken_over(artifacts, CRASHES / name))
    if process.returncode and not outcome.broken:
        outcome.trouble = f"ended with {process.returncode}: {log.relative_to(ROOT)} says why"
    return outcome


def taken_over(artifacts: Path, crashes: Path) -> Iterator[Path]:
    """Move the inputs that broke a rule to where the tests run them; yields their new places."""
    for path in sorted(artifacts.iterdir()):
        if path.name.startswith(BROKEN):
            crashes.mkdir(parents=True, exist_ok=True)
            yield Path(shutil.move(path, crashes / path.name))
        else:
            path.unlink()


def keep(name: str) -> int:
    """Take over what reaches code that neither seeds nor other inputs do; returns how many that are."""
    place = BUILD / name
    seeds = write_inputs(place / "seeds", TARGETS[name].seeds())
    merged = write_inputs(place / "merged", ())
    shutil.copytree(seeds, merged, dirs_exist_ok=True)
    kept = write_inputs(place / "kept", targets.corpus(name).values())
    # Without counters: an input that only goes round a loop more often reaches nothing new.
    options = ["-merge=1", "-use_counters=0", str(merged), str(kept), str(place / "corpus")]
    log = place / "merge.log"
    with log.open("w") as written:
        subprocess.run(command(name, *options), cwd=ROOT, stdout=written, stderr=written, check=False)
    if MERGED not in log.read_text(errors="replace"):
        raise SystemExit(f"{name}: nothing was taken over: {log.relative_to(ROOT)} says why")
    new = [path for path in merged.iterdir() if not (seeds / path.name).exists()]
    targets.keep(name, [path.read_bytes() for path in new])
    return len(new)


def escaped(word: bytes) -> str:
    """Write a word as libFuzzer's dictionaries want it.

    >>> escaped(b'a"b')
    'a\\\\x22b'
    """
    return "".join(
        chr(c) if c < 0x80 and (chr(c).isalnum() or chr(c) in "_-/ ") else f"\\x{c:02x}" for c in word
    )


def table(outcomes: Sequence[Outcome]) -> str:
    """Return the figures of all targets."""
    rows = [("target", "executions", "exec/s", "coverage", "broken")]
    rows += [
        (each.name, str(each.executions), str(each.per_s), str(each.coverage), str(len(each.broken)))
        for each in outcomes
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            [
                row[0].ljust(widths[0]),
                *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)),
            ]
        )
        for row in rows
    )


def main() -> int:
    """Do what the command line says; returns 1 where a rule was broken."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.fuzz", description="fuzz targets one after the other"
    )
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"of {', '.join(TARGETS)}; default: all")
    parser.add_argument("--seconds", type=int, default=60, help="for each target")
    parser.add_argument(
        "--keep", action="store_true", help="do not fuzz; take what was found into tests/fuzz/corpus"
    )
    options = parser.parse_args()
    names = chosen(options.targets)
    if options.keep:
        for name in names:
            if not (BUILD / name / "corpus").is_dir():
                continue
            print(f"{name}: {keep(name)} inputs in {(CORPUS / f'{name}.txt').relative_to(ROOT)}", flush=True)
        return 0
    outcomes: list[Outcome] = []
    try:
        for number, name in enumerate(names, start=1):
            print(f"{name} ({number} of {len(names)}), {options.seconds} s", flush=True)
            outcomes.append(fuzz(name, options.seconds))
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
    print(table(outcomes))
    for each in outcomes:
        for path in each.broken:
            print(f"{each.name}: {each.why or 'it took too long'}: {path.relative_to(ROOT)}", file=sys.stderr)
        if each.trouble:
            print(f"{each.name}: {each.trouble}", file=sys.stderr)
    return int(len(outcomes) < len(names) or any(each.broken or each.trouble for each in outcomes))


if __name__ == "__main__":
    sys.exit(main())
