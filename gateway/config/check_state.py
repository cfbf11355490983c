"""Whether the gateway can have its state folder, and its socket in it."""

import os
from pathlib import Path
from typing import Final

from gateway.config.findings import Findings
from gateway.ipc.place import ROOT_UID, why_too_long
from gateway.state.folder import why_no_folder, why_open_to_others

KEY: Final = ("gateway", "state")


def check_state(findings: Findings, folder: Path) -> None:
    """Refuse a folder that no gateway can start with; warn of one that others may write to."""
    if findings.is_refused(KEY):
        return
    problem = why_too_long(folder) or why_no_folder(folder)
    if problem is not None:
        findings.refuse(KEY, problem.found, problem.remedy)
        return
    # Root often checks what another user will run, whose folder it is then.
    uid = os.geteuid()
    warning = why_open_to_others(folder, None if uid == ROOT_UID else frozenset((uid, ROOT_UID)))
    if warning is not None:
        findings.warn(KEY, warning.found, warning.remedy)
