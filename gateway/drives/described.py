"""The profiles of drives as text and as plain data: a list of all, and one with its whole content."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from gateway.drives import library
from gateway.drives.motion import Action
from gateway.drives.profile import Evidence, Profile, entries, evidence_of
from gateway.drives.public import SequenceKind, public_traffic
from gateway.drives.rule_keys import rule_key
from gateway.plain import JsonObject

WIDTH: Final = 110
ADDRESSES: Final = ("address", "block", "coil")
FIRST: Final = frozenset({*ADDRESSES, "source"})
LISTS_OF_VALUES: Final = frozenset(action.value for action in Action)
IN_HEXADECIMAL: Final = frozenset(
    {*ADDRESSES, *LISTS_OF_VALUES, "mask", "rising", "starts_on", "refused_read"}
)
CONSEQUENCES: Final = {
    "limits": "are positions, and corrected like a target",
    "aliases": "show a position once more, and are corrected like it",
    "position_like": (
        'are positions that the drive keeps: writing one is refused with 2 (unmapped = "pass" lets it pass, '
        "uncorrected)"
    ),
    "remap": "change what registers show: writing one ends the compensation until a restart",
    "stored": (
        'values run a position that the drive keeps: refused with 4 (stored_moves = "uncorrected" lets them '
        "pass)"
    ),
    "stop": "values go before everything else, and are never refused",
    "home": 'values and "set_position" pass unchanged, and end or make the reference as referenced says',
    "other_motion": "values pass unchanged; the position must be read after them",
}
"""The effect of a key of the register map, by the key or the meaning of a value."""
NOT_LISTED: Final = (
    'a value of a mode or trigger that is not listed and has no "otherwise" passes unchanged, and counts as '
    "unknown"
)


@dataclass(frozen=True, slots=True)
class ProfileList:
    """The profiles that come with the gateway."""

    def as_data(self) -> list[dict[str, Any]]:
        """Return them as plain data."""
        return [
            {
                "name": name,
                "tier": profile.tier.value,
                "title": profile.title,
                "vendor": profile.vendor,
                "models": list(profile.models),
                "transports": [transport.value for transport in profile.transports],
            }
            for name in library.names()
            for profile in (library.shipped(name),)
        ]

    def lines(self) -> Iterator[str]:
        """Yield them as a table."""
        rows = [("name", "tier", "transports", "drive")]
        rows += [
            (drive["name"], drive["tier"], ", ".join(drive["transports"]), drive["title"])
            for drive in self.as_data()
        ]
        yield from aligned(rows)


@dataclass(frozen=True, slots=True)
class ProfileShown:
    """One profile, by its name in the list or its file."""

    name: str
    profile: Profile

    def as_data(self) -> JsonObject:
        """Return its whole content as plain data, with the number of public sequences of each kind."""
        data = {"name": self.name, **self.profile.model_dump(mode="json", exclude_unset=True)}
        if library.is_name(self.name):
            kinds = [each.kind for each in public_traffic(self.name)]
            data["public_traffic"] = {kind.value: kinds.count(kind) for kind in SequenceKind}
        return data

    def lines(self) -> Iterator[str]:
        """Yield it as text for people."""
        name, profile = self.name, self.profile
        yield f"{profile.title} ({name}), tier {profile.tier.value}"
        yield from _facts(profile)
        yield ""
        yield "registers"
        yield from _map_lines(profile)
        yield ""
        yield "what comes of them while the axis is corrected"
        yield from _consequence_lines(profile)
        if profile.traps:
            yield ""
            yield "traps: go through them before the machine is run"
        for number, trap in enumerate(profile.traps, start=1):
            yield from _wrapped(trap.what, f"{number:3}. ")
            if trap.check:
                yield from _wrapped(f"Check: {trap.check}", "     ")
        if library.is_name(name):
            yield ""
            yield "public traffic: what programs and manuals send, tried through the gateway"
            yield from _traffic_lines(name)
        yield from _source_lines(profile)


def markdown_lines() -> Iterator[str]:
    """Yield the list of profiles as a table for the documentation."""
    yield "| name | tier | transports | models |"
    yield "|---|---|---|---|"
    for drive in ProfileList().as_data():
        models = f"{drive['vendor']}: {', '.join(drive['models'])}"
        transports = ", ".join(drive["transports"])
        yield f"| `{drive['name']}` | {drive['tier']} | {transports} | {models} |"


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows with their columns below each other.

    >>> list(aligned([("a", "bb"), ("ccc", "d")]))
    ['a    bb', 'ccc  d']
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def _traffic_lines(name: str) -> Iterator[str]:
    """Yield the kinds of sequences that were found, with their sources, and those without a publication."""
    found = public_traffic(name)
    for kind in SequenceKind:
        sources = sorted({each.source for each in found if each.kind is kind})
        if sources:
            number = sum(each.kind is kind for each in found)
            yield f"  {kind.value:<12}  {number} [{', '.join(sources)}]"
    never = [kind.value for kind in SequenceKind if all(each.kind is not kind for each in found)]
    if never:
        yield from _wrapped(", ".join(never), "  never seen in public traffic: ")


def _facts(profile: Profile) -> Iterator[str]:
    facts = {
        "made by": profile.vendor,
        "models": ", ".join(profile.models),
        "moves": " ".join(profile.summary.split()),
        "counts": profile.counts,
        "transports": ", ".join(transport.value for transport in profile.transports),
        "unit ids": profile.unit_ids,
        "functions": ", ".join(map(str, profile.function_codes)),
        "serial": _in_words(profile.serial.model_dump(exclude_none=True)),
    }
    for what, text in facts.items():
        if text:
            yield from _wrapped(text, f"{what:<11} ")


def _map_lines(profile: Profile) -> Iterator[str]:
    """Yield each entry of the map with its confidence, its meaning and its sources."""
    rows = list(_rows(profile))
    widths = [max(len(row[column]) for row in rows) for column in (0, 1)]
    for key, confidence, text in rows:
        first = f"  {key:<{widths[0]}}  {confidence:<{widths[1]}}  "
        lines = textwrap.wrap(
            text.replace("/", "/ "),  # a list of values is broken between two of them
            WIDTH,
            initial_indent=first,
            subsequent_indent=" " * len(first),
            break_on_hyphens=False,
        )
        yield from (line.replace("/ ", "/") for line in lines)


def _consequence_lines(profile: Profile) -> Iterator[str]:
    """Yield why a value is refused, passed or corrected, as far as it applies to this map."""
    registers = profile.registers
    for key, text in CONSEQUENCES.items():
        if key in LISTS_OF_VALUES:
            is_there = rule_key(registers, Action(key)) is not None
            is_there |= key == "home" and rule_key(registers, Action.SET_POSITION) is not None
            name = f'"{key}"'
        else:
            is_there, name = bool(getattr(registers, key)), key
        if is_there:
            yield from _wrapped(f"{name} {text}", "  ")
    if registers.mode is not None or registers.trigger:
        yield from _wrapped(NOT_LISTED, "  ")


def _rows(profile: Profile) -> Iterator[tuple[str, str, str]]:
    written = profile.written()
    for key in entries(written):
        yield _row(key, _value_text(written, key), evidence_of(profile, key))
        for inner, own in profile.evidence.items():
            if inner.startswith(f"{key}."):
                yield _row(f"  {inner.removeprefix(f'{key}.')}", "", own)


def _row(key: str, text: str, evidence: Evidence | None) -> tuple[str, str, str]:
    if evidence is None:
        return key, "", text
    return key, evidence.confidence.value, f"{text} [{', '.join(evidence.sources)}]".strip()


def _value_text(written: Mapping[str, Any], key: str) -> str:
    value = _value_at(written, key)
    return _in_words(value) if isinstance(value, Mapping) else _in_words(value, key)


def _value_at(written: Mapping[str, Any], key: str) -> Any:
    name, _, inside = key.partition("[")
    if inside:
        return written[name][int(inside.rstrip("]")) - 1]
    outer, _, inner = key.partition(".")
    return written[outer][inner] if inner else written[outer]


def _in_words(value: Any, key: str = "") -> str:
    if isinstance(value, Mapping):
        ordered = sorted(value, key=lambda name: name not in FIRST)
        text = ", ".join(f"{name} {_in_words(value[name], name)}" for name in ordered)
        return f"({text})" if key else text
    if isinstance(value, list):
        return "/".join(_in_words(found, key) for found in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int) and key in IN_HEXADECIMAL:
        return f"{value:#06x}"
    return str(value)


def _source_lines(profile: Profile) -> Iterator[str]:
    if profile.sources:
        yield ""
        yield "sources"
    for name, source in profile.sources.items():
        text = ". ".join(part for part in (source.title, source.place, source.note) if part)
        yield from _wrapped(text, f"  {name}: ")
        if source.url:
            yield f"    {source.url}"


def _wrapped(text: str, first: str) -> list[str]:
    return textwrap.wrap(
        text, WIDTH, initial_indent=first, subsequent_indent=" " * min(len(first), 12), break_on_hyphens=False
    )
