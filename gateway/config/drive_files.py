"""From the ``drive`` of an axis to its registers: a shipped profile by name, or the user's own file."""

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from pydantic import ValidationError

from gateway.config.axis_model import AxisSection
from gateway.config.findings import Findings, explain, read_document
from gateway.config.problems import ConfigErrors
from gateway.config.sections import Sections
from gateway.drives import library
from gateway.drives.profile import Profile, faults


@dataclass(frozen=True, slots=True)
class NamedProfile:
    """A profile, with its name in the configuration."""

    name: str
    profile: Profile

    @property
    def is_shipped(self) -> bool:
        """Whether the gateway includes it."""
        return library.is_name(self.name)


def fit_drives(findings: Findings, sections: Sections, folder: Path) -> Mapping[str, NamedProfile]:
    """Set the registers of every axis that names a drive; problems go to ``findings``.

    From here on ``axis.registers`` are the registers in force, whatever their source.
    """
    named: dict[str, NamedProfile] = {}
    for axes in (sections.axes, sections.partial_axes):
        for name, axis in axes.items():
            if axis.drive is None:
                continue
            profile = _profile_of(findings, name, axis, axis.drive, folder)
            if profile is None or axis.registers is not None:
                continue
            named[name] = NamedProfile(axis.drive, profile)
            axes[name] = axis.model_copy(update={"registers": profile.registers})
            findings.stand_on_line_of(("axis", name, "registers"), ("axis", name, "drive"))
    return named


def _profile_of(findings: Findings, name: str, axis: AxisSection, drive: str, folder: Path) -> Profile | None:
    if axis.registers is not None:
        shown = drive if library.is_name(drive) else "NAME"
        findings.refuse(
            ("axis", name, "registers"),
            f'registers beside drive = "{drive}"',
            f"keep one of the two; to change a profile copy it (pitch-gateway drives show {shown} --toml "
            '> my-drive.toml) and write drive = "./my-drive.toml"',
        )
    if not library.is_name(drive):
        return _read_file(findings, name, folder / drive)
    if drive in library.names():
        return library.shipped(drive)
    findings.refuse(("axis", name, "drive"), f'there is no profile "{drive}"', near_names(drive))
    return None


def near_names(drive: str) -> str:
    """Return the likely intended names; a maker's name alone is enough."""
    names = library.names()
    near = [name for name in names if drive.lower() in name] or get_close_matches(
        drive.lower(), names, n=3, cutoff=0.5
    )
    meant = f"did you mean {' or '.join(near[:3])}? " if near else ""
    return (
        f'{meant}`pitch-gateway drives` lists them all; write the path of your own file as "./my-drive.toml"'
    )


def _read_file(findings: Findings, name: str, path: Path) -> Profile | None:
    key = ("axis", name, "drive")
    try:
        return read_profile(path)
    except ConfigErrors as errors:
        for problem in errors.problems:
            if problem.is_of_whole_file:
                findings.refuse(key, f"{problem.file}: {problem.found}", problem.remedy)
            else:
                findings.refuse_elsewhere(key, problem)
    return None


def read_profile(path: Path) -> Profile:
    """Read and check the user's own profile.

    Raises:
        ConfigErrors: everything that is wrong with it, with file, line and key.
    """
    findings = Findings(read_document(path, "a drive profile"))
    raw = dict(findings.document.tables)
    try:
        profile = Profile.model_validate(raw)
    except ValidationError as error:
        explain(findings, Profile, raw, (), error)
        findings.raise_if_any()
        raise
    for fault in faults(profile):
        findings.refuse(fault.path, fault.found, fault.remedy)
    findings.raise_if_any()
    return profile
