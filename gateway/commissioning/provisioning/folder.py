"""The folder of a site: what belongs into it, checked, compared with what is there, and written.

What this module wrote last is in ``RECORD``, by digest: a file with other content was changed by hand, and
stays as it is.
"""

import fcntl
import hashlib
import json
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from gateway.commissioning.certificates import (
    FolderError,
    Signed,
    found_authority,
    make_authority,
    make_server,
    make_viewer,
    pem_of,
    read_authority,
    why_renewed,
)
from gateway.commissioning.provisioning.broker import (
    USER_RULE,
    access_block,
    is_user,
    with_blocks,
    with_passwords,
)
from gateway.commissioning.provisioning.site import (
    AUTHORITY,
    CERTIFICATE,
    CONFIGURATION,
    KEY,
    PASSWORD,
    REVOKED,
    Machine,
    Site,
)
from gateway.config.checks.lines import is_loopback
from gateway.config.checks.rights import check_tls_files
from gateway.config.checks.services import check_http_files, check_mqtt
from gateway.config.compile import leaves
from gateway.config.findings import Document, Findings, parse_document
from gateway.config.load import load_document
from gateway.config.problems import ConfigErrors, Problem, shown
from gateway.config.sections import Sections
from gateway.config.toml import KeyLines
from gateway.config.toml_text import toml_text
from gateway.files import FileMissingError, FileRefusedError, read_regular_file, write_file
from gateway.plain import Json, JsonObject
from gateway.secret_files import new_secret, refuse_open_to_others
from gateway.state.interventions import locked
from gateway.transport.endpoints import TcpEndpoint

RECORD: Final = "provisioned.json"
AUTHORITY_FOLDER, BROKER, MACHINES, PROMETHEUS = "ca", "broker", "machines", "prometheus"
PASSWORDS, ACCESS = f"{BROKER}/pitch-gateway.passwd", f"{BROKER}/pitch-gateway.acl"
INVENTORY: Final = "hosts.json"
FOLDER_MODE: Final = 0o700
LARGEST_FILE: Final = 16 * 1024 * 1024
"""Bytes: of a table or a drive."""
NEW, CHANGED, SAME, BY_HAND = "new", "changed", "unchanged", "changed by hand"
STATES: Final = (NEW, CHANGED, SAME, BY_HAND)


