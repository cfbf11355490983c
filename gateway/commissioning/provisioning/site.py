"""``SITE.toml``: what the machines of a site have in common, and how each one differs."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import AfterValidator, Field

from gateway.commissioning.certificates import HOST
from gateway.config.checks.lines import is_loopback
from gateway.config.findings import UNKNOWN_KEY, Findings, read_document, suggest
from gateway.config.problems import Problem, key_text, shown
from gateway.config.sections import NAMED, SINGLE, read_named, read_section
from gateway.config.toml import KeyPath
from gateway.config.values import FileName, Name, parse_address
from gateway.drives.strict import ListOf, StrictModel

CONFIGURATION: Final = "gateway.toml"
CERTIFICATE, KEY, AUTHORITY, REVOKED = "server.pem", "server.key", "ca.pem", "crl.pem"
TOKEN: Final = "people.token"  # noqa: S105 - the name of a file
PASSWORD: Final = "mqtt.password"  # noqa: S105 - the name of a file
STATE: Final = "/var/lib/pitch-gateway"
LISTEN: Final = "0.0.0.0:8480"

_LABEL: Final = re.compile(r"(?!__)[A-Za-z_][A-Za-z0-9_]*")
OWN_LABELS: Final = ("machine", "site")
OF_ANSIBLE: Final = ("all", "ungrouped", "localhost")
"""Two groups that each inventory has, and the computer on which Ansible runs."""


def _check_labels(labels: dict[str, str]) -> dict[str, str]:
    for label in labels:
        if not _LABEL.fullmatch(label) or label in OWN_LABELS:
            raise ValueError(
                "allowed: names of letters, digits and _, that begin with no digit and not with __; not "
                + " or ".join(OWN_LABELS)
            )
    return labels


def _check_hosts(hosts: tuple[str, ...]) -> tuple[str, ...]:
    if not all(map(HOST.fullmatch, hosts)):
        raise ValueError('allowed: names and addresses, as in ["mill-1.local", "192.168.0.11"]')
    return hosts


Labels = Annotated[dict[str, str], AfterValidator(_check_labels)]


class SiteSection(StrictModel):
    """``[site]``: what is no configuration of a gateway."""

    name: Name = Field(description="name of the site, in its authority and in the label site")
    authority: FileName | None = Field(
        default=None,
        description="folder of an authority that is there already (pitch-gateway certificate ca), relative "
        "to this file; left out: one is made",
    )
    files: FileName | None = Field(
        default=None, description="folder with files that each machine gets, relative to this file"
    )
    labels: Labels = Field(default={}, description="labels of each Prometheus target")


class MachineSection(StrictModel):
    """``[machine.NAME]``, without the sections of its configuration."""

    hosts: Annotated[ListOf[str], AfterValidator(_check_hosts)] = Field(
        default=(),
        description="names and addresses of the machine, the one that Prometheus and Ansible use first; "
        "left out: its name",
    )
    files: FileName | None = Field(
        default=None,
        description="folder with files of this machine, such as tables/x.tab, relative to this file",
    )
    labels: Labels = Field(default={}, description="labels of its Prometheus target")


@dataclass(frozen=True, slots=True)
class Machine:
    """One machine of a site."""

    name: str
    hosts: tuple[str, ...]
    labels: Mapping[str, str]
    files: tuple[Path, ...]
    """Folders with its files, the site's first."""
    configuration: Mapping[str, Any]
    """Its whole configuration: what provisioning gives, the site's, and over these its own."""


