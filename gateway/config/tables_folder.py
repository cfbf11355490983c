"""Whether an empty tables folder is still the folder that held the tables.

If a share is not mounted, its mount point is an empty folder. That does not mean that the tables were
removed. The compiled plan stores the folder's identity, so that a supervisor that starts without the share
knows it too.
"""

from gateway.config.load import Loaded
from gateway.state.plan import TablesFolder
from gateway.tabfile import TableState


def what_is_strange(loaded: Loaded, before: TablesFolder | None) -> str:
    """Return what is wrong with a folder that was just searched for tables; "" if nothing is.

    It is wrong if every table is missing and the folder at this path is not the previous one.
    """
    now = TablesFolder.at(loaded.tables_folder)
    if now is None or before is None or now == before or now.path != before.path:
        return ""
    if {reading.state for reading in loaded.readings.values()} != {TableState.MISSING}:
        return ""
    return (
        f"mount the share, or put the tables into {now.path}: it is not the folder that had them, and "
        "holds none of them. To continue without them, restart the gateway"
    )
