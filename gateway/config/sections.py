"""The sections of a document as models: as many as possible, so that all problems are found together."""

import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TypeVar

from pydantic import ValidationError

from gateway.config.axis_model import AxisSection, GroupSection
from gateway.config.findings import UNKNOWN_KEY, Findings, existing, explain, marks_at, suggest
from gateway.config.gateway_model import (
    AlarmOutputSection,
    CaptureSection,
    GatewaySection,
    StatusUnitSection,
)
from gateway.config.http_model import HttpSection
from gateway.config.line_model import LineSection
from gateway.config.mqtt_model import MqttSection
from gateway.config.problems import shown
from gateway.config.relay_model import RelaySection
from gateway.config.toml import KeyPath
from gateway.config.values import read_name
from gateway.drives.strict import Mark, StrictModel
from gateway.state.include import INCLUDE

Model = TypeVar("Model", bound=StrictModel)

SINGLE: Final[Mapping[str, type[StrictModel]]] = {
    "gateway": GatewaySection,
    "relay": RelaySection,
    "http": HttpSection,
    "mqtt": MqttSection,
    "status_unit": StatusUnitSection,
    "capture": CaptureSection,
    "alarm_output": AlarmOutputSection,
}
NAMED: Final[Mapping[str, type[StrictModel]]] = {
    "line": LineSection,
    "axis": AxisSection,
    "group": GroupSection,
}
LIVE: Final = frozenset({"http", "mqtt", "alarm_output"})
"""Sections of which a running gateway can take every key."""
AXIS_STAND_INS: Final[Mapping[str, Any]] = {
    "line": "",
    "unit_id": 1,
    "units": "mm",
    "counts_per_unit": 1.0,
    "referenced": "absolute",
}


@dataclass(slots=True)
class Sections:
    """The sections that could be read. A section that is too broken is left out; its problem is recorded."""

    folder: Path = Path()
    """Folder of the configuration file; paths in it are relative to this."""

    gateway: GatewaySection = field(default_factory=GatewaySection)
    relay: RelaySection = field(default_factory=RelaySection)
    http: HttpSection = field(default_factory=HttpSection)
    mqtt: MqttSection | None = None
    """None: nothing is published."""
    status_unit: StatusUnitSection | None = None
    """None: the gateway itself has no unit id."""
    capture: CaptureSection = field(default_factory=CaptureSection)
    alarm_output: AlarmOutputSection | None = None
    """None: there is no contact."""
    lines: dict[str, LineSection] = field(default_factory=dict)
    axes: dict[str, AxisSection] = field(default_factory=dict)
    partial_axes: dict[str, AxisSection] = field(default_factory=dict)
    """Axes with missing keys, completed with stand-ins so that other errors in them are found."""
    groups: dict[str, GroupSection] = field(default_factory=dict)

    checks_signatures: bool = True
    """False: it is for another machine, which has the signatures."""

    @property
    def allowed_signers(self) -> Path | None:
        """The file of those who may sign tables; None: no signature is asked for."""
        named = self.gateway.allowed_signers
        return self.folder / named if named is not None and self.checks_signatures else None

    @property
    def silent_after_s(self) -> dict[tuple[str, str], float]:
        """``silent_after_s`` of the controllers that have it, by line and controller."""
        return {
            (line, controller.name): controller.silent_after_s
            for line, section in self.lines.items()
            for controller in section.controllers
            if controller.silent_after_s is not None
        }


def read_sections(findings: Findings) -> Sections:
    """Read every section of the document; problems go to ``findings``."""
    tables = findings.document.tables
    sections = Sections(folder=findings.document.path.parent)
    for name in tables:
        if name not in SINGLE and name not in NAMED:
            findings.refuse((name,), UNKNOWN_KEY, suggest(name, [*SINGLE, *NAMED, INCLUDE]))
    for name, model in SINGLE.items():
        if name in tables:
            section = read_section(findings, model, tables[name], (name,))
            if isinstance(section, GatewaySection):
                sections.gateway = section
            elif isinstance(section, RelaySection):
                sections.relay = section
            elif isinstance(section, HttpSection):
                sections.http = section
            elif isinstance(section, MqttSection):
                sections.mqtt = section
            elif isinstance(section, StatusUnitSection):
                sections.status_unit = section
            elif isinstance(section, CaptureSection):
                sections.capture = section
            elif isinstance(section, AlarmOutputSection):
                sections.alarm_output = section
    if "line" not in tables:
        findings.refuse(("line",), "missing", "needed: at least one [line.NAME], a bus of drives")
    sections.lines = read_named(findings, "line", LineSection)
    sections.axes = read_named(findings, "axis", AxisSection)
    sections.partial_axes = _partial_axes(findings, sections.axes)
    sections.groups = read_named(findings, "group", GroupSection)
    return sections


