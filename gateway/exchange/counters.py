"""Counters of one line."""

from dataclasses import dataclass, field

from gateway.modbus.pdu import is_exception


@dataclass(slots=True)
class LineCounters:
    """Numbers since the start. ``status.line`` has a field of the same name with its meaning for users."""

    exchanges: int = 0
    timeouts: int = 0
    exceptions: int = 0
    late: int = 0
    """Frames or bytes that came when nothing was expected any more."""
    late_targets: int = 0
    """Targets and triggers that waited longer than their axis's deadline."""
    refused: int = 0
    refused_by: dict[str, int] = field(default_factory=dict)
    """The same, by the name of the controller."""
    backed_off: int = 0
    """Requests answered immediately, because their drive had left three in a row unanswered."""
    too_late: int = 0
    """Requests answered immediately, because they could only have been sent too late behind a silence."""
    withdrawn: int = 0
    broadcasts: int = 0
    added_reads: int = 0
    restaged: int = 0
    """Staged targets that were written again."""
    unknown_modes: int = 0
    """Frames with a meaning that the register map does not know: they passed unchanged."""
    unmapped_reads: int = 0
    """Reads of positions that are not mapped: they pass unchanged."""
    oversized: int = 0
    """Replies that are longer than a frame may be."""
    internal_faults: int = 0
    """Events that are impossible in the state of their axis or transaction: bugs of the gateway."""

    def count_reply(self, reply: bytes) -> None:
        """Count a transaction that a drive answered."""
        self.exchanges += 1
        self.exceptions += is_exception(reply)

    def count_refusal(self, controller: str | None) -> None:
        """Count a request that the gateway refused to a controller."""
        self.refused += 1
        if controller is not None:
            self.refused_by[controller] = self.refused_by.get(controller, 0) + 1
