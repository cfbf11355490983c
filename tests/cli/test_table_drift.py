"""``pitch-gateway table drift``: a place that is read for hours."""

from pathlib import Path

import pytest

from tests.support.table_commands import good, refused, run

# 0, 6, 12, 15, 16, 16 µm, half an hour apart; a kelvin makes 4 µm.
ROWS = ((0, 0, 20.0), (30, 6, 21.5), (60, 12, 23.0), (90, 15, 23.75), (120, 16, 24.0), (150, 16, 24.0))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "warm.csv"
    lines = [f"{minutes},{um},{warm}" for minutes, um, warm in ROWS]
    path.write_text("\n".join(["# machine: mill 7", "time_min,measured_um,temperature_c", *lines]))
    return path


def test_range_largest_hour_last_rate_and_what_a_kelvin_makes(file: Path) -> None:
    data = good("drift", file)
    assert data["minutes"] == 150
    assert data["range_um"] == pytest.approx(16)
    # From 0 to 60 min it moves by 12 µm; by 9 in the hour after the first half.
    assert data["largest_hour_um"] == pytest.approx(12)
    assert data["largest_hour_from_min"] == 0
    # The last hour has 15, 16, 16: the line through them rises by 0.5 in half an hour.
    assert data["last_hour_um_per_h"] == pytest.approx(1.0)
    assert data["um_per_kelvin"] == pytest.approx(4.0)
    assert data["explained"] == pytest.approx(1.0)
    said = run("drift", file).stdout
    assert "range over the test: 16.00 µm" in said
    assert "largest change within an hour: 12.00 µm, from minute 0 on" in said
    assert "rate in the last hour: +1.00 µm/h" in said
    assert "each kelvin changes it by +4.00 µm; this explains 100% of the drift" in said


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("time_min", "time_s", "time_min: minutes"),
        ("measured_um", "measured", "no unit in the heading"),
        ("time_min,", "clock,", "no time in the heading"),
        ("60,12", "20,12", "csv:5: time 20 after 30; allowed: times that ascend"),
        ("90,15", "90,x", "csv:6: measured"),
        ("\n30,6,21.5\n60,12,23.0\n90,15,23.75\n120,16,24.0", "", "2 reading(s); allowed: at least 3"),
    ],
)
def test_what_is_no_drift_test_is_refused_with_its_line(
    file: Path, before: str, after: str, words: str
) -> None:
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after))
    assert words in refused("drift", file)
