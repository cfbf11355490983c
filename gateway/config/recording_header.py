"""The part of a configuration that a recording contains."""

from datetime import UTC, datetime
from typing import Final

import gateway
from gateway.config.load import Loaded
from gateway.recording.traffic import FORMAT, Header

ANY_BYTES: Final = "iso-8859-1"
"""Each byte is one character, so that a file is restored exactly, whatever its encoding."""


def header_of(loaded: Loaded, form: int = FORMAT) -> Header:
    """Return the header of a recording, with all files that the configuration was read from.

    Raises:
        OSError: a file can no longer be read.
    """
    own = loaded.path.read_bytes().decode("utf-8")
    paths = {table.path for table in loaded.tables.values()}
    paths |= {table.path for crosses in loaded.crosses.values() for table in crosses}
    profiles = sorted({drive.name for drive in loaded.drives.values() if not drive.is_shipped})
    return Header(
        format=form,
        gateway_version=gateway.__version__,
        started=datetime.now(UTC).isoformat(timespec="milliseconds"),
        config_name=loaded.path.name,
        config=loaded.document.text if loaded.document.parts else own,
        tables={path.name: path.read_bytes().decode(ANY_BYTES) for path in sorted(paths)},
        files={name: (loaded.path.parent / name).read_bytes().decode(ANY_BYTES) for name in profiles},
    )
