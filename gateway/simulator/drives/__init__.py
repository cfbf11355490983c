"""Drives of known makes, as their manuals describe them: one file for a register map, and one table of all.

They are witnesses: nothing in here reads a register map of the gateway, so that a wrong one is found out.
"""