class ProvisionError(Exception):
    """Nothing can be made; one sentence with the remedy."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """A file as it should be."""

    content: bytes
    is_secret: bool = False
    source: Path | None = None
    """The file that it is a copy of."""
    why: str = ""
    """Why it is another one than before."""


@dataclass(frozen=True, slots=True)
class Provisioned:
    """What came of a run."""

    folder: Path
    machines: tuple[str, ...]
    files: Mapping[str, tuple[str, str]]
    """State and reason of each file below the folder; of the broker's, of each user's part: FILE USER."""
    left_over: tuple[str, ...]
    """What an earlier run made and the site no longer needs: files, users of the broker, whole machines."""
    warnings: tuple[str, ...]
    is_dry: bool

    def count(self, state: str) -> int:
        """Return the number of files of a state."""
        return sum(found == state for found, _ in self.files.values())

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        files: list[Json] = [
            {"file": name, "state": state, "why": why} for name, (state, why) in self.files.items()
        ]
        return {
            "folder": str(self.folder),
            "dry_run": self.is_dry,
            "machines": list(self.machines),
            "counts": {state: self.count(state) for state in STATES},
            "files": files,
            "left_over": list(self.left_over),
            "warnings": list(self.warnings),
        }


@dataclass(slots=True)
class _Folder:
    """The folder as it is, and what it should be."""

    path: Path
    now: datetime
    records: dict[str, list[str]]
    """Digests of what was written, or was about to be, by name."""
    wanted: dict[str, Wanted] = field(default_factory=dict)
    states: dict[str, tuple[str, str]] = field(default_factory=dict)
    digests: dict[str, str] = field(default_factory=dict)
    """Of what is written by this run, or was right already."""

    def there(self, name: str) -> bytes | None:
        """Return the content of a file that is there; None: there is none.

        Raises:
            ProvisionError: it cannot be read.
        """
        try:
            return read_regular_file(self.path / name, LARGEST_FILE, "a file of a machine")
        except FileMissingError:
            return None
        except FileRefusedError as error:
            raise ProvisionError(f"{self.path / name}: {error}") from None

    def secret(self, name: str) -> bytes:
        """Return the secret that is there, or a new one."""
        return self.there(name) or new_secret()

    def choose(self, name: str, before: bytes | None, wanted: bytes, why: str = "") -> bytes:
        """Return what a file is to have: what is wanted, unless it was changed by hand."""
        state = NEW if before is None else CHANGED
        if before == wanted:
            state = SAME
        elif before is not None and _digest(before) not in self.records.get(name, ()):
            self.states[name] = BY_HAND, "left as it is"
            return before
        self.states[name] = state, why if state is CHANGED else ""
        self.digests[name] = _digest(wanted)
        return wanted

    def want(self, name: str, wanted: Wanted) -> None:
        """Choose what a file is to have."""
        self.wanted[name] = replace(
            wanted, content=self.choose(name, self.there(name), wanted.content, wanted.why)
        )


def provision(
    site: Site, out: Path, now: datetime, work: Path, say: Callable[[str], None], *, is_dry: bool = False
) -> Provisioned:
    """Bring the folder of a site up to date; ``work`` is an empty folder for the checks.

    All is checked before anything is written. ``say`` gets a line for each step.

    Raises:
        ProvisionError: the authority or a file cannot be read or written.
        ConfigErrors: the configurations of machines have errors; all together.
    """
    folder = _Folder(out, now, _read_records(out / RECORD))
    authority, revoked = _authority(site, folder, work)
    problems: dict[Problem, list[str]] = {}
    warnings: dict[Problem, list[str]] = {}
    sections: dict[str, Sections] = {}
    for number, machine in enumerate(site.machines, start=1):
        say(f"{machine.name}, {number} of {len(site.machines)}")
        _want_files(folder, site, machine, authority, revoked)
        found, errors, noted = _check(folder, site, machine, work)
        for kept, added in ((problems, errors), (warnings, noted)):
            for problem in added:
                kept.setdefault(problem, []).append(machine.name)
        if found is not None:
            sections[machine.name] = found
    told = _told(warnings, len(site.machines))
    if problems:
        raise ConfigErrors(_told(problems, len(site.machines)), told)
    _want_broker(folder, sections)
    _want_prometheus(folder, site, authority, sections)
    hosts = {machine.name: {"ansible_host": machine.hosts[0]} for machine in site.machines}
    folder.want(INVENTORY, Wanted(_json({"all": {"hosts": hosts}})))
    opened = [
        each for place in (AUTHORITY_FOLDER, BROKER, PROMETHEUS) for each in _open_secrets(folder, place)
    ]
    if opened:
        raise ConfigErrors(opened, told)
    if not is_dry:
        _write(folder, say)
    return Provisioned(
        out,
        tuple(machine.name for machine in site.machines),
        folder.states,
        _left_over(folder, {machine.name for machine in site.machines}),
        tuple(map(str, told)),
        is_dry,
    )


# --- What belongs into it


def _authority(site: Site, folder: _Folder, work: Path) -> tuple[Signed, bytes]:
    """Return the authority of the site, made if there is none, and its list of revoked certificates."""
    where = site.authority or folder.path / AUTHORITY_FOLDER
    try:
        if site.authority is None and folder.there(f"{AUTHORITY_FOLDER}/{AUTHORITY}") is None:
            _refuse_lost_authority(site, folder)
            where = work / AUTHORITY_FOLDER
            found_authority(where, lambda: make_authority(site.name, folder.now), folder.now)
        authority = read_authority(where, folder.now)
        revoked = read_regular_file(where / REVOKED, LARGEST_FILE, "a list of revoked certificates")
        if site.authority is None:
            for name in ("ca.key", REVOKED, AUTHORITY):  # the last one says that all are there
                content = read_regular_file(where / name, LARGEST_FILE, "a file of an authority")
                wanted = Wanted(content, is_secret=name == "ca.key")
                folder.want(f"{AUTHORITY_FOLDER}/{name}", wanted)
    except FolderError as error:
        raise ProvisionError(str(error)) from None
    except FileRefusedError as error:
        raise ProvisionError(f"{where}: {error}") from None
    return authority, revoked


def _refuse_lost_authority(site: Site, folder: _Folder) -> None:
    """Refuse a folder without its authority: with another one every machine would need new files at once."""
    names = (f"{MACHINES}/{machine.name}/{CERTIFICATE}" for machine in site.machines)
    if any(name in folder.records and folder.there(name) is not None for name in names):
        where = folder.path / AUTHORITY_FOLDER
        raise ProvisionError(
            f"{where / AUTHORITY}: no such file, but machines have certificates of this authority; bring "
            f"{where} back; or for a new authority, and new certificates for all, move away what is left of "
            f"{where} and type: pitch-gateway certificate ca {where}"
        )


def _want_files(folder: _Folder, site: Site, machine: Machine, authority: Signed, revoked: bytes) -> None:
    """Add the files of a machine: those that its site gives, and those that its configuration names."""
    place = f"{MACHINES}/{machine.name}"
    given = {name: each for files in machine.files for name, each in _files_in(files)}
    if CONFIGURATION in given:
        source = given[CONFIGURATION].source
        raise ProvisionError(f"{source}: {CONFIGURATION} is made of {site.path}; move the file away")
    head = f"# Made by pitch-gateway provision of {site.path.name}: make changes there.\n\n"
    text = head + toml_text(machine.configuration)
    assert tomllib.loads(text) == machine.configuration, "what is written means what was checked"
    wanted = {CONFIGURATION: Wanted(text.encode()), **given}
    named = {value for _, value in leaves(machine.configuration) if isinstance(value, str)}
    if CERTIFICATE in named and not {CERTIFICATE, KEY} & set(given):
        names = f"{place}/{CERTIFICATE}", f"{place}/{KEY}"
        certificate, key, why = _pair(folder, names, authority, machine.hosts, machine.name)
        wanted[KEY] = Wanted(key, is_secret=True, why=why)
        wanted[CERTIFICATE] = Wanted(certificate, why=why)
    secrets = {PASSWORD} if PASSWORD in named else set()
    http = machine.configuration.get("http")
    tokens = http.get("tokens") if isinstance(http, dict) else None
    for token in tokens if isinstance(tokens, list) else ():  # the check says what is wrong with others
        name = token.get("file") if isinstance(token, dict) else None
        if isinstance(name, str) and name == Path(name).name:
            secrets.add(name)
    for name in sorted(secrets - set(wanted)):  # never the configuration
        wanted[name] = Wanted(folder.secret(f"{place}/{name}"), is_secret=True)
    if AUTHORITY in named and AUTHORITY not in given:
        wanted[AUTHORITY] = Wanted(pem_of(authority)[0])
    if REVOKED in named and REVOKED not in given:
        wanted[REVOKED] = Wanted(revoked)
    for name, each in wanted.items():
        folder.want(f"{place}/{name}", each)


def _pair(
    folder: _Folder,
    names: tuple[str, str],
    authority: Signed,
    hosts: Sequence[str],
    owner: str,
) -> tuple[bytes, bytes, str]:
    """Return a certificate, its key, and why they are others than those that are there."""
    certificate, key = map(folder.there, names)
    why = ""
    if certificate is not None and key is not None:
        why = why_renewed((certificate, key), authority, hosts, folder.now)
        if not why or _digest(certificate) not in folder.records.get(names[0], ()):
            return certificate, key, ""
    elif certificate is not None or key is not None:
        why = f"its {'certificate' if certificate is None else 'key'} is not there"
    made = (
        make_server(authority, owner, hosts, folder.now)
        if hosts
        else make_viewer(authority, owner, folder.now)
    )
    return *pem_of(made), why


def _files_in(folder: Path) -> Iterator[tuple[str, Wanted]]:
    """Yield the files of a folder that a site gives, by their path in it."""
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder)
        if path.is_dir() or any(part.startswith(".") for part in name.parts):
            continue
        try:
            content = read_regular_file(path, LARGEST_FILE, "a file of a machine")
        except FileRefusedError as error:
            raise ProvisionError(f"{path}: {error}") from None
        is_secret = not path.stat().st_mode & stat.S_IROTH
        yield name.as_posix(), Wanted(content, is_secret, path)


def _broker_user(sections: Sections) -> str:
    """Return the user of a machine whose password is one of ours; "" if there is none."""
    mqtt = sections.mqtt
    return str(mqtt.username) if mqtt is not None and mqtt.password_file == PASSWORD else ""


def _want_broker(folder: _Folder, sections: Mapping[str, Sections]) -> None:
    """Add the broker's files: a user and a block for each machine whose password is one of ours."""
    passwords, blocks = {}, {}
    for name, found in sections.items():
        if user := _broker_user(found):
            if user in blocks:
                raise ProvisionError(
                    f"{name}: mqtt.username is {user}, as of another machine; leave it out: each has its own"
                )
            password = folder.wanted[f"{MACHINES}/{name}/{PASSWORD}"].content
            passwords[user], blocks[user] = password.decode().rstrip("\r\n"), access_block(name, found)
    for name, add, parts in ((PASSWORDS, with_passwords, passwords), (ACCESS, with_blocks, blocks)):
        if not parts:
            continue
        try:
            before = (folder.there(name) or b"").decode()
        except UnicodeDecodeError:
            raise ProvisionError(f"{folder.path / name}: not UTF-8; save the file as UTF-8 text") from None

        def choose(user: str, old: str | None, new: str, name: str = name) -> str:
            key = f"{name} {user}"
            return folder.choose(key, None if old is None else old.encode(), new.encode()).decode()

        folder.wanted[name] = Wanted(add(before, parts, choose).encode(), is_secret=True)


