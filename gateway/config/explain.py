"""What a schema error means to the person who wrote the file."""

from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, Final, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from gateway.config.bounds import bounds_text
from gateway.config.findings import Findings
from gateway.config.problems import shown
from gateway.config.toml_lines import KeyPath

UNKNOWN_KEY: Final = "unknown key"
_ALLOWED: Final[Mapping[str, str]] = {
    "bool_type": "true or false",
    "dict_type": "a table",
    "finite_number": "a finite number",
    "float_type": "a number",
    "int_from_float": "a whole number",
    "int_type": "a whole number",
    "model_attributes_type": "a table",
    "model_type": "a table",
    "string_type": "a text in quotes",
    "tuple_type": "a list in [ ]",
}
_OUT_OF_BOUNDS: Final = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal"})
_WITH_CONTEXT: Final[Mapping[str, str]] = {
    "too_short": "at least {min_length} of them",
    "too_long": "{max_length} of them",
    "string_too_short": "a text of at least {min_length} character",
    "string_pattern_mismatch": "a text that matches {pattern}",
    "enum": "{expected}",
}


def explain(
    findings: Findings, root: type[BaseModel], raw: object, base: KeyPath, error: ValidationError
) -> None:
    """Turn every schema error of one section into a problem of the file."""
    seen: set[tuple[KeyPath, str]] = set()
    for detail in error.errors(include_url=False):
        if _is_aftermath(detail):
            continue
        path = base + existing(raw, detail)
        found, remedy = _words(root, detail)
        if (path, remedy) not in seen:
            seen.add((path, remedy))
            findings.refuse(path, found, remedy)


def existing(raw: object, detail: ErrorDetails) -> KeyPath:
    """Return the place of an error as far as it exists in the file; a missing key still counts."""
    place = detail["loc"]
    here = raw
    for depth, part in enumerate(place):
        try:
            here = here[part]  # type: ignore[index]
        except (TypeError, KeyError, IndexError):
            is_missing_key = detail["type"] == "missing" and depth == len(place) - 1 and isinstance(part, str)
            return place[: depth + 1] if is_missing_key else place[:depth]
    return place


def _is_aftermath(detail: ErrorDetails) -> bool:
    """A list whose elements were refused counts as too short; that says nothing new."""
    found = detail["input"]
    return (
        detail["type"] == "too_short"
        and isinstance(found, list)
        and len(found) >= detail["ctx"]["min_length"]
    )


def _words(root: type[BaseModel], detail: ErrorDetails) -> tuple[str, str]:
    kind = detail["type"]
    place = detail["loc"]
    if kind == "missing" and isinstance(place[-1], str):
        return "missing", f"needed: {_description(root, place)}"
    if kind == "missing":
        return f"found {shown(detail['input'])}", f"allowed: a list of {int(place[-1]) + 1} or more"
    if kind == "extra_forbidden":
        return UNKNOWN_KEY, suggest(str(place[-1]), keys_at(root, place[:-1]))
    found = f"found {shown(detail['input'])}"
    if kind == "value_error":
        return found, str(detail["ctx"]["error"])
    if kind in _OUT_OF_BOUNDS:
        field = _field_at(root, place)
        return found, f"allowed: {bounds_text(field) if field is not None else detail['msg']}"
    if kind in _WITH_CONTEXT:
        return found, "allowed: " + _WITH_CONTEXT[kind].format(**detail["ctx"]).replace("'", '"')
    return found, "allowed: " + _ALLOWED.get(kind, detail["msg"])


def suggest(unknown: str, known: Sequence[str]) -> str:
    """Say what an unknown key was probably meant to be, or what may stand there.

    >>> suggest("counts_per_units", ["counts_per_unit", "units"])
    'did you mean counts_per_unit?'
    """
    near = get_close_matches(unknown.lower(), known, n=1, cutoff=0.6)
    return f"did you mean {near[0]}?" if near else f"allowed: {', '.join(known)}"


def keys_at(root: type[BaseModel], place: KeyPath) -> list[str]:
    """Return the keys that may stand in the table at ``place`` of a section."""
    model = _model_at(root, place)
    return list(model.model_fields) if model is not None else []


def _description(root: type[BaseModel], place: KeyPath) -> str:
    field = _field_at(root, place)
    return (field.description or "") if field is not None else ""


def _field_at(root: type[BaseModel], place: KeyPath) -> FieldInfo | None:
    names = [part for part in place if isinstance(part, str)]
    model = _model_at(root, tuple(names[:-1]))
    return model.model_fields.get(names[-1]) if model is not None and names else None


def _model_at(root: type[BaseModel], place: KeyPath) -> type[BaseModel] | None:
    model = root
    names_follow = False
    for part in place:
        if isinstance(part, int):
            continue
        if names_follow:  # a name that the file chose; the keys of its table come next
            names_follow = False
            continue
        if part not in model.model_fields:
            return None
        inside = next(models_in(model.model_fields[part].annotation), None)
        if inside is None:
            return None
        names_follow = get_origin(model.model_fields[part].annotation) is dict
        model = inside
    return model


def models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that a field's type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_in(part)
