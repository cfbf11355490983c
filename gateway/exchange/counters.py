"""Counters of one line."""

from dataclasses import dataclass, field

from gateway.modbus.pdu import is_exception


@dataclass(slots=True)
class LineCounters:
    """Numbers since the start. ``status.line`` declares under the same name what each counts for users."""

    exchanges: int = 0
    timeouts: int = 0
    exceptions: int = 0
    late: int = 0
    """Frames or bytes that came when nothing was expected any more."""
    late_targets: int = 0
    """Targets and triggers that waited longer than their axis's deadline."""
    refused: int = 0
    refused_by: dict[str, int] = field(default_factory=dict)
    """The same by the name of the controller."""
    backed_off: int = 0
    """Requests that were answered at once because their drive had left three in a row unanswered."""
    too_late: int = 0
    """Requests that were answered at once because they could only have left too late behind a silence."""
    withdrawn: int = 0
    broadcasts: int = 0
    added_reads: int = 0
    restaged: int = 0
    """Staged targets that were written once more."""
    unknown_modes: int = 0
    """Frames whose meaning the register map does not know: they passed untouched."""
    unmapped_reads: int = 0
    """Reads of positions that are not mapped: they pass as they are."""
    oversized: int = 0
    """Replies that are longer than a frame may be."""
    internal_faults: int = 0
    """Events that cannot be in the state of an axis in which they came: bugs of the gateway."""

    def count_reply(self, reply: bytes) -> None:
        """Count a transaction that a drive answered."""
        self.exchanges += 1
        self.exceptions += is_exception(reply)

    def count_refusal(self, controller: str | None) -> None:
        """Count a request that the gateway refused to a controller."""
        self.refused += 1
        if controller is not None:
            self.refused_by[controller] = self.refused_by.get(controller, 0) + 1