def _want_prometheus(
    folder: _Folder, site: Site, authority: Signed, sections: Mapping[str, Sections]
) -> None:
    """Add a target for each machine whose page Prometheus can reach, and who Prometheus is there."""
    needs_certificate = False
    for machine in site.machines:
        http = sections[machine.name].http
        if http.endpoint is None or is_loopback(http.endpoint.host):
            continue
        needs_certificate |= http.tls is not None and http.tls.clients == AUTHORITY
        address = TcpEndpoint(machine.hosts[0], http.endpoint.port)
        target = {"targets": [str(address)], "labels": dict(machine.labels)}
        folder.want(f"{PROMETHEUS}/{machine.name}.json", Wanted(_json([target])))
    if needs_certificate:
        names = f"{PROMETHEUS}/client.pem", f"{PROMETHEUS}/client.key"
        certificate, key, why = _pair(folder, names, authority, (), "prometheus")
        folder.want(names[1], Wanted(key, is_secret=True, why=why))
        folder.want(names[0], Wanted(certificate, why=why))
        folder.want(f"{PROMETHEUS}/{AUTHORITY}", Wanted(pem_of(authority)[0]))


# --- The checks of a machine


def _check(
    folder: _Folder, site: Site, machine: Machine, work: Path
) -> tuple[Sections | None, list[Problem], list[Problem]]:
    """Check a machine as it will be; return its sections, if all is good, its problems and its warnings."""
    place = f"{MACHINES}/{machine.name}"
    here, there = work / place, folder.path / place
    sources = {f"{there}{os.sep}": f"{here}{os.sep}"}
    for name, each in _of(folder, place):
        path = here / name
        path.parent.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        write_file(path, each.content, force=False, is_secret=each.is_secret)
        if each.source is not None:
            sources[str(each.source)] = str(path)
    path = here / CONFIGURATION
    is_by_hand = folder.states[f"{place}/{CONFIGURATION}"][0] == BY_HAND
    problems: list[Problem] = []
    warnings: list[Problem] = []
    sections = None
    document = Document(path, machine.configuration, KeyLines(""))
    try:
        if is_by_hand:
            document = parse_document(path, folder.wanted[f"{place}/{CONFIGURATION}"].content.decode())
        loaded = load_document(document, is_elsewhere=True)
        warnings += loaded.warnings
        sections = loaded.sections
        findings = Findings(document)
        check_mqtt(findings, sections.mqtt, here, folder.now)
        check_http_files(findings, sections.http, here, folder.now)
        check_tls_files(findings, sections, folder.now)
        problems, warnings = findings.problems, warnings + findings.warnings
        if (user := _broker_user(sections)) and not is_user(user):
            problems.append(Problem(str(path), "mqtt.username", f"found {shown(user)}", USER_RULE))
        if sections.gateway.name != machine.name:
            problems.append(
                Problem(str(path), "gateway.name", sections.gateway.name, f"write {machine.name}")
            )
    except ConfigErrors as errors:
        problems, warnings = list(errors.problems), list(errors.warnings)
    except UnicodeDecodeError:
        problems = [Problem(str(path), "", "not UTF-8", "save the file as UTF-8 text")]

    def of_site(problem: Problem) -> Problem:
        if problem.file == str(path) and not is_by_hand:
            problem = site.problem_of(machine, problem, document.tables)
        for said, checked in reversed(sources.items()):
            problem = replace(
                problem,
                file=problem.file.replace(checked, said),
                found=problem.found.replace(checked, said),
                remedy=problem.remedy.replace(checked, said),
            )
        return problem

    problems += _open_secrets(folder, place)
    return None if problems else sections, [*map(of_site, problems)], [*map(of_site, warnings)]