class Site:
    """A site as its file describes it."""

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            ConfigErrors: everything that is wrong with it, except with the configurations.
        """
        self._findings = findings = Findings(read_document(path, "a file with the machines of a site"))
        self.path: Final = path
        self._tables: Final = findings.document.tables
        for key in self._tables:
            if key not in ("site", "base", "machine"):
                findings.refuse((key,), UNKNOWN_KEY, suggest(key, ["site", "base", "machine"]))
        if "site" not in self._tables:
            findings.refuse(("site",), "missing", "needed: [site] with its name")
        section = read_section(findings, SiteSection, self._tables.get("site", {"name": "-"}), ("site",))
        base = self._tables.get("base", {})
        if not isinstance(base, dict):
            findings.refuse(("base",), f"found {shown(base)}", "allowed: sections, as in [base.line.x]")
        if not self._tables.get("machine"):
            findings.refuse(("machine",), "missing", "needed: at least one [machine.NAME]")
        for key in base if isinstance(base, dict) else ():
            if key not in SINGLE and key not in NAMED:
                findings.refuse(("base", key), UNKNOWN_KEY, suggest(key, [*SINGLE, *NAMED]))
        own = self._own_sections()
        sections = read_named(_only_machine_keys(findings), "machine", MachineSection)
        self._check_names(sections)
        findings.raise_if_any()
        assert section is not None, "what is wrong with it has been refused"
        self.name: Final = section.name
        self.authority: Final = None if section.authority is None else path.parent / section.authority
        self.machines: Final = tuple(
            self._machine(name, machine, section, own[name]) for name, machine in sections.items()
        )
        findings.raise_if_any()

    def _own_sections(self) -> dict[str, dict[str, Any]]:
        """Return the sections of configuration of each machine; refuse every other key."""
        keys = (*MachineSection.model_fields, *SINGLE, *NAMED)
        machines = self._tables.get("machine", {})
        found: dict[str, dict[str, Any]] = {}
        for name, raw in machines.items() if isinstance(machines, dict) else ():
            if not isinstance(raw, dict):
                continue  # read_named says so
            for key in raw:
                if key not in keys:
                    self._findings.refuse(("machine", name, key), UNKNOWN_KEY, suggest(key, keys))
            found[name] = {key: raw[key] for key in raw if key in SINGLE or key in NAMED}
        return found

    def _check_names(self, sections: Mapping[str, MachineSection]) -> None:
        """Refuse machines that others would take for one another."""
        names: dict[str, str] = {}
        hosts: dict[str, str] = {}
        for name, machine in sections.items():
            if name.lower() in OF_ANSIBLE:
                remedy = "choose another name: in an inventory of Ansible it is another thing"
                self._findings.refuse(("machine", name), f"found the name {name}", remedy)
            if (other := names.setdefault(name.lower(), name)) != name:
                remedy = (
                    "choose names that differ by more than capitals: not every file system tells them apart"
                )
                self._findings.refuse(("machine", name), f"there is also {other}", remedy)
            host = machine.hosts[0] if machine.hosts else name
            if (other := hosts.setdefault(host.lower(), name)) != name:
                remedy = "write its own name or address first: what is for one machine would go to the other"
                self._findings.refuse(
                    ("machine", name, "hosts"), f"{host} is also the first of {other}", remedy
                )

    def _machine(
        self, name: str, machine: MachineSection, site: SiteSection, own: Mapping[str, Any]
    ) -> Machine:
        given = merged(self._tables.get("base", {}), own)
        if _at(given, ("gateway", "name")) not in (None, name):
            key = self.key_of(name, ("gateway", "name"))
            self._findings.refuse(
                key, "a name in a configuration", f"remove it: the machine is called {name} by its table"
            )
        folders = []
        for key, folder in ((("site", "files"), site.files), (("machine", name, "files"), machine.files)):
            if folder is not None and (self.path.parent / folder).is_dir():
                folders.append(self.path.parent / folder)
            elif folder is not None:
                where = self.path.parent / folder
                self._findings.refuse(key, f"there is no folder {where}", "make it, or correct its name")
        return Machine(
            name,
            machine.hosts or (name,),
            {**site.labels, **machine.labels, "machine": name, "site": site.name},
            tuple(folders),
            merged(_from_us(name, given), given),
        )

    def key_of(self, machine: str, path: KeyPath) -> KeyPath:
        """Return the key of this file that gives a key of a machine's configuration.

        If none gives it, its place is in the nearest table around it.
        """
        layers: list[KeyPath] = [("machine", machine), ("base",)]
        for length in range(len(path), 0, -1):
            # What a machine changes is its own; what is missing in a table is missing in the site's.
            for layer in layers if length == len(path) else reversed(layers):
                if _has(self._tables, (*layer, *path[:length])):
                    return (*layer, *path)
        return ("machine", machine, *path)

    def problem_of(self, machine: Machine, problem: Problem, tables: Mapping[str, Any]) -> Problem:
        """Return a problem of a machine's configuration ``tables`` as one of this file, with its line."""
        known = {key_text(path): path for path in _paths(tables)}
        nearest = problem.key
        while nearest and nearest not in known:
            nearest = re.sub(r"(\.[^.\[]*|\[\d+\]|^[^.\[]*)$", "", nearest)
        missing = problem.key.removeprefix(nearest).strip(".")
        path = self.key_of(machine.name, (*known.get(nearest, ()), *filter(None, missing.split("."))))
        line = self._findings.document.lines.of(path)
        return replace(problem, file=str(self.path), key=key_text(path), line=line)


