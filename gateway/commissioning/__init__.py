"""Commissioning an axis: probing, listening, measuring, the sign test, the demonstration.

Programs call these functions (docs/library.md); the commands of ``pitch-gateway`` call them and show the
results.
"""
