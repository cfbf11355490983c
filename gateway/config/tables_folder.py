"""The folder in which the tables were: whether an empty one in its place is still that folder.

A share that is not mounted leaves the folder that it is mounted on, empty. That is no sign that somebody took
the tables away. The compiled plan remembers the folder: a supervisor that is started while the share is away
has to know it too.
"""

from gateway.config.load import Loaded
from gateway.state.plan import TablesFolder
from gateway.tabfile import TableState


def what_is_strange(loaded: Loaded, before: TablesFolder | None) -> str:
    """Return what is wrong with a folder whose tables were just looked for; "" when nothing is.

    It is strange that every table is missing and the folder at this path is another one than before.
    """
    now = TablesFolder.at(loaded.tables_folder)
    if now is None or before is None or now == before or now.path != before.path:
        return ""
    if {reading.state for reading in loaded.readings.values()} != {TableState.MISSING}:
        return ""
    return (
        f"{now.path} holds none of the tables and is not the folder that held them (a share that is not "
        "mounted?): mount it, or put the tables there; to go on without them restart the gateway"
    )
