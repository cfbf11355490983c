"""Rights: what controllers and certificate roles may do."""

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from gateway.config.axis_model import AxisSection, Writers
from gateway.config.checks.lines import controller_key
from gateway.config.files import is_out_of_reach
from gateway.config.findings import Findings
from gateway.config.line_model import ControllerSection, LineSection
from gateway.config.rights_model import RightsKeys
from gateway.config.sections import Sections
from gateway.config.toml import KeyPath
from gateway.drives.motion import Action
from gateway.drives.rule_keys import rule_key
from gateway.exchange.access import MONITOR_FUNCTIONS
from gateway.exchange.plan import Role
from gateway.files import FileRefusedError
from gateway.modbus.pdu import BROADCAST_UNIT_ID, FunctionCode
from gateway.transport.certificates import (
    Facts,
    TimeProblem,
    TlsFileError,
    TlsFiles,
    list_ends,
    list_problem,
    read_facts,
    time_problem,
)

# --- Whether the rights of a controller are useful, and permit only whole positions

LISTS: Final = ("unit_ids", "function_codes", "readable", "writable")
WRITING: Final = frozenset({0x05, 0x06, 0x0F, 0x10, 0x16, 0x17, 0x2B})
"""Function codes that can carry a position or a trigger."""
READING: Final = MONITOR_FUNCTIONS | {FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT}

Axes = dict[str, AxisSection]


def check_rights(findings: Findings, sections: Sections) -> None:
    """Check the rights of every controller against its role and against the axes of its line."""
    for name, line in sections.lines.items():
        axes = {axis: section for axis, section in sections.axes.items() if section.line == name}
        for index, controller in enumerate(line.controllers):
            for key, rights in _rights_of(controller, controller_key(findings, name, controller.name, index)):
                _check_lists(findings, rights, key)
                _check_role(findings, rights, key)
                if axes:
                    is_broadcast = BROADCAST_UNIT_ID in rights.unit_ids and line.drives.tcp is None
                    _check_unit_ids(findings, rights, key, axes, is_broadcast=is_broadcast)
                    _check_positions(findings, rights, key, axes)
                    _check_moves(findings, rights, key, axes)
        for axis, section in axes.items():
            _check_movers(findings, name, line, axis, section)


def _rights_of(controller: ControllerSection, key: KeyPath) -> list[tuple[KeyPath, RightsKeys]]:
    """Return the rights of a controller, or of each role that its certificates may have."""
    if controller.tls is None:
        return [(key, controller)]
    return [((*key, "roles", name), rights) for name, rights in controller.roles.items()]


def _check_lists(findings: Findings, rights: RightsKeys, key: KeyPath) -> None:
    for name in LISTS:
        is_empty = name in rights.model_fields_set and not getattr(rights, name)
        if is_empty and not findings.is_refused((*key, name)):  # otherwise its content was refused
            findings.refuse(
                (*key, name),
                "an empty list, which would allow everything",
                "remove it if all are allowed, or name those that are",
            )


def _check_role(findings: Findings, rights: RightsKeys, key: KeyPath) -> None:
    may_not_write = rights.role is Role.MONITOR or rights.read_only
    if rights.writable and may_not_write:
        why, remedy = f'role = "{rights.role.value}"', "give it another role"
        if rights.read_only:
            why, remedy = "read_only = true", "write read_only = false"
        findings.refuse(
            (*key, "writable"),
            f"addresses that may be written, but {why} may write nothing",
            f"remove writable, or {remedy} if it may write them",
        )
    if may_not_write and rights.function_codes and not READING & set(rights.function_codes):
        findings.refuse(
            (*key, "function_codes"),
            "only function codes that write, but the controller may only read",
            "name those that it reads with, as 3 and 4, or let it write",
        )


def _check_unit_ids(
    findings: Findings, rights: RightsKeys, key: KeyPath, axes: Axes, *, is_broadcast: bool
) -> None:
    axis_unit_ids = {axis.unit_id for axis in axes.values()}
    for index, unit_id in enumerate(rights.unit_ids):
        if unit_id not in axis_unit_ids and not (is_broadcast and unit_id == BROADCAST_UNIT_ID):
            shown = ", ".join(map(str, sorted(axis_unit_ids)))
            findings.warn(
                (*key, "unit_ids", index),
                f"no axis of this line has unit id {unit_id}",
                f"the axes have {shown}; keep it if another device on the line has it",
            )
    left_out = sorted(axis_unit_ids - set(rights.unit_ids))
    if is_broadcast and left_out:
        shown = ", ".join(map(str, left_out))
        findings.warn(
            (*key, "unit_ids"),
            f"unit id 0, the broadcast, also reaches {shown}, which is not listed: broadcasts are refused",
            f"name {shown} as well, or remove 0",
        )


