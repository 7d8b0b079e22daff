"""Keys and columns in words."""

from __future__ import annotations

import pytest

from rrins.host_tools.campaigns.labels import label_of, words_of


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("gyros.bias_dph.2", "gyro 2 bias / (°/h)"),
        ("accelerometers.installation_v_arcsec", "accelerometer installation error δv / ″"),
        ("firmware.heading_error_arcsec", "heading error / ″"),
        ("faults.1.at_s", "fault 1 at / s"),
        ("gyros.angle_random_walk_deg_per_sqrt_h", "gyro angle random walk / (°/√h)"),
        ("horizontal_error_m", "horizontal error / m"),
        ("position_east_m", "position error, east / m"),
        ("max_horizontal_error_m", "largest horizontal error / m"),
        ("noise, power-up, not linear", "noise, power-up, not linear"),
        ("mode", "mode"),
        ("gyros.bias (varied)", "gyro bias (varied)"),
    ],
)
def test_a_key_has_words_and_a_unit(name: str, label: str) -> None:
    assert label_of(name) == label
    assert label.startswith(words_of(name))
    assert "_" not in label
