"""Whether a tables folder is still the folder that held the tables.

If a share is not mounted, its mount point is an empty folder. That does not mean that the tables were
removed. The compiled plan stores the folder's identity, so that a supervisor that starts without the share
knows it too.
"""

import os
from pathlib import Path

from gateway.config.load import Loaded
from gateway.state.plan import CompiledPlan, TablesFolder
from gateway.tabfile import TableState


def is_folder_of(loaded: Loaded, before: CompiledPlan | None) -> bool:
    """Whether the configuration names the tables folder that the plan before was compiled from.

    A plan that has no folder, or one by a path that depended on where its program ran, does not tell: its
    names count.
    """
    folder = None if before is None else before.tables_folder
    if folder is None or not Path(folder.path).is_absolute():
        return True
    now = TablesFolder.at(loaded.tables_folder)
    if now is not None and (now.device, now.inode) == (folder.device, folder.inode):
        return True
    return os.path.abspath(loaded.tables_folder) == folder.path  # noqa: PTH100 - ".." goes too


def what_is_strange(loaded: Loaded, before: TablesFolder | None) -> str:
    """Return what is wrong with a folder that was just searched for tables; "" if nothing is.

    It is wrong if every table is missing and the folder at this path is not the previous one.
    """
    now = TablesFolder.at(loaded.tables_folder)
    if now is None or before is None or now == before:
        return ""
    if Path(before.path).is_absolute() and now.path != before.path:
        return ""
    if {reading.state for reading in loaded.readings.values()} != {TableState.MISSING}:
        return ""
    return (
        f"mount the share, or put the tables into {now.path}: it is not the folder that had them, and "
        "holds none of them. To continue without them, restart the gateway"
    )