def _check_positions(findings: Findings, rights: RightsKeys, key: KeyPath, axes: Axes) -> None:
    """Refuse rights to write a part of a position: the result would be undefined."""
    for name, axis in axes.items():
        if axis.registers is None or (rights.unit_ids and axis.unit_id not in rights.unit_ids):
            continue
        fields = [field for position in axis.registers.command for field in position.fields()]
        for index, span in enumerate(rights.writable):
            for field in fields:
                last = field.end - 1
                is_disjoint = last < span.first or span.last < field.address
                if not is_disjoint and not span.first <= field.address <= last <= span.last:
                    part, whole = f"{span.first:04X}-0x{span.last:04X}", f"{field.address:04X}-0x{last:04X}"
                    findings.refuse(
                        (*key, "writable", index),
                        f"0x{part} holds a part of a command position of axis {name}, which is 0x{whole}",
                        "name all of its addresses, or none",
                    )


def _check_moves(findings: Findings, rights: RightsKeys, key: KeyPath, axes: Axes) -> None:
    if rights.role is not Role.MOTION or not _has_rights(rights):
        return
    if any(_may_move(rights, axis) for axis in axes.values()):
        return
    findings.warn(
        (*key, "role"),
        'role = "motion", but its rights allow it to move no axis of this line',
        'write role = "monitor" or "operator", or allow a command position of an axis',
    )


def _check_movers(findings: Findings, name: str, line: LineSection, axis: str, section: AxisSection) -> None:
    """Warn of a second controller for an axis: the first to move it holds it, and the other is refused."""
    movers = []
    for index, controller in enumerate(line.controllers):
        key = controller_key(findings, name, controller.name, index)
        rights = [each for _, each in _rights_of(controller, key)]
        if any(each.role is Role.MOTION and _may_move(each, section) for each in rights):
            movers.append((key, controller.name))
    if len(movers) < 2 or section.writers is Writers.ANY:
        return
    findings.warn(
        (*movers[-1][0], "role"),
        f"{' and '.join(mover for _, mover in movers)} may each move axis {axis}: while one does, the "
        "other is refused",
        'give a controller that only reads or stops role = "monitor" or "operator", or name in unit_ids '
        f'the drives of each; if all may move it, set axis.{axis}.writers = "any"',
    )


def _has_rights(rights: RightsKeys) -> bool:
    return rights.read_only or any(getattr(rights, name) for name in LISTS)


def _may_move(rights: RightsKeys, axis: AxisSection) -> bool:
    if rights.read_only or (rights.unit_ids and axis.unit_id not in rights.unit_ids):
        return False
    if rights.function_codes and not WRITING & set(rights.function_codes):
        return False
    if not rights.writable or axis.registers is None:
        return True
    return any(
        span.first <= field.address and field.end - 1 <= span.last
        for span in rights.writable
        for position in axis.registers.command
        for field in position.fields()
    )


# --- Whether the controllers of a line can do what their roles permit


def check_roles(findings: Findings, sections: Sections) -> None:
    """Warn of an operator on a line where a stop cannot be distinguished from another write."""
    with_stops = {
        axis.line
        for axis in (sections.axes | sections.partial_axes).values()
        if axis.registers is not None and rule_key(axis.registers, Action.STOP) is not None
    }
    for name, line in sections.lines.items():
        for index, controller in enumerate(line.controllers):
            key = controller_key(findings, name, controller.name, index)
            role_keys = {(*key, "roles", given): each.role for given, each in controller.roles.items()}
            for role_key, role in (role_keys or {key: controller.role}).items():
                if role is not Role.OPERATOR or name in with_stops:
                    continue
                findings.warn(
                    (*role_key, "role"),
                    'role = "operator", and the registers of no axis of this line list a stop',
                    "it may only read here; list the values under stop in mode or trigger, or write "
                    '"monitor"',
                )


# --- Whether Modbus/TCP Security can work: keys that belong together, and their files

SERVER_REMEDY: Final = "have it made for a server; pitch-gateway certificate server makes one"


