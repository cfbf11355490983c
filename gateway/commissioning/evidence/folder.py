"""The folder for an auditor: what is in it, made in memory, and written whole or not at all."""

import contextlib
import hashlib
import json
import os
import platform
import re
import shutil
import tempfile
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import distributions
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

from gateway import __version__
from gateway.clock import now_utc
from gateway.commissioning.evidence.inventory import add_records, by_name, sbom, serial_number, vex
from gateway.commissioning.evidence.requirements import as_csv, as_markdown, counts
from gateway.config.findings import Document
from gateway.config.load import Loaded
from gateway.config.resolved import written_secrets
from gateway.config.settings_of import settings_of
from gateway.config.signatures import SUFFIX, SignatureRefusedError, signature_path, signer_of
from gateway.config.toml import STRING
from gateway.files import FileRefusedError, read_regular_file, write_file
from gateway.plain import Json, JsonObject
from gateway.report.axis_data import Report, axis_data_of
from gateway.report.errors import ReportError
from gateway.report.writing import render
from gateway.state.interventions import FOLDER_NAME, read_journal
from gateway.tabfile import LoadedTable

ANSWERS: Final[Mapping[str, str]] = {
    "sbom.cdx.json": "what is installed (CycloneDX 1.6): versions, licences, digests, who needs whom",
    "vex.cdx.json": "known holes that the project has judged (CycloneDX 1.6, VEX)",
    "iec-62443-4-2.md": "each requirement of IEC 62443-4-2 for components: met or not, why, and the test",
    "iec-62443-4-2.csv": "the same for a spreadsheet",
    "limits.md": "what the gateway is not: no safety function, and no bypass by itself",
    "substantial-modification.md": "a form with the questions of Regulation (EU) 2023/1230, Article 3(16)",
    "journal.jsonl": "who changed what (`pitch-gateway journal verify journal.jsonl`)",
    "configuration.toml": "the configuration without comments and secrets",
    "allowed_signers": "who may sign tables",
}
INDEX, MANIFEST = "INDEX.md", "manifest.sha256"
LARGEST_FILE: Final = 16 * 1024 * 1024
"""Bytes: of a table or a drive."""
NOT_FILLED_IN: Final = "not filled in"
TAKEN_OUT: Final = '"taken out: names no file"'
UNFILLED: Final = ".invalid"
"""A name that ends so resolves to nothing (RFC 2606): the marker of .github/OWNER.md."""


class EvidenceError(Exception):
    """The folder cannot be made; one sentence with the remedy."""


@dataclass(slots=True)
class Evidence:
    """Content of the folder by path, and what a reader must know of it."""

    files: dict[str, bytes] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    """Parts that are missing or not whole."""
    notes: list[str] = field(default_factory=list)

    def as_data(self) -> JsonObject:
        """Return what is in it as plain data."""
        listed: list[Json] = [
            {"name": name, "bytes": len(content), "sha256": _sha256(content)}
            for name, content in sorted(self.files.items())
        ]
        return {"files": listed, "problems": list(self.problems), "notes": list(self.notes)}


def gather(loaded: Loaded, say: Callable[[str], None]) -> Evidence:
    """Return everything that goes into the folder; ``say`` gets a line for each step.

    Raises:
        EvidenceError: the journal or a file of the configuration cannot be read.
    """
    made = Evidence()
    document = loaded.document
    facts = {"name": loaded.sections.gateway.name, "version": __version__, "digest": document.sha256}
    say("journal of interventions")
    journal = _journal(made, loaded.state_folder / FOLDER_NAME)
    say("what is installed")
    _add_inventory(made)
    say("IEC 62443-4-2")
    _add(made, "iec-62443-4-2.md", as_markdown(document.tables, __version__))
    _add(made, "iec-62443-4-2.csv", as_csv(document.tables))
    axes = _axes(loaded)
    corrections = "\n".join(f"| {axis} | {largest} |" for axis, _, _, largest, _ in axes)
    _add(made, "limits.md", _filled("limits.md", {**facts, "corrections": corrections}))
    rows = "\n".join(f"| {' | '.join(row)} |" for row in axes)
    _add(made, "substantial-modification.md", _filled("substantial-modification.md", {**facts, "axes": rows}))
    _add(made, "configuration.toml", without_secrets(document))
    made.notes += [f"warning: {each}" for each in loaded.warnings]
    for name, reading in loaded.readings.items():
        say(f"table {reading.path.name}")
        _add_table(made, reading.path, None if reading.table is None else reading.table.source, name)
        made.problems += [f"axis {name}: {each}" for each in reading.problems]
        made.notes += [f"warning: {each}" for each in reading.findings.warnings]
    for cross in (each for crosses in loaded.crosses.values() for each in crosses):
        made.files[f"tables/{cross.path.name}"] = _read(cross.path)
    if (allowed := loaded.sections.gateway.allowed_signers) is not None:
        _add_signatures(made, loaded, loaded.path.parent / allowed)
    for drive in {each.name for each in loaded.drives.values() if not each.is_shipped}:
        made.files[f"drives/{drive.removeprefix('./').replace('/', '_')}"] = _read(loaded.path.parent / drive)
    _add(made, INDEX, _index(made, loaded, journal))
    manifest = (f"{_sha256(content)}  {path}\n" for path, content in sorted(made.files.items()))
    _add(made, MANIFEST, "".join(manifest))
    return made


