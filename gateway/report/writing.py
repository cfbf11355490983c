"""A report as a file: HTML, PNG or SVG by its suffix, written whole or not at all."""

import os
import secrets
import stat
from contextlib import suppress
from pathlib import Path
from typing import Final

from gateway.files import kind_of
from gateway.report.errors import ReportError
from gateway.report.findings import find
from gateway.report.story import Report

SUFFIXES: Final = (".html", ".png", ".svg")


def write_report(report: Report, path: Path, *, force: bool = False) -> None:
    """Write a report; an existing file is replaced only with ``force``.

    Call :func:`check_place` first where the work that leads to the report is long.

    Raises:
        ReportError: another suffix, a report without content, a file of this name, or no place to write to.
    """
    check_place(path, force=force)
    place(path, render(report, path.suffix.lower()), force=force)


def render(report: Report, suffix: str) -> bytes:
    """Return the content of a report file with this suffix, one of :data:`SUFFIXES`.

    The same report makes the same bytes.

    Raises:
        ReportError: there is nothing to show, or readings that cannot be evaluated.
    """
    if not report.axes:
        raise ReportError("a report of no axis: there is nothing to show")
    found = [find(story) for story in report.axes]
    if suffix == ".html":
        from gateway.report.html import html_page

        return html_page(report, found).encode()
    from gateway.report.page import draw_page

    return draw_page(report, found, suffix.removeprefix("."))


def check_place(path: Path, *, force: bool) -> None:
    """Check what can be known of the place before the work.

    Raises:
        ReportError: another suffix, a file of this name, no such folder.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ReportError(f"{path}: a report is written as {', '.join(SUFFIXES)}: choose by the suffix")
    try:
        found = path.stat()
    except FileNotFoundError:
        if not path.parent.is_dir():
            raise ReportError(f"{path}: there is no folder {path.parent}: make it first") from None
        return
    except OSError as error:
        raise ReportError(f"{path}: {error.strerror or error}; give a place to write to") from None
    if not stat.S_ISREG(found.st_mode):
        raise ReportError(f"{path}: {kind_of(found.st_mode)}; give a regular file, or a new name")
    if not force:
        raise ReportError(f"{path}: a file of this name; give a new name, or --force")


def place(path: Path, content: bytes, *, force: bool) -> None:
    """Put a file into its place in one step; a link is followed, a replaced file keeps its mode.

    Raises:
        ReportError: a file of this name and no ``force``, or the place cannot be written to.
    """
    try:
        _put(Path(os.path.realpath(path)), content, force=force)
    except FileExistsError:
        raise ReportError(f"{path}: a file of this name; give a new name, or --force") from None
    except OSError as error:
        raise ReportError(f"{path}: {error.strerror or error}; give a place to write to") from None


def _put(path: Path, content: bytes, *, force: bool) -> None:
    beside = path.with_name(f".pitch-gateway-{secrets.token_hex(8)}")
    try:
        with beside.open("xb") as stream:
            if force:
                with suppress(OSError):  # a new file, or a file system without modes
                    os.fchmod(stream.fileno(), stat.S_IMODE(path.stat().st_mode))
            stream.write(content)
        if force:
            beside.replace(path)
        else:
            # A link, unlike a rename, does not replace what somebody has put there meanwhile.
            path.hardlink_to(beside)
    finally:
        beside.unlink(missing_ok=True)
