"""One drive as a file: its register map, its known problems, and the source of each value."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Final

from pydantic import Field

from gateway.drives.motion import Action, Form
from gateway.drives.registers import RegisterMap, clashes, position_spans
from gateway.drives.rule_keys import rule_key
from gateway.drives.strict import ByName, ListOf, StrictModel
from gateway.plain import JsonObject

KeyPath = tuple[str | int, ...]
FunctionCode = Annotated[int, Field(ge=1, le=127)]


class Tier(Enum):
    """The quality of a profile's sources."""

    A = "A"
    """Target, trigger and measured position from manuals and independent programs that agree."""
    B = "B"
    """Consistent, from one family of sources."""
    OWN = "own"
    """A file of the user's."""


class Transport(Enum):
    """How a drive is connected."""

    RTU = "rtu"
    TCP = "tcp"


class Confidence(Enum):
    """How well a value is known."""

    VERIFIED = "verified"
    """Two independent sources agree, or a manual and an independent program."""
    SINGLE_SOURCE = "single-source"
    UNCERTAIN = "uncertain"
    """Sources contradict each other, or a value was taken over from a related drive."""


class SerialDefaults(StrictModel):
    """The serial settings of a new drive."""

    baudrate: Annotated[int, Field(gt=0)] | None = Field(default=None, description="bits per second")
    parity: str | None = Field(default=None, description="none, even or odd")
    stop_bits: Annotated[int, Field(ge=1, le=2)] | None = Field(default=None, description="1 or 2")


class Trap(StrictModel):
    """A known problem of this drive."""

    what: str = Field(description="what goes wrong")
    check: str = Field(default="", description="what to look at before the machine is run")


class Source(StrictModel):
    """A public document or program."""

    title: str = Field(description="its title")
    url: str = Field(default="", description="where it can be read")
    place: str = Field(default="", description="page or file inside it")
    note: str = Field(default="", description="what was taken from it")


class Evidence(StrictModel):
    """The reason for a value of the register map."""

    confidence: ByName[Confidence] = Field(description="verified, single-source or uncertain")
    sources: ListOf[str] = Field(default=(), description="keys of [sources]")


class Profile(StrictModel):
    """One drive, or a family of drives with the same registers."""

    title: str = Field(description="what the drive is called")
    vendor: str = Field(default="", description="who makes it")
    models: ListOf[str] = Field(default=(), description="types that have these registers")
    tier: ByName[Tier] = Field(default=Tier.OWN, description="A, B or own")
    summary: str = Field(default="", description="how the drive is commanded, in a few sentences")
    counts: str = Field(default="", description="what one count is")
    transports: ListOf[ByName[Transport]] = Field(default=(), description="rtu, tcp or both")
    unit_ids: str = Field(default="", description="unit ids that the drive takes")
    unit_id_range: Annotated[tuple[int, int], Field(strict=False)] | None = Field(
        default=None, description="the lowest and the highest of them, where its manual says so"
    )
    function_codes: ListOf[FunctionCode] = Field(default=(), description="function codes that it knows")
    serial: SerialDefaults = Field(default=SerialDefaults(), description="its serial port when it is new")
    registers: RegisterMap = Field(description="its registers")
    traps: ListOf[Trap] = Field(default=(), description="what goes wrong with it")
    sources: dict[str, Source] = Field(default={}, description="where the values come from")
    evidence: dict[str, Evidence] = Field(default={}, description="why each value is believed")

    def written(self) -> JsonObject:
        """Return the register map as in the file."""
        return self.registers.model_dump(mode="json", exclude_unset=True)


@dataclass(frozen=True, slots=True)
class ProfileFault:
    """A fault of a profile: the key, what was found, what to do."""

    path: KeyPath
    found: str
    remedy: str


def faults(profile: Profile, *, is_shipped: bool = False) -> Iterator[ProfileFault]:
    """Yield every contradiction in a profile.

    A shipped profile must give a reason for every value. In a user's own file evidence and sources may be
    missing, but those that it has must be right.
    """
    yield from _overlaps(profile.registers)
    yield from _too_long(profile.registers)
    for fault in motion_faults(profile.registers):
        yield ProfileFault(("registers", *fault.path), fault.found, fault.remedy)
    yield from _wrong_evidence(profile)
    if is_shipped:
        yield from _missing_evidence(profile)
        yield from _missing_words(profile)


def _overlaps(registers: RegisterMap) -> Iterator[ProfileFault]:
    for one, other in clashes(registers):
        yield ProfileFault(
            ("registers", *other.key),
            f"{other} overlaps {one} of {key_name(one.key)}",
            "a register belongs to one position: check addresses and types",
        )


def _too_long(registers: RegisterMap) -> Iterator[ProfileFault]:
    longest = max(position_spans(registers), key=lambda span: span.words)
    if longest.words > registers.max_registers:
        yield ProfileFault(
            ("registers", "max_registers"),
            f"max_registers = {registers.max_registers}, "
            f"but {key_name(longest.key)} has {longest.words} registers",
            f"allowed: {longest.words} or more",
        )