def check_folder(folder: Path) -> None:
    """Check before the work that a folder can be made.

    Raises:
        EvidenceError: it has something in it, or is no folder, or there is none around it.
    """
    try:
        if any(folder.iterdir()):
            raise EvidenceError(f"{folder}: the folder is not empty; name a new one, or empty it")
    except FileNotFoundError:
        has_parent = True  # else what is written says why it cannot be
        with contextlib.suppress(PermissionError):
            has_parent = folder.absolute().parent.is_dir()
        if not has_parent:
            raise EvidenceError(f"{folder}: make the folder {folder.parent} first: there is none") from None
    except NotADirectoryError:
        raise EvidenceError(f"{folder}: this is no folder; name a new one") from None
    except OSError as error:
        raise EvidenceError(f"{folder}: {error.strerror or error}; name a folder of your own") from None


def write(made: Evidence, folder: Path) -> None:
    """Write the folder, whole or not at all; only this user may read it.

    Raises:
        EvidenceError: it cannot be written.
    """
    folder = folder.absolute()
    beside = None
    try:
        beside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
        for name, content in made.files.items():
            path = beside / name
            path.parent.mkdir(mode=0o700, exist_ok=True)
            write_file(path, content, force=False, is_secret=True)
        beside.rename(folder)  # also over an empty folder, and over no other (rename(2))
    except OSError as error:
        raise EvidenceError(f"{folder}: {error.strerror or error}; name a new folder of your own") from None
    finally:
        if beside is not None:
            shutil.rmtree(beside, ignore_errors=True)


def without_secrets(document: Document) -> str:
    """Return the text of a configuration without comments.

    A key for the file of a secret keeps its value only if there is such a file, or it is a credential: a
    person may have written the secret itself.
    """
    secrets = written_secrets(document.tables, document.path.parent)

    def kept(found: re.Match[str]) -> str:
        if found[0].startswith("#"):
            return ""
        is_secret = tomllib.loads(f"text = {found[0]}")["text"] in secrets
        return TAKEN_OUT if is_secret else found[0]

    text = re.sub(rf"{STRING.pattern}|\#[^\n]*", kept, document.text, flags=STRING.flags)
    lines = (line.rstrip() for line in text.splitlines())
    return re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip() + "\n"


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _add(made: Evidence, name: str, text: str) -> None:
    made.files[name] = text.encode()


def _add_json(made: Evidence, name: str, data: Any) -> None:
    _add(made, name, json.dumps(data, indent=2, ensure_ascii=False) + "\n")


def _read(path: Path) -> bytes:
    try:
        return read_regular_file(path, LARGEST_FILE, "a file of the configuration")
    except FileRefusedError as error:
        raise EvidenceError(f"{path}: {error}") from None


def _filled(template: str, facts: Mapping[str, str]) -> str:
    return (files(__package__) / template).read_text(encoding="utf-8").format_map(facts)


def _add_inventory(made: Evidence) -> None:
    packages = by_name(distributions())
    bom = sbom(packages, __version__)
    made.notes += add_records(bom, packages)
    bom["serialNumber"] = serial_number(json.dumps(bom))
    bom["metadata"]["timestamp"] = now_utc().isoformat(timespec="seconds")
    _add_json(made, "sbom.cdx.json", bom)
    _add_json(made, "vex.cdx.json", vex(bom, packages))


