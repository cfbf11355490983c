"""What the configuration can say and this release cannot do yet. A later release deletes its lines here.

Everything named here is refused: a key that would be ignored could move a machine to the wrong place.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from gateway.config.findings import Findings
from gateway.config.toml_lines import KeyPath

ONE_WORD_TYPES: Final = frozenset({"int16", "uint16"})


def _always(_found: Any) -> bool:
    return True


def _is(*words: object) -> Callable[[Any], bool]:
    return lambda found: found in words


def _is_not(word: object) -> Callable[[Any], bool]:
    return lambda found: found != word


def _is_listening(found: Any) -> bool:
    return not (isinstance(found, Mapping) and found.get("listen") == "")


def _is_not_fixed(found: Any) -> bool:
    return not (isinstance(found, Mapping) and found.get("source") == "fixed")


def _writes_long_positions_by_words(found: Any) -> bool:
    if not isinstance(found, Mapping) or found.get("write") != "fc06":
        return False
    command = found.get("command")
    positions = command if isinstance(command, list) else []
    return any(isinstance(p, Mapping) and p.get("type") not in ONE_WORD_TYPES for p in positions)


@dataclass(frozen=True, slots=True)
class NotBuilt:
    """One thing that is refused: where it stands (``*`` for any name), what it is, what to do instead.

    ``key`` is what to name below the place looked at, where several keys are looked at together.
    """

    place: str
    what: str
    instead: str
    applies: Callable[[Any], bool] = _always
    key: str = ""


NOT_BUILT: Final = (
    NotBuilt("http", "the status page is", 'leave [http] out or set listen = ""', _is_listening, "listen"),
    NotBuilt("mqtt", "publishing over MQTT is", "leave [mqtt] out"),
    NotBuilt("group.*", "a group of axes is", "a gantry cannot be run by this release: leave it uncorrected"),
    NotBuilt(
        "line.*.controllers.*.role",
        "the role operator is",
        'use "monitor" (may only read) or "motion" (may do everything)',
        _is("operator"),
    ),
    NotBuilt("axis.*.drive", "a drive profile is", "describe the registers in [axis.NAME.registers]"),
    NotBuilt(
        "axis.*.referenced",
        "following homing or set-position commands is",
        'use "drive-bit" with registers.bits.homed, or "absolute" for an absolute encoder',
        _is("homing", "set-position"),
    ),
    NotBuilt("axis.*.budget_us", "a latency budget is", "leave it out"),
    NotBuilt("axis.*.deadline_ms", "a deadline of targets is", "leave it out"),
    NotBuilt("axis.*.late", "a rule for late targets is", "leave it out: every target is forwarded"),
    NotBuilt(
        "axis.*.stored_moves",
        "a rule for moves that the drive keeps is",
        'leave it out or write "refuse"',
        _is_not("refuse"),
    ),
    NotBuilt(
        "axis.*.relative_unknown",
        "a rule for relative moves is",
        'leave it out or write "refuse"',
        _is_not("refuse"),
    ),
    NotBuilt(
        "axis.*.table_options.fagor_sense",
        "reading Fagor tables is",
        "convert the table to Centroid version 3 and leave this out",
    ),
    NotBuilt(
        "axis.*.registers.mode",
        "telling relative from absolute positions is",
        'use mode = { source = "fixed" } where every position written is absolute; '
        "a drive that also takes distances cannot be run by this release",
        _is_not_fixed,
    ),
    NotBuilt(
        "axis.*.registers.trigger",
        "a trigger beside the position is",
        "only drives that move as soon as the position is written can be run by this release",
        _is_not([]),
    ),
    NotBuilt(
        "axis.*.registers.staged",
        "a target that waits for a trigger is",
        "only drives that move as soon as the position is written can be run by this release",
        _is_not(False),
    ),
    NotBuilt(
        "axis.*.registers.starts_on",
        "a word that starts the motion is",
        "only drives that take the whole position in one frame can be run by this release",
        _is_not([]),
    ),
    *(
        NotBuilt(
            f"axis.*.registers.{key}",
            f"{what} is",
            "leave it out only if no controller ever writes such a register",
            _is_not([]),
        )
        for key, what in (
            ("limits", "correcting software limits"),
            ("aliases", "correcting a position at a second address"),
        )
    ),
    NotBuilt(
        "axis.*.registers",
        'write = "fc06" for positions longer than one register is',
        'use "fc16", or a position of type int16 or uint16',
        _writes_long_positions_by_words,
        "write",
    ),
)


def refuse_what_is_not_built(findings: Findings) -> None:
    """Refuse every key of the document that this release cannot honour."""
    for entry in NOT_BUILT:
        for path, found in _find(findings.document.tables, tuple(entry.place.split("."))):
            if entry.applies(found):
                key = (*path, entry.key) if entry.key else path
                findings.refuse(key, f"{entry.what} not built yet", entry.instead)


def _find(here: Any, place: tuple[str, ...], path: KeyPath = ()) -> Iterator[tuple[KeyPath, Any]]:
    if not place:
        yield path, here
    elif place[0] == "*":
        inside: Any = ()
        if isinstance(here, Mapping):
            inside = here.items()
        elif isinstance(here, list):
            inside = enumerate(here)
        for key, found in inside:
            yield from _find(found, place[1:], (*path, key))
    elif isinstance(here, Mapping) and place[0] in here:
        yield from _find(here[place[0]], place[1:], (*path, place[0]))
