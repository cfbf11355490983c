"""The page in the language of the browser, or in the one that somebody chose."""

import pytest

from tests.supervisor.page.models import axis, model, trouble
from tests.supervisor.page.visit import Visit

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
