"""Who may not read the journal gets no folder without it."""

from pathlib import Path

import pytest

from gateway.commissioning.evidence.folder import EvidenceError, gather
from gateway.config.load import load
from gateway.state.interventions import Intervention
from tests.support.config import one_axis
from tests.support.config import written as written_config
from tests.support.interventions import written
from tests.support.lesser import nobody


def test_whoever_may_not_read_the_journal_is_told_who_may(tmp_path: Path) -> None:
    config = written_config(tmp_path, one_axis(5020, 5021))
    loaded = load(config)
    (tmp_path / "state").mkdir()
    written(tmp_path / "state" / "interventions", Intervention("gain", "socket", "x", None, 1.0, 0.5))
    (tmp_path / "state" / "interventions").chmod(0)
    denied = pytest.raises(
        EvidenceError, match=r": Permission denied; run this as the gateway's user or as root$"
    )
    with nobody(), denied:
        gather(loaded, lambda step: None)
