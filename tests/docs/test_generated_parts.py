"""What the documents have from the code is what the code says now."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest
from pydantic import BaseModel

from gateway.catalogue.alarms import ALARMS
from gateway.catalogue.events import EVENTS
from gateway.config.findings import models_in
from gateway.config.reference import TABLES, KeyTable, kind_text, rows
from gateway.config.sections import NAMED, SINGLE
from tools.docs import PARTS, documents, part


@pytest.fixture(name="wanted", scope="module")
def _wanted() -> Mapping[Path, str]:
    return documents()


def test_a_document_is_what_the_code_says(wanted: Mapping[Path, str]) -> None:
    """If not: make docs."""
    for path, text in wanted.items():
        assert path.read_text(encoding="utf-8") == text, path.name


def test_every_part_stands_in_a_document(wanted: Mapping[Path, str]) -> None:
    text = "".join(wanted.values())
    for name in (*PARTS, *(f"keys {name}" for name in TABLES)):
        assert text.count(f"<!-- make docs: {name} -->\n{part(name)}<!-- end -->") == 1, name


def test_messages_knows_every_event_and_every_trouble(wanted: Mapping[Path, str]) -> None:
    [text] = [text for path, text in wanted.items() if path.name == "messages.md"]
    for name in (*EVENTS, *ALARMS):
        assert re.search(rf"^\| `{name}` \|", text, re.MULTILINE), name


def test_messages_has_the_words_that_an_axis_on_the_page_shows() -> None:
    """A word that is its name with blanks is found by the name."""
    table = part("troubles")
    assert "| `record-not-used` |  | *Reads uncorrected*: it started without its record" in table
    for kind, entry in ALARMS.items():
        assert entry.title.lower() in ("", kind.replace("-", " ")) or f"*{entry.title}*" in table


def models(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    yield model
    for field in model.model_fields.values():
        for inside in models_in(field.annotation):
            yield from models(inside)


def test_every_key_is_in_a_table_or_in_the_words_of_one() -> None:
    """A small table inside a key is told of in its row, as in `{ distance = LENGTH }`."""
    listed = {(model, key) for table in TABLES.values() for model, key in table.fields()}
    listed |= {(model, key) for table in TABLES.values() for model in table.models for key in table.elsewhere}
    told = " ".join(f"{row.kind} {row.description}" for table in TABLES.values() for row in rows(table))
    for section in (*SINGLE.values(), *NAMED.values()):
        for model in models(section):
            for key in model.model_fields:
                bases = [(base, key) for base in model.__mro__ if issubclass(base, BaseModel)]
                is_listed = any(found in listed for found in bases)
                is_told = re.search(rf"`{key}`|[{{ ]{key}[ ,}}]| {key} = ", told)
                assert is_listed or is_told, f"{model.__name__}.{key}"


@pytest.mark.parametrize("table", TABLES.values(), ids=list(TABLES))
def test_each_key_says_what_may_stand_there(table: KeyTable) -> None:
    for model, key in table.fields():
        assert kind_text(model, key)


def test_bounds_and_defaults_come_from_the_model() -> None:
    """Worked out from the models by hand."""
    text = part("keys axis")
    assert "| `unit_id` | 0 to 255 | required |" in text
    assert "| `max_slope` | number > 0, < 1 | `0.01` |" in text
    assert '| `setpoints` | `"targets"`, `"stream"` | `"targets"` |' in text
    assert "| `stop_bits` | 1 or 2 | `1` |" in part("keys line.drives")
    assert "| `keepalive_s` | 5 to 3600 s | `15` |" in part("keys mqtt")
    assert "| `mask` | 0 to 0xFFFF | `0xFFFF` |" in part("keys axis.registers.mode")


def test_a_counter_whose_remedy_an_event_has_names_the_event() -> None:
    counted = "targets and triggers that waited longer than `deadline_ms` of their axis"
    assert f"| `late_targets` |  | {counted} | as event `late-target` |" in part("counters")
    remedy = "compare with `pitch-gateway budget CONFIG`. Let monitors poll less often"
    assert re.search(rf"^\| `late-target` \|.*\| {remedy} \|$", part("events"), re.MULTILINE)
