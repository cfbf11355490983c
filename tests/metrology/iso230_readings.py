"""Raw readings of published ISO 230-2 reports, mm.

The reports were printed by a program of the European Spallation Source (ecmc, public repositories of its
author and of the Paul Scherrer Institute); each has five runs in each direction. In ``iso230_readings.txt``
the name of a report comes first, then a line for each target: ``TARGET; FORWARD …; BACKWARD …``.
"""

from pathlib import Path

Ways = dict[str, dict[float, list[float]]]


def _reports() -> dict[str, Ways]:
    reports: dict[str, Ways] = {}
    for line in Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").splitlines():
        target, *ways = line.split("; ")
        if not ways:
            report = reports[line] = {"forward": {}, "backward": {}}
            continue
        for way, readings in zip(report, ways, strict=True):
            report[way][float(target)] = [float(reading) for reading in readings.split()]
    return reports


REPORTS = _reports()
