"""A report as a file: HTML, PNG or SVG by its suffix, written completely or not at all."""

import stat
from pathlib import Path
from typing import Final

from gateway.files import FileRefusedError, kind_of, write_file
from gateway.report.axis_data import Report
from gateway.report.errors import ReportError
from gateway.report.findings import find

SUFFIXES: Final = (".html", ".png", ".svg")
MOST_SHEETS: Final = 24
"""Maximum of axes in one PNG or SVG: many programs cannot show a longer picture."""


def write_report(report: Report, path: Path, *, force: bool = False) -> None:
    """Write a report; an existing file is replaced only with ``force``.

    Call :func:`check_path` first if the work for the report takes long.

    Raises:
        ReportError: another suffix, a report without content, an existing file, or a path that is not
            writable.
    """
    check_path(path, force=force)
    put_file(path, render(report, path.suffix.lower()), force=force)


def render(report: Report, suffix: str) -> bytes:
    """Return the content of a report file with this suffix, one of :data:`SUFFIXES`.

    The same report gives the same bytes.

    Raises:
        ReportError: there is nothing to show, or readings cannot be evaluated.
    """
    if not report.axes:
        raise ReportError("no axis: there is nothing to show")
    found = [find(axis_data) for axis_data in report.axes]
    if suffix == ".html":
        from gateway.report.html import html_page

        return html_page(report, found).encode()
    if len(found) > MOST_SHEETS:
        raise ReportError(f"{len(found)} axes: write .html, because one picture shows at most {MOST_SHEETS}")
    from gateway.report.page import draw_page

    return draw_page(report, found, suffix.removeprefix("."))


def check_path(path: Path, *, force: bool) -> None:
    """Check the path before the work, as far as possible.

    Raises:
        ReportError: another suffix, an existing file, no such folder.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ReportError(f"{path}: end the name with {', '.join(SUFFIXES)}, the formats of a report")
    try:
        found = path.stat()
    except FileNotFoundError:
        if not path.parent.is_dir():
            raise ReportError(f"{path}: make the folder {path.parent} first: it does not exist") from None
        return
    except OSError as error:
        raise ReportError(f"{path}: {error.strerror or error}; give a path that can be written") from None
    if not stat.S_ISREG(found.st_mode):
        raise ReportError(f"{path}: {kind_of(found.st_mode)}; give a regular file, or a new name")
    if not force:
        raise ReportError(f"{path}: a file of this name exists; give a new name, or --force")


def put_file(path: Path, content: bytes, *, force: bool) -> None:
    """Put a file into its path in one step, like :func:`gateway.files.write_file`.

    Raises:
        ReportError: the file exists and there is no ``force``, or the path is not writable.
    """
    try:
        write_file(path, content, force=force)
    except FileExistsError:
        raise ReportError(f"{path}: a file of this name exists; give a new name, or --force") from None
    except FileRefusedError as error:
        raise ReportError(f"{path}: {error}") from None
    except OSError as error:
        raise ReportError(f"{path}: {error.strerror or error}; give a path that can be written") from None
