"""Where each value of a configuration comes from, without secrets."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel

from gateway.config.compile import leaves
from gateway.config.findings import Document, Place, field_at, marks_at, models_in
from gateway.config.problems import key_text, shown
from gateway.config.sections import NAMED, SINGLE
from gateway.config.toml import KeyPath
from gateway.drives.strict import Mark
from gateway.secret_files import CREDENTIAL
from gateway.state.include import INCLUDE, sets

_OF_UNKNOWN: Final = "not shown: unknown key"
_OF_KEY_FOR_FILE: Final = "not shown: it names no file, so it may be the secret itself"


@dataclass(frozen=True, slots=True)
class Setting:
    """A value in one of the files."""

    key: KeyPath
    value: Any
    place: Place
    replaced_by: Place | None
    """Where a later file gives another value; None: this one is in force."""
    hidden: str
    """Why the value must not be shown; "" if it may."""

    @property
    def shown(self) -> str:
        """The value as in a TOML file, shortened if it is long."""
        return f"({self.hidden})" if self.hidden else shown(self.value)

    def as_data(self) -> dict[str, Any]:
        """Return plain data; a hidden value is None."""
        by = self.replaced_by
        return {
            "key": key_text(self.key),
            "value": None if self.hidden else self.value,
            "hidden": self.hidden,
            "file": str(self.place.file),
            "line": self.place.line,
            "replaced_by": None if by is None else {"file": str(by.file), "line": by.line},
        }


def settings_in(document: Document) -> list[Setting]:
    """Return each value of all files; those that are in force in their order, each with those it replaced."""
    parts = document.parts or (document,)
    order = {key: at for at, (key, _) in enumerate(_values(document.tables))}
    found: list[tuple[int, Setting]] = []
    for number, part in enumerate(parts):
        secrets = written_secrets(part.tables, document.path.parent)
        for key, value in _values(part.tables):
            by = [later for later in parts[number + 1 :] if sets(later.tables, key)]
            replaced_by = Place(by[-1].path, by[-1].lines.of(key)) if by else None
            place = Place(part.path, part.lines.of(key))
            setting = Setting(key, value, place, replaced_by, _why_hidden(key, value, secrets))
            found.append((order.get(key, len(order)), setting))
    return [each for _, each in sorted(found, key=lambda one: (one[0], one[1].replaced_by is not None))]


def _values(here: Any, key: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    """Yield each value with its key: a list without tables in it is one value."""
    if isinstance(here, dict) and (here or not key):
        for name, value in here.items():
            if key or name != INCLUDE:
                yield from _values(value, (*key, name))
    elif isinstance(here, list) and any(isinstance(each, dict) for each in here):
        for number, each in enumerate(here):
            yield from _values(each, (*key, number))
    else:
        yield key, here


def _why_hidden(key: KeyPath, value: object, secrets: set[str]) -> str:
    kind = str(key[0])
    model = {**SINGLE, **NAMED}.get(kind)
    inside = key[1 + (kind in NAMED) :]
    if value in ({}, []):
        return ""
    if model is None or not _is_known(model, inside, value):
        return _OF_UNKNOWN
    texts = (each for _, each in leaves(value) if isinstance(each, str))
    return _OF_KEY_FOR_FILE if not secrets.isdisjoint(texts) else ""


def _is_known(model: type[BaseModel], key: KeyPath, value: object) -> bool:
    """Whether there is such a key, or one whose table is no model of its own: it has numbers, as ``gain``."""
    if field_at(model, key) is not None:
        return True
    around = field_at(model, key[:-1])
    return around is not None and not any(models_in(around.annotation)) and not isinstance(value, str)


def written_secrets(tables: Mapping[str, Any], folder: Path) -> set[str]:
    """Return what stands where the file of a secret is to be named, and is no file.

    A person may have written the secret itself. A credential is none. ``folder``: that of the configuration.
    """
    named = {
        value
        for key, value in leaves(tables)
        if isinstance(value, str) and _names_a_secret(key) and not value.startswith(CREDENTIAL)
    }
    return {value for value in named if not _is_there(folder / value)}


def _names_a_secret(key: KeyPath) -> bool:
    kind = str(key[0])
    model = {**SINGLE, **NAMED}.get(kind)
    return model is not None and Mark.SECRET in marks_at(model, key[1 + (kind in NAMED) :])


def _is_there(path: Path) -> bool:
    """Whether there is such a file; where this user may not look there is one."""
    try:
        path.lstat()
    except PermissionError:
        return True
    except (OSError, ValueError):
        return False
    return True
