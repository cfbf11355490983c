"""The folder for an auditor: ``pitch-gateway evidence`` (docs/evidence.md)."""
