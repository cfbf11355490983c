"""No input that was ever worth keeping breaks a rule; no fuzzer is needed to see that."""

import pytest

from tests.fuzz.targets import CORPUS, CRASHES, TARGETS, corpus, crashes

LARGEST_CORPUS = 1_000_000


def found_of(name: str) -> list[tuple[str, bytes]]:
    """Each input that was kept of a target, with its name."""
    return [*crashes(name).items(), *corpus(name).items()]


@pytest.mark.parametrize("name", TARGETS)
def test_the_seeds_of_a_target_break_no_rule(name: str) -> None:
    seeds = set(TARGETS[name].seeds())
    assert len(seeds) >= 3
    for seed in seeds:
        assert len(seed) <= TARGETS[name].longest
        TARGETS[name].run(seed)


@pytest.mark.parametrize("name", TARGETS)
def test_what_the_fuzzer_found_breaks_no_rule(name: str) -> None:
    for label, data in found_of(name):
        try:
            TARGETS[name].run(data)
        except BaseException as error:
            error.add_note(f"the input is {label} of {name}")
            raise


@pytest.mark.parametrize("name", TARGETS)
def test_nothing_and_noise_break_no_rule(name: str) -> None:
    for data in (b"", b"\x00", bytes(range(256)), bytes(300), b"\xff" * 300):
        TARGETS[name].run(data)


def test_the_corpus_is_small_of_targets_that_there_are_and_holds_no_seed() -> None:
    assert {path.stem for path in CORPUS.iterdir()} <= TARGETS.keys()
    assert {path.name for path in CRASHES.iterdir()} <= TARGETS.keys()
    assert sum(len(data) for name in TARGETS for _, data in found_of(name)) < LARGEST_CORPUS
    for name, target in TARGETS.items():
        assert not set(corpus(name).values()) & set(target.seeds()), name


def test_every_target_begins_with_its_rule_in_a_sentence() -> None:
    for name, target in TARGETS.items():
        function = getattr(target.run, "func", target.run)
        rule = (function.__doc__ or "").split("\n")[0]
        assert rule.endswith("."), name
        assert len(rule) > 60, name
