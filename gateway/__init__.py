"""pitch-gateway: leadscrew error compensation spliced into the Modbus cable.

Layers and their rules are in ``docs/architecture.md``; import-linter checks them.
"""

__version__ = "1.0.0"
