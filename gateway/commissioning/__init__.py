"""Putting an axis into operation: probing, listening, measuring, the sign test, the demonstration.

A program calls what is here (docs/library.md); the commands of ``pitch-gateway`` ask for it and show it.
"""
