"""Each language says every text of the page and of its alarms, with the same values, and nothing else."""

import json
import re
from typing import Any

import pytest

from gateway.catalogue.text import Text, text_data
from gateway.supervisor import page
from gateway.supervisor.active_alarms import troubles
from gateway.supervisor.http.answers import json_bytes
from tests.supervisor.http.http_bench import snapshot
from tests.supervisor.page.stage import FOLDER
from tests.support.status_models import model_of
from tools.languages import english

LANGUAGES = sorted(name.removesuffix(".json") for name in page.FILES if name.endswith(".json"))
VALUE = re.compile(r"\{\w+\}")
CODE = re.compile(r"`[^`]*`")


def texts(language: str) -> dict[str, str]:
    def once(pairs: list[tuple[str, str]]) -> dict[str, str]:
        assert len({text for text, _ in pairs}) == len(pairs), "a text stands there twice"
        return dict(pairs)

    found: dict[str, str] = json.loads((FOLDER / f"{language}.json").read_text(), object_pairs_hook=once)
    return found


def test_every_file_of_a_language_is_served_and_can_be_chosen() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.json")) == LANGUAGES
    offered = re.search(r"LANGUAGES = (\{.*?\});", (FOLDER / "language.js").read_text())
    assert offered is not None
    assert sorted(re.findall(r"(\w+): ", offered[1])) == sorted(["en", *LANGUAGES])


@pytest.mark.parametrize("language", LANGUAGES)
def test_nothing_is_missing_and_nothing_is_superfluous(language: str) -> None:
    there, wanted = texts(language).keys(), set(english())
    assert len(wanted) > 300
    assert sorted(wanted - there) == []
    assert sorted(there - wanted) == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_values_and_keys_are_the_same_ones(language: str) -> None:
    for text, other in texts(language).items():
        assert other.strip(), text
        for part in (VALUE, CODE):
            assert sorted(part.findall(other)) == sorted(part.findall(text)), text


def test_german_is_another_language() -> None:
    same = [text for text, other in texts("de").items() if text == other]
    assert len(same) < 12


def test_a_sentence_is_english_and_knows_what_it_is_made_of() -> None:
    whose = Text("its drive (unit id {unit_id})", unit_id=3)
    text = Text("{whose} is off for {span}", whose=whose, span="2 s")
    assert text == "its drive (unit id 3) is off for 2 s"
    assert text_data(text) == {
        "text": "{whose} is off for {span}",
        "values": {
            "whose": {"text": "its drive (unit id {unit_id})", "values": {"unit_id": "3"}},
            "span": "2 s",
        },
    }
    assert text_data("home the axis") == "home the axis"


def test_a_trouble_says_its_parts_beside_its_words() -> None:
    relay: dict[str, Any] = {**snapshot(), "supervisor": None}
    relay["gateway"] |= {"snapshot_age_s": 3.0}
    [silent] = [found for found in troubles(model_of(relay)) if found.entry.kind == "relay-silent"]
    told = json.loads(json_bytes(silent.status("2026-05-01T12:00:00+00:00", None)))
    assert told["what"] == "the relay has reported nothing for 3 s: the machine may not obey"
    assert told["says"] == {
        "text": "the relay has reported nothing for {span}: the machine may not obey",
        "values": {"span": "3 s"},
    }
