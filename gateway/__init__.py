"""pitch-gateway: leadscrew error compensation, connected into the Modbus cable.

``docs/architecture.md`` has the layers and their rules; import-linter checks them.
"""

__version__ = "1.0.0"