def motion_faults(registers: RegisterMap) -> Iterator[ProfileFault]:
    """Yield why the drive cannot be moved by its registers; keys inside the map."""
    longer = next((position for position in registers.command if position.type.words > 1), None)
    if registers.write is Form.FC06 and longer is not None and not registers.staged:
        # Single writes of the words must not move the axis word by word.
        yield ProfileFault(
            ("write",),
            f'write = "fc06", a command of {longer.type.words} registers ({longer.type.value}) and '
            "staged = false",
            "the first word alone would move the axis; allowed: staged = true with the trigger that runs the "
            'target, a type of one register, or "fc16"',
        )
    following = rule_key(registers, Action.FOLLOW, Action.FOLLOW_NEXT)
    if registers.write is Form.FC06 and longer is not None and following is not None:
        yield ProfileFault(
            following,
            f'write = "fc06", a command of {longer.type.words} registers ({longer.type.value}) and a value '
            "with which the drive follows each position written",
            'each word alone would move the axis; allowed: "fc16", a type of one register, or no such value',
        )
    key = rule_key(registers, Action.RELATIVE_TO_ACTUAL)
    if key is not None and not registers.actual:
        yield ProfileFault(
            key,
            "distances from the measured position, and registers.actual is not mapped",
            "map actual; without it none of these moves could be corrected",
        )


DESCRIBED: Final = ("unit_ids", "function_codes", "serial", "counts")
"""Keys beside the register map for which a source may be named."""


def _wrong_evidence(profile: Profile) -> Iterator[ProfileFault]:
    allowed = {*_all_keys(profile.written()), *DESCRIBED}
    for key, evidence in profile.evidence.items():
        if key not in allowed:
            yield ProfileFault(
                ("evidence", key),
                f'"{key}" is no key of [registers]',
                'name it as in "command", "command[1]" or "bits.homed" (lists count from 1), or one of '
                + ", ".join(DESCRIBED),
            )
        for name in evidence.sources:
            if name not in profile.sources:
                yield ProfileFault(
                    ("evidence", key, "sources"),
                    f'there is no [sources] "{name}"',
                    f"allowed: {', '.join(profile.sources) or 'none, as [sources] is empty'}",
                )


def _missing_evidence(profile: Profile) -> Iterator[ProfileFault]:
    for key in entries(profile.written()):
        if evidence_of(profile, key) is None:
            yield ProfileFault(("evidence",), f'nothing is said about "{key}"', "say why it is believed")
    for key, evidence in profile.evidence.items():
        if not evidence.sources:
            yield ProfileFault(("evidence", key), "no sources", "name at least one key of [sources]")


SHIPPED_NEEDS: Final = (
    "vendor",
    "models",
    "summary",
    "counts",
    "transports",
    "unit_ids",
    "function_codes",
    "traps",
    "sources",
)


def _missing_words(profile: Profile) -> Iterator[ProfileFault]:
    for name in SHIPPED_NEEDS:
        if not getattr(profile, name):
            yield ProfileFault((name,), "missing", "a shipped profile has it")
    if profile.tier is Tier.OWN:
        yield ProfileFault(("tier",), 'tier = "own"', 'allowed: "A" or "B"')


def entries(written: Mapping[str, Any]) -> list[str]:
    """Return the keys of a map that need a reason: each position, rule and bit, and each other value.

    >>> entries({"command": [{"address": 1}], "bits": {"homed": {"address": 2}}, "gap_ms": 10.0})
    ['command[1]', 'bits.homed', 'gap_ms']
    """
    keys: list[str] = []
    for name, value in written.items():
        if isinstance(value, list) and name != "starts_on":
            keys += [f"{name}[{number}]" for number in range(1, len(value) + 1)]
        elif name == "bits":
            keys += [f"bits.{bit}" for bit in value]
        else:
            keys.append(name)
    return keys


def evidence_of(profile: Profile, key: str) -> Evidence | None:
    """Return the evidence for a key, or for the key that contains it."""
    while key:
        if key in profile.evidence:
            return profile.evidence[key]
        key = key[: max(key.rfind("."), key.rfind("["), 0)]
    return None


def key_name(path: KeyPath) -> str:
    """Write a path as text for people; lists count from 1.

    >>> key_name(("command", 0, "words"))
    'command[1].words'
    """
    text = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in path)
    return text.removeprefix(".")


def _all_keys(value: Any, path: KeyPath = ()) -> Iterator[str]:
    if path:
        yield key_name(path)
    inside: Any = ()
    if isinstance(value, Mapping):
        inside = value.items()
    elif isinstance(value, list):
        inside = enumerate(value)
    for key, found in inside:
        yield from _all_keys(found, (*path, key))
