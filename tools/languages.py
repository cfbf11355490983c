"""The English texts of the page and of its alarms, as they stand in the program, for other languages.

``python -m tools.languages`` writes them to standard output, each beside itself: the beginning of a new
language. ``python -m tools.languages de`` writes those that the file of a language lacks.
"""

import ast
import inspect
import json
import re
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Final

from gateway.catalogue import alarms
from gateway.catalogue.alarms import ALARMS, OF_COMPENSATION
from gateway.supervisor import active_alarms, page, verdict

FOLDER: Final = Path(page.__file__).parent
_CALL: Final = re.compile(r'\bt\(\s*"((?:[^"\\]|\\.)*)"')
_DESCRIPTION: Final = re.compile(r"\bkinds\.([A-Z_]+)\.description")
NAMES: Final = ("motion", "operator", "monitor", "healthy", "waiting", "warning", "error", "connecting")
"""Roles of controllers, and words of the verdict in the title: the page says what the status says."""
PLACES: Final = ("axes", "axis", "controller", "line", "unit id")
"""What the places of troubles begin with."""
WHERE: Final = ("gateway", "supervisor", "configuration", "tables folder", "state folder", "http", "mqtt")
"""Places that have no name."""
UNSEEN: Final = frozenset(("script", "style", "symbol", "title", "noscript"))


class _Texts(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self._within: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in UNSEEN:
            self._within.append(tag)
        self.found += [value for name, value in attrs if name == "aria-label" and value]

    def handle_endtag(self, tag: str) -> None:
        if self._within and self._within[-1] == tag:
            self._within.pop()

    def handle_data(self, data: str) -> None:
        if not self._within and data.strip():
            self.found.append(data.strip())


def english() -> list[str]:
    """Return every English text, once, in the order in which they are found."""
    return list(dict.fromkeys((*_of_page(), *NAMES, *PLACES, *WHERE, *_of_alarms())))


def _of_page() -> Iterator[str]:
    for name in page.FILES:
        text = (FOLDER / name).read_text()
        if name.endswith(".html"):
            parser = _Texts()
            parser.feed(text)
            yield from parser.found
        elif name.endswith(".js"):
            yield from (json.loads(f'"{found}"') for found in _CALL.findall(text))


def _of_alarms() -> Iterator[str]:
    for entry in ALARMS.values():
        yield from (text for text in (entry.title, entry.remedy) if text)
    yield from (entry.description for entry in OF_COMPENSATION)
    for name in _DESCRIPTION.findall(inspect.getsource(active_alarms)):
        yield getattr(alarms, name).description
    yield from said_in(active_alarms)
    yield verdict.AWAITED


def said_in(module: ModuleType) -> Iterator[str]:
    """Yield what a module makes sentences of."""
    for node in ast.walk(ast.parse(inspect.getsource(module))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Text":
            yield ast.literal_eval(node.args[0])


def main(language: str = "") -> None:
    """Write the texts that a language lacks, all of them where there is none."""
    known = json.loads((FOLDER / f"{language}.json").read_text()) if language else {}
    lacking = {text: text for text in english() if text not in known}
    sys.stdout.write(f"{json.dumps(lacking, ensure_ascii=False, indent=1)}\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