def _of(folder: _Folder, place: str) -> Iterator[tuple[str, Wanted]]:
    for name, each in folder.wanted.items():
        if name.startswith(f"{place}/"):
            yield name.removeprefix(f"{place}/"), each


def _open_secrets(folder: _Folder, place: str) -> Iterator[Problem]:
    """Yield the secrets that are there and that every user may read."""
    for name, each in _of(folder, place):
        path = folder.path / place / name
        try:
            if each.is_secret:
                refuse_open_to_others(path)
        except FileRefusedError as error:
            yield Problem(str(path), "", error.found, error.remedy)


def _told(found: Mapping[Problem, Sequence[str]], count: int) -> list[Problem]:
    """Return each problem once, with the machines that have it."""
    return [
        replace(problem, found=f"{_names(machines, count)}: {problem.found}")
        for problem, machines in sorted(found.items(), key=lambda each: (each[0].file, each[0].line or 0))
    ]


def _names(machines: Sequence[str], count: int) -> str:
    if len(machines) == count > 1:
        return f"all {count} machines"
    return ", ".join(machines[:3]) + (f" and {len(machines) - 3} more" if len(machines) > 3 else "")


# --- Writing


def _write(folder: _Folder, say: Callable[[str], None]) -> None:
    """Write what differs. The record has the new digests before, so that a run that was cut off goes on."""
    ours = {name: [*folder.records.get(name, ()), digest] for name, digest in folder.digests.items()}
    path = folder.path / RECORD
    try:
        folder.path.mkdir(mode=FOLDER_MODE, parents=True, exist_ok=True)
        with locked(folder.path, fcntl.LOCK_EX):
            if _read_records(path) != folder.records:
                raise ProvisionError(f"{folder.path}: another run has written here meanwhile; run this again")
            if any(folder.there(name) != each.content for name, each in folder.wanted.items()):
                _write_records(path, {**folder.records, **ours})
                say("writing")
            for name, each in folder.wanted.items():
                path = folder.path / name
                if folder.there(name) != each.content:
                    for parent in reversed(Path(name).parents):
                        (folder.path / parent).mkdir(mode=FOLDER_MODE, exist_ok=True)
                    write_file(path, each.content, force=True, is_secret=each.is_secret)
            path = folder.path / RECORD
            written = {name: [each] for name, each in folder.digests.items()}
            _write_records(path, {**folder.records, **written})
    except OSError as error:
        raise ProvisionError(f"{path}: {error.strerror or error}; name a folder of your own") from None
    except FileRefusedError as error:
        raise ProvisionError(f"{path}: {error}") from None