def merged(base: Any, own: Any) -> Any:
    """Return two documents as one: tables key by key, and of everything else that of ``own``.

    >>> merged({"axis": {"x": {"unit_id": 1, "travel": [0, 9]}}}, {"axis": {"x": {"travel": [0, 5]}}})
    {'axis': {'x': {'unit_id': 1, 'travel': [0, 5]}}}
    """
    if not isinstance(base, dict) or not isinstance(own, dict):
        return own
    both = {key: merged(base[key], own[key]) for key in base if key in own}
    return {**base, **both, **{key: own[key] for key in own if key not in base}}


def _from_us(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys that a machine gets unless its site says otherwise."""
    keys: dict[str, Any] = {"gateway": {"name": name, "tables": "tables", "state": STATE}}
    listen = _at(given, ("http", "listen"))
    if listen is None or _is_seen_from_elsewhere(listen):
        tls = {"certificate": CERTIFICATE, "key": KEY, "clients": AUTHORITY, "revoked": REVOKED}
        keys["http"] = {"listen": LISTEN, "tokens": [{"name": "people", "file": TOKEN}], "tls": tls}
    if "mqtt" in given:
        keys["mqtt"] = {"username": name, "password_file": PASSWORD}
    return keys


def _is_seen_from_elsewhere(listen: object) -> bool:
    try:
        return not is_loopback(parse_address(listen)[0])
    except ValueError:
        return False  # off, or refused by the check


def _only_machine_keys(findings: Findings) -> Findings:
    """Return the same document without the sections of configuration in its machines."""
    machines = findings.document.tables.get("machine", {})
    if isinstance(machines, dict):
        keys = MachineSection.model_fields
        machines = {
            name: {key: raw[key] for key in raw if key in keys} if isinstance(raw, dict) else raw
            for name, raw in machines.items()
        }
    return replace(findings, document=replace(findings.document, tables={"machine": machines}))


def _at(tables: Any, path: KeyPath) -> Any:
    for part in path:
        if not isinstance(tables, dict) or part not in tables:
            return None
        tables = tables[part]
    return tables


def _has(tables: Any, path: KeyPath) -> bool:
    for part in path:
        try:
            tables = tables[part]
        except (KeyError, IndexError, TypeError):
            return False
    return True


def _paths(here: Any, path: KeyPath = ()) -> Iterator[KeyPath]:
    """Yield the key of each value and of each table of a document."""
    pairs = here.items() if isinstance(here, dict) else enumerate(here) if isinstance(here, list) else ()
    for key, value in pairs:
        yield (*path, key)
        yield from _paths(value, (*path, key))