def read_named(findings: Findings, kind: str, model: type[Model]) -> dict[str, Model]:
    """Read every valid ``[kind.NAME]``."""
    tables = findings.document.tables.get(kind, {})
    if not isinstance(tables, dict):
        findings.refuse((kind,), f"found {shown(tables)}", f"allowed: tables [{kind}.NAME]")
        return {}
    read: dict[str, Model] = {}
    for name, raw in tables.items():
        try:
            read_name(name)
        except ValueError as error:
            findings.refuse((kind, name), f"found the name {shown(name)}", str(error))
            continue
        section = read_section(findings, model, raw, (kind, name))
        if section is not None:
            read[name] = section
    return read


def _partial_axes(findings: Findings, whole: Mapping[str, AxisSection]) -> dict[str, AxisSection]:
    tables = findings.document.tables.get("axis", {})
    raw_axes = tables if isinstance(tables, dict) else {}
    partial: dict[str, AxisSection] = {}
    for name, raw in raw_axes.items():
        if name in whole or not isinstance(raw, dict):
            continue
        axis = _as_far_as_good(AxisSection, {**AXIS_STAND_INS, **raw}, AXIS_STAND_INS)
        if axis is not None:
            partial[name] = axis
    return partial


def is_live(key: str) -> bool:
    """Whether a running gateway can take another value of a key, named as in ``compile.keys_of``.

    >>> is_live("axis.x.gain.forward"), is_live("line.a.controllers[2].silent_after_s"), is_live("mqtt.host")
    (True, True, True)
    >>> is_live("axis.x.unit_id"), is_live("gateway.state"), is_live("unknown.key")
    (False, False, False)
    """
    kind, *key_path = re.sub(r"\[\d+\]", "", key).split(".")
    model = {**SINGLE, **NAMED}.get(kind)
    if kind in LIVE or model is None:
        return kind in LIVE
    inside = tuple(key_path[kind in NAMED :])
    return any(Mark.LIVE in marks_at(model, inside[:depth]) for depth in range(1, len(inside) + 1))


def read_section(findings: Findings, model: type[Model], raw: object, path: KeyPath) -> Model | None:
    """Read one section. Wrong keys are reported, and the rest is read without them.

    Returns:
        The valid part of the section, or None if a required key is missing or wrong.
    """
    if not isinstance(raw, dict):
        findings.refuse(path, f"found {shown(raw)}", f"allowed: a table [{'.'.join(map(str, path))}]")
        return None
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        explain(findings, model, raw, path, error)
    return _as_far_as_good(model, raw, {})


def _as_far_as_good(model: type[Model], raw: dict[str, Any], stand_ins: Mapping[str, Any]) -> Model | None:
    """Read a section without its errors: first without the wrong values, then without their keys."""
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        wrong = [key_path for detail in error.errors() if (key_path := _to_drop(raw, detail))]
    for key_paths in (wrong, [key_path[:1] for key_path in wrong]):
        try:
            return model.model_validate({**stand_ins, **_without(raw, key_paths)})
        except ValidationError:
            continue
    return None


def _to_drop(raw: object, detail: Any) -> KeyPath:
    key_path = existing(raw, detail)
    return key_path[:-1] if detail["type"] == "missing" else key_path


def _without(raw: dict[str, Any], key_paths: list[KeyPath]) -> dict[str, Any]:
    """Return a copy without these paths; in a list the last goes first, so that indexes stay valid."""
    copy = deepcopy(raw)
    for key_path in sorted(
        set(key_paths), key=lambda p: [(isinstance(part, int), part) for part in p], reverse=True
    ):
        here: Any = copy
        try:
            for part in key_path[:-1]:
                here = here[part]
            del here[key_path[-1]]
        except (KeyError, IndexError, TypeError):
            continue  # a table around it is already removed
    return copy
