"""Errors of the Modbus layer, by cause."""


class ProtocolError(Exception):
    """Base of everything that this layer raises on purpose; anything else is a bug of ours.

    Decoders never raise: what arrives from a wire is counted and dropped, not an error of the program.
    """


class FrameError(ProtocolError):
    """A frame that cannot be built, or a decoder that cannot be set up."""


class RegisterError(ProtocolError):
    """Base of the errors of register fields."""


class RegisterFieldError(RegisterError):
    """The description of a field is impossible: an address, a bit or a scale out of range."""


class RegisterRangeError(RegisterError):
    """A value that a field cannot hold. Nothing is ever wrapped or clamped."""


class RegisterDataError(RegisterError):
    """Fewer bytes than the field is long."""