def _axes(loaded: Loaded) -> list[tuple[str, str, str, str, str]]:
    """Return name, travel, mode of the correction, and its limits, of each axis."""
    found = []
    for name, axis in loaded.sections.axes.items():
        units, settings = axis.units.value, settings_of(axis)
        travel = "endless" if axis.travel is None else f"{axis.travel[0]:g} to {axis.travel[1]:g} {units}"
        largest = f"{settings.max_correction:g} {units}"
        found.append((name, travel, axis.compensation.value, largest, f"{axis.max_slope:g}"))
    return found


def _journal(made: Evidence, folder: Path) -> list[str]:
    """Add the journal; return what a check of it found, in words."""
    try:
        verification, _, content = read_journal(folder)
    except FileNotFoundError:
        made.notes.append(f"{folder}: there is no journal; the supervisor begins one when it first runs")
        return ["none"]
    except OSError as error:
        why = f"{error.filename or folder}: {error.strerror or error}"
        raise EvidenceError(f"{why}; run this as the gateway's user or as root") from None
    made.files["journal.jsonl"] = content
    made.notes += [f"journal: {note}" for note in verification.notes]
    made.problems += [f"journal: {problem}" for problem in verification.problems]
    return [*verification.lines(), *(["not whole: see above"] if verification.problems else [])]


def _add_table(made: Evidence, path: Path, table: LoadedTable | None, axis: str) -> None:
    with contextlib.suppress(EvidenceError):  # the problem of its reading says so
        made.files[f"tables/{path.name}"] = _read(path)
    if table is None:
        return
    report = Report(f"Correction table {path.name}", (axis_data_of(table, axis),), "")
    try:
        made.files[f"tables/{axis}-{path.name}.html"] = render(report, ".html")
    except ReportError as error:
        made.notes.append(f"{path.name}: no report ({error})")


def _add_signatures(made: Evidence, loaded: Loaded, allowed: Path) -> None:
    """Add what proves who signed the tables, and whether it does."""
    made.files["allowed_signers"] = _read(allowed)
    paths = {reading.path for reading in loaded.readings.values() if reading.table is not None}
    paths |= {cross.path for crosses in loaded.crosses.values() for cross in crosses}
    for path in sorted(paths):
        try:
            signer = signer_of(path, _read(path), allowed)
            made.files[f"tables/{signature_path(path).name}"] = _read(signature_path(path))
            made.notes.append(f"{path.name}: signed by {signer}")
        except SignatureRefusedError as error:
            made.problems.append(f"{path}: {error}")


def _index(made: Evidence, loaded: Loaded, journal: list[str]) -> str:
    owner = tomllib.loads((files(__package__) / "owner.toml").read_text(encoding="utf-8"))
    filled = {key: NOT_FILLED_IN if text.endswith(UNFILLED) else text for key, text in owner.items()}
    system = os.uname()
    about = {
        "gateway": loaded.sections.gateway.name,
        "made": now_utc().isoformat(timespec="seconds"),
        "on the computer": system.nodename,
        "pitch-gateway": __version__,
        "Python, system": f"{platform.python_version()}, {system.sysname} {system.release} {system.machine}",
        "configuration": f"`{loaded.path.absolute()}`, SHA-256 `{loaded.document.sha256}`",
        "IEC 62443-4-2": "; ".join(f"{n} {each}" for each, n in counts(loaded.document.tables).items()),
        "support until": filled["support_until"],
        "answers within 24 hours": filled["answers_within_24_hours"],
    }
    if included := loaded.document.parts[:-1]:
        files_of = (f"`{part.path.absolute()}`, SHA-256 `{part.sha256}`" for part in included)
        about["included files"] = "; ".join(files_of)
    parts = {
        "about": (f"| {key} | {value} |" for key, value in about.items()),
        "found": (f"- {each}" for each in (*made.problems, *made.notes) or ("nothing",)),
        "listed": (
            f"| `{name}` | {ANSWERS.get(name) or _answer(name)} | `{_sha256(content)}` |"
            for name, content in sorted(made.files.items())
        ),
        "journal": (f"- {line}" for line in journal),
    }
    return _filled(
        "index.md", {"name": about["gateway"], **{key: "\n".join(each) for key, each in parts.items()}}
    )


def _answer(name: str) -> str:
    if name.startswith("drives/"):
        return "register map of a drive, as the configuration names it"
    if name.endswith(SUFFIX):
        return "signature of a table (`ssh-keygen -Y verify`)"
    return "the table as a report" if name.endswith(".html") else "correction table"
