"""No input that was ever worth keeping breaks a rule; no fuzzer is needed to see that."""

from pathlib import Path

import pytest

from tests.fuzz.targets import CORPUS, CRASHES, TARGETS, inputs

LARGEST_CORPUS = 1_000_000


@pytest.mark.parametrize("name", TARGETS)
def test_the_seeds_of_a_target_break_no_rule(name: str) -> None:
    seeds = set(TARGETS[name].seeds())
    assert len(seeds) >= 3
    for seed in seeds:
        assert len(seed) <= TARGETS[name].longest
        TARGETS[name].run(seed)


@pytest.mark.parametrize(
    ("name", "path"),
    [(name, path) for folder in (CRASHES, CORPUS) for name in TARGETS for path in inputs(folder, name)],
    ids=lambda value: value.name[:12] if isinstance(value, Path) else value,
)
def test_what_the_fuzzer_found_breaks_no_rule(name: str, path: Path) -> None:
    TARGETS[name].run(path.read_bytes())


@pytest.mark.parametrize("name", TARGETS)
def test_nothing_and_noise_break_no_rule(name: str) -> None:
    for data in (b"", b"\x00", bytes(range(256)), bytes(300), b"\xff" * 300):
        TARGETS[name].run(data)


def test_the_corpus_is_small_of_targets_that_there_are_and_holds_no_seed() -> None:
    kept = [path for folder in (CORPUS, CRASHES) for path in folder.rglob("*") if path.is_file()]
    assert {path.parent.name for path in kept} <= TARGETS.keys()
    assert sum(path.stat().st_size for path in kept) < LARGEST_CORPUS
    for name, target in TARGETS.items():
        assert not {path.read_bytes() for path in inputs(CORPUS, name)} & set(target.seeds()), name


def test_every_target_begins_with_its_rule_in_a_sentence() -> None:
    for name, target in TARGETS.items():
        function = getattr(target.run, "func", target.run)
        rule = (function.__doc__ or "").split("\n")[0]
        assert rule.endswith("."), name
        assert len(rule) > 60, name