def check_tls_keys(findings: Findings) -> None:
    """Refuse keys that have no meaning together, as written in the file."""
    for path, raw in _raw_controllers(findings):
        has_tls = "tls" in raw
        if has_tls and "rtu" in raw:
            findings.refuse((*path, "tls"), "tls on a serial port", "remove it: tls belongs to tcp")
        if has_tls and "rtu_over_tcp" in raw:
            findings.refuse(
                (*path, "tls"), "tls around RTU frames", "remove it: Modbus/TCP Security is only for tcp"
            )
        if "roles" in raw and not has_tls:
            findings.refuse(
                (*path, "roles"),
                "roles without tls",
                "give tls as well, because roles come from certificates; or write the rights at the "
                "controller",
            )
        if has_tls and not raw.get("roles"):
            findings.refuse(
                (*path, "tls"),
                "tls without roles",
                "needed: at least one [line.NAME.controllers.roles.ROLE], named as in the certificates",
            )
        for key in RightsKeys.model_fields if has_tls else ():
            if key in raw:
                findings.refuse(
                    (*path, key),
                    f"{key} beside tls",
                    "move it under roles: with tls the role in the certificate gives the rights",
                )


def check_tls_files(findings: Findings, sections: Sections, now: datetime) -> None:
    """Refuse files that permit no connection; warn of what expires soon."""
    for name, line in sections.lines.items():
        for index, controller in enumerate(line.controllers):
            path = (*controller_key(findings, name, controller.name, index), "tls")
            if controller.tls is not None and not findings.is_refused(path):
                _Check(findings, path, controller.tls.files(sections.folder), now).all()


def _raw_controllers(findings: Findings) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    lines = findings.document.tables.get("line")
    for name, line in lines.items() if isinstance(lines, dict) else ():
        controllers = line.get("controllers") if isinstance(line, dict) else None
        for index, controller in enumerate(controllers if isinstance(controllers, list) else ()):
            if isinstance(controller, dict):
                yield ("line", name, "controllers", index), controller


class _Check:
    """The files of one listener."""

    def __init__(self, findings: Findings, path: KeyPath, files: TlsFiles, now: datetime) -> None:
        self._findings = findings
        self._path = path
        self._files = files
        self._now = now

    def all(self) -> None:
        """Check every file alone, then all together."""
        self._own()
        self._clients()
        if self._files.revoked:
            self._revoked()
        if is_out_of_reach(self._files.key):
            self._warn(
                "key",
                f"{self._files.key} was not checked: only the service receives it",
                "start the service: it checks the key and reports problems",
            )
            return
        from gateway.transport.tls import server_context

        try:
            server_context(self._files)
        except TlsFileError as error:
            if not self._findings.is_refused((*self._path, error.key)):
                self._refuse(error.key, error.found, error.remedy)

    def _own(self) -> None:
        facts = self._facts("certificate", self._files.certificate)
        if not facts:
            return
        own = facts[0]
        self._check_time("certificate", own)
        self._check_strength("certificate", own)
        if not (own.names_purpose and own.is_for_servers):
            found = f"{self._files.certificate} is not for a server: no extended key usage serverAuth"
            self._refuse("certificate", found, SERVER_REMEDY)
        if not own.hosts:
            self._warn(
                "certificate",
                f"{self._files.certificate} names no host (subjectAltName): controllers may refuse it",
                "have it made with the names and addresses that controllers use",
            )

    def _clients(self) -> None:
        for each in self._facts("clients", self._files.clients):
            if not each.is_authority:
                self._refuse(
                    "clients",
                    f"{self._files.clients}: {each.subject} is not an authority",
                    "give the certificate of the authority that signs the controllers' certificates",
                )
            self._check_time("clients", each)
            self._check_strength("clients", each)

    def _revoked(self) -> None:
        try:
            _, ends, _ = list_ends(Path(self._files.revoked))
        except FileRefusedError as error:
            self._refuse("revoked", f"{self._files.revoked}: {error.found}", error.remedy)
            return
        self._report_time("revoked", list_problem(self._files.revoked, ends, self._now))

    def _facts(self, key: str, name: str) -> tuple[Facts, ...]:
        try:
            return read_facts(Path(name))
        except FileRefusedError as error:
            self._refuse(key, f"{name}: {error.found}", error.remedy)
            return ()

    def _check_time(self, key: str, facts: Facts) -> None:
        self._report_time(key, time_problem(facts, self._now))

    def _report_time(self, key: str, problem: TimeProblem | None) -> None:
        if problem is not None:
            report = self._warn if problem.is_good_now else self._refuse
            report(key, problem.found, problem.remedy)

    def _check_strength(self, key: str, facts: Facts) -> None:
        if facts.weakness:
            self._refuse(
                key, f"{facts.subject} has a weak key: {facts.weakness}", "have a new one made with P-256"
            )

    def _refuse(self, key: str, found: str, remedy: str) -> None:
        self._findings.refuse((*self._path, key), found, remedy)

    def _warn(self, key: str, found: str, remedy: str) -> None:
        self._findings.warn((*self._path, key), found, remedy)
