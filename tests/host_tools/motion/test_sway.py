"""Sway: the sea's spectrum, the ship's answer, and that it repeats itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from rrins.host_tools.motion.errors import MotionError
from rrins.host_tools.motion.sway import RAMP_S, responses, wave_spectrum
from rrins.host_tools.scenario.tables import Body


@pytest.mark.parametrize(("factor", "tolerance"), [(1.0, 1e-3), (3.3, 0.03)])
def test_the_spectrum_has_the_wave_height_and_period_asked_for(factor, tolerance):
    def density(omega):
        return float(wave_spectrum(np.array([omega]), 3.0, 8.0, factor)[0])

    variance = quad(density, 0.1, 20, points=[2 * math.pi / 8], limit=500)[0]
    assert 4 * math.sqrt(variance) == pytest.approx(3.0, rel=tolerance)
    omega = np.linspace(0.2, 3, 20000)
    peak = omega[np.argmax(wave_spectrum(omega, 3.0, 8.0, factor))]
    assert 2 * math.pi / peak == pytest.approx(8.0, rel=1e-3)


def test_long_waves_carry_the_ship_on_their_surface():
    omega = np.array([0.05])
    _, _, heave, roll, pitch, _ = responses(omega, math.radians(180), 11.0)[:, 0]
    slope = 0.05**2 / 9.80665
    assert abs(heave) == pytest.approx(1, abs=0.01)
    assert abs(pitch) == pytest.approx(slope, rel=0.01)
    assert abs(roll) < 1e-6 * slope
    # From astern the stern rises first: where the surface rises ahead, the nose is up.
    assert pitch / (-1j * slope) == pytest.approx(1, abs=0.1)


def test_a_wave_from_the_right_lifts_the_right_side_first():
    roll = responses(np.array([0.05]), math.radians(90), 11.0)[3, 0]
    # It travels left, so before its crest comes the surface is higher on the right: roll to the
    # left, negative, a quarter of a period ahead of the crest.
    before = roll * np.exp(-1j * math.pi / 2)
    assert before.real < 0


def test_the_ship_does_not_roll_in_a_head_sea_nor_pitch_in_a_beam_sea(make):
    ahead = make(kind="sway", wave_from_deg=0, duration_s=300).at(np.arange(200, 400, 0.5))
    abeam = make(kind="sway", wave_from_deg=90, duration_s=300).at(np.arange(200, 400, 0.5))
    assert np.abs(ahead[:, 12]).max() < 1e-9
    assert np.abs(ahead[:, 13]).max() > 0.01
    assert np.abs(abeam[:, 13]).max() < 1e-9
    assert np.abs(abeam[:, 12]).max() > 0.01


def test_it_repeats_itself_exactly(sway):
    begin = sway.loop_from * sway.knot_ns * 1e-9
    assert begin == pytest.approx(RAMP_S, abs=5)
    times = np.arange(begin, begin + 1800, 7.3)
    first, second = sway.at(times), sway.at(times + 3 * 1800)
    assert second == pytest.approx(first, abs=1e-9)
    last, next_ = sway.pieces[-1].sum(axis=1), sway.pieces[sway.loop_from, :, 0]
    assert last == pytest.approx(next_, abs=1e-11)


def test_it_stays_about_its_place_and_heaves_with_the_sea(sway):
    begin = sway.loop_from * sway.knot_ns * 1e-9
    state = sway.at(np.arange(begin, begin + 1800, 0.25))
    assert state[:, 6:8].mean(axis=0) == pytest.approx(np.radians([40.3554, 116.668]), abs=1e-9)
    assert np.degrees(state[:, 12:15].mean(axis=0)) == pytest.approx([1, -1, 30], abs=1e-3)
    assert 1.5 < 4 * state[:, 8].std() < 2.6  # of waves of 2.5 m
    assert 0.5 < np.degrees(state[:, 12].std()) < 6


def test_the_seed_makes_the_phases(make):
    first, same, other = (make(kind="sway", duration_s=60, seed=s).pieces for s in (1, 1, 2))
    assert (first == same).all()
    assert not np.allclose(first, other)


def test_a_sea_that_turns_the_ship_over_is_refused(make):
    with pytest.raises(MotionError, match="60°"):
        make(
            kind="sway",
            wave_height_m=10,
            wave_period_s=11,
            wave_from_deg=90,
            body=Body(roll_deg=50),
        )
