"""The page in its languages, and the files that it consists of."""

import json
import re
from typing import Any

import pytest

from gateway.catalogue.text import Text, text_data
from gateway.supervisor import page
from gateway.supervisor.active_alarms import troubles
from gateway.supervisor.http.answers import json_bytes
from tests.supervisor.http.http_bench import snapshot
from tests.supervisor.page.models import axis, model, trouble
from tests.supervisor.page.stage import FOLDER
from tests.supervisor.page.visit import Visit
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


# A page that is served is served whole.


NEEDED = re.compile(r'from "\./([\w.]+)"|(?:src|href)="page/([\w.-]+)"')


def needed(name: str) -> set[str]:
    found = NEEDED.findall((FOLDER / name).read_text())
    return {script or linked for script, linked in found}


@pytest.mark.parametrize(
    ("begin", "served"), [("index.html", page.FILES), ("login.html", page.LOGIN_FILES)], ids=["page", "login"]
)
def test_all_that_a_page_needs_is_served_to_whoever_gets_it(begin: str, served: tuple[str, ...]) -> None:
    reached, to_do = {begin}, [begin]
    while to_do:
        for name in needed(to_do.pop()) - reached:
            assert name in served, name
            reached.add(name)
            to_do.append(name)
    assert len(reached) > 4


# The page in the language of the browser, or in the one that somebody chose.


GERMAN = {"locale": "de-DE"}


@pytest.mark.parametrize("visit", [GERMAN], indirect=True)
def test_a_german_browser_reads_german_and_hears_it(visit: Visit) -> None:
    told = {
        "text": "its drive (unit id {unit_id}) has not answered for {span}{tried}",
        "values": {"unit_id": "1", "span": "12 s", "tried": ""},
    }
    silent = {
        **trouble(kind="drive-silent", what="its drive (unit id 1) has not answered for 12 s"),
        "remedy": "measure the whole travel",
        "says": told,
    }
    visit.stage.show(model({"x": axis()}, None, silent))
    visit.until_text("#troubles .what", "ihr Antrieb (Adresse 1) antwortet seit 12 s nicht")
    visit.until_text("#troubles .where", "Achse x")
    visit.until_text("#troubles .remedy", "Messen Sie den ganzen Verfahrweg")
    assert visit.page.locator("html").get_attribute("lang") == "de"
    for role, name in (
        ("region", "Zustand des Gateways"),
        ("heading", "Achse x"),
        ("heading", "Leitung xyz"),
        ("img", "Korrektur der Achse x über den Verfahrweg"),
        ("slider", "Achse x zu einem Zeitpunkt"),
        ("button", "Ton: aus"),
        ("radio", "Warnungen"),
    ):
        assert visit.find(role, name).count() == 1, (role, name)
    said = visit.page.get_by_role("alert").text_content() or ""
    assert said.startswith("Achse x: ihr Antrieb (Adresse 1) antwortet seit 12 s nicht.")
    body = visit.page.locator("body").inner_text()
    assert [
        word for word in ("Position not", "Correction", "Target", "Events", "since") if word in body
    ] == []


@pytest.mark.parametrize("visit", [GERMAN], indirect=True)
def test_what_no_file_knows_is_english(visit: Visit) -> None:
    visit.stage.show(model(None, None, trouble(remedy="call the maker")))
    visit.until_text("#troubles .remedy", "Call the maker")
    visit.until("document.querySelector('#troubles .what').textContent.startsWith('cnc10x.tab:12:3')", True)


@pytest.mark.parametrize("visit", [{"locale": "fr-FR"}, {"locale": "en-US"}], indirect=True)
def test_the_language_is_chosen_and_remembered(visit: Visit) -> None:
    visit.find("button", "Sound: off").wait_for()
    visit.page.locator("#language").select_option(label="Deutsch")
    visit.find("button", "Ton: aus").wait_for()
    visit.page.reload()
    visit.find("button", "Ton: aus").wait_for()
    visit.page.locator("#language").select_option(label="English")
    visit.find("button", "Sound: off").wait_for()
