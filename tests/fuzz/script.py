"""Bytes of a fuzzer as instructions: where they end, so does what they say."""


class Script:
    """Takes bytes from the front. Behind the end there are zeros, and nothing to take."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def is_over(self) -> bool:
        return self._at >= len(self._data)

    def byte(self) -> int:
        self._at += 1
        return self._data[self._at - 1] if self._at <= len(self._data) else 0

    def text(self) -> bytes:
        """Return as many bytes as the next one says, or what there still is."""
        size = self.byte()
        taken = self._data[self._at : self._at + size]
        self._at += size
        return taken

    def rest(self) -> bytes:
        taken = self._data[self._at :]
        self._at = len(self._data)
        return taken


def said(text: bytes) -> bytes:
    """Write what :meth:`Script.text` takes; at most 255 bytes."""
    return bytes((len(text),)) + text