def _read_records(path: Path) -> dict[str, list[str]]:
    try:
        found = json.loads(read_regular_file(path, LARGEST_FILE, "the record of an earlier run"))
        return {str(name): [*map(str, digests)] for name, digests in found["written"].items()}
    except FileMissingError:
        return {}
    except FileRefusedError as error:
        raise ProvisionError(f"{path}: {error}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ProvisionError(
            f"{path}: no record of an earlier run; move it away: every file that differs then counts as "
            "changed by hand"
        ) from None


def _write_records(path: Path, records: Mapping[str, list[str]]) -> None:
    content = _json({"written": {name: records[name] for name in sorted(records)}})
    if not path.exists() or path.read_bytes() != content:
        write_file(path, content, force=True, is_secret=True)


def _left_over(folder: _Folder, machines: set[str]) -> tuple[str, ...]:
    """Return what earlier runs made, is still there, and belongs to nothing in the site."""
    left = set()
    for name in folder.records.keys() - folder.states.keys():
        file, _, user = name.partition(" ") if name.startswith(f"{BROKER}/") else (name, "", "")
        machine = name.removeprefix(f"{MACHINES}/").partition("/")[0]
        if user:
            there = folder.wanted.get(file, Wanted(folder.there(file) or b"")).content.decode()
            if re.search(rf"^(user )?{re.escape(user)}\b", there, re.MULTILINE):
                left.add(f"{file}, user {user}")
        elif (folder.path / name).exists():
            is_removed = name.startswith(f"{MACHINES}/{machine}/") and machine not in machines
            left.add(f"{MACHINES}/{machine}" if is_removed else name)
    return tuple(sorted(left))


def _json(data: Any) -> bytes:
    return (json.dumps(data, indent=2, ensure_ascii=False) + "\n").encode()


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
