from __future__ import annotations

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.campaigns.row import Work, rows_of
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.covariance.analysis import analyse
from rrins.host_tools.errors import RehearsalError

G, RADIUS = 9.80, 6.37e6
ENDS = ("position_east_m", "position_north_m")
SCHULER = math.sqrt(G / RADIUS)


def analysis(scenario="ideal", duration_s=600, **keys):
    vary = {key.replace("__", "."): text for key, text in keys.items()}
    definition = load(scenario, Wishes(duration_s=duration_s, vary=vary, runs=1))
    return analyse(definition.scenario, definition.varied())


def standing(**settings):
    """Analyse the ideal sensors at rest on a table that does not turn, facing north."""
    base = {"mode": "strapdown", "rimu.geometry": "orthogonal", "duration_s": 1200.0}
    return analyse(load("ideal", Wishes(set={**base, **settings})).scenario)


def test_an_accelerometer_bias_swings_with_schuler():
    bias = 1e-4 * G
    found = standing(**{"accelerometers.bias_repeatability_ug": 100.0})
    expected = bias / SCHULER**2 * (1 - np.cos(SCHULER * found.times_s))
    assert found.sigma[:, 0] == pytest.approx(expected, abs=0.01 * expected.max())


def test_white_gyro_noise_walks():
    """Velocity error g ∫φ, position error g ∫∫φ: for short times variance g² N² t⁵ / 20."""
    found = standing(**{"gyros.angle_random_walk_deg_per_sqrt_h": 0.005, "duration_s": 200.0})
    N = math.radians(0.005) / 60
    expected = G * N * found.times_s**2.5 / math.sqrt(20)
    assert found.sigma[-1] == pytest.approx([expected[-1]] * 2, rel=0.02)


def test_sources_add_up_and_those_left_out_are_named():
    vary = {"gyros__scale_error_ppm": "normal(0, 50)", "site__height_m": "uniform(0, 10)"}
    found = analysis("rimu_rotating", **vary, gyros__bias_dph="normal(0, 0.1) correlated 0.5")
    squares = sum(one.sigma**2 for one in found.sources)
    assert np.sqrt(squares) == pytest.approx(found.sigma)
    assert sum(found.share(one) for one in found.sources) == pytest.approx(1)
    assert found.left_out == ["site.height_m (varied)"]


def test_constants_of_one_value_are_named_as_such():
    """A table of zeros says why: what is fixed gives a mean error and no σ."""
    arguments = ["covariance", "ideal", "--duration", "100", "--set", "gyros.bias_dph=0.05"]
    result = CliRunner().invoke(rrins, arguments)
    assert result.exit_code == 0, result.output
    assert "fixed, so in the mean error and not in σ: gyros.bias_dph; --vary" in result.output
    (row,) = (line for line in result.output.splitlines() if "mean error of fixed" in line)
    assert any(character in "123456789" for character in row)
    values = json.loads(CliRunner().invoke(rrins, [*arguments, "--json"]).output)
    assert values["fixed"] == ["gyros.bias_dph"]


@pytest.mark.parametrize(
    "key",
    [
        "gyros.bias_dph.2=0.1",
        "gyros.scale_error_ppm.3=50",
        "gyros.asymmetric_scale_error_ppm.1=50",
        "gyros.installation_u_arcsec.4=10",
        "gyros.installation_v_arcsec.2=10",
        "accelerometers.bias_ug.3=100",
        "accelerometers.installation_u_arcsec.3=20",
        "firmware.heading_error_arcsec=60",
        "firmware.roll_error_arcsec=20",
        "turntable.non_orthogonality_arcsec=60",
        "turntable.inner.encoder_offset_deg=0.02",
        "turntable.outer.encoder_offset_deg=-0.01",
        "self-aligned gyros.scale_error_ppm.2=20",
        "self-aligned gyros.asymmetric_scale_error_ppm.3=30",
        "self-aligned gyros.g_sensitivity_dph_per_g.1=1",
        "self-aligned accelerometers.installation_v_arcsec.2=20",
    ],
)
@pytest.mark.slow
def test_each_constant_gives_what_a_run_with_it_gives(key):
    """A run with the error less one without is what the analysis says, in size and sign.

    Of self-aligned units, too, whose table rests until it has found north.
    """
    name, _, size = key.split(" ")[-1].partition("=")
    drawn = {name: f"normal({size}, 1e-9)"}
    place = {"site.latitude_deg": 50.0, "body.heading_deg": 30.0, "redundancy.enabled": False}
    if key.startswith("self-aligned"):
        place["firmware.initial_attitude"] = "self-aligned"
    with_it, without = (
        load("ideal", Wishes(duration_s=300, runs=1, vary=vary, set=place)) for vary in (drawn, {})
    )
    row, ideal = (rows_of(Work.of(one), [0])[0] for one in (with_it, without))
    found = analyse(with_it.scenario, with_it.varied()).mean[-1]
    assert row["status"] == "ok"
    at_end = [row[name] - ideal[name] for name in ENDS]
    assert found == pytest.approx(at_end, rel=0.005, abs=0.005 * np.hypot(*at_end) + 0.002)


@pytest.mark.parametrize(
    ("words", "keys"),
    [
        ("height_channel", {"firmware.height_channel": "free"}),
        ("needs the estimator", {"firmware.initial_attitude": "self-aligned-swaying"}),
    ],
)
def test_what_it_does_not_know_is_refused(words, keys):
    with pytest.raises(RehearsalError, match=words):
        analyse(load("rimu_rotating", Wishes(set=keys)).scenario)


def test_a_warming_bias_is_the_bias_times_the_temperature():
    """Long after warm-up, and aligned while warm, a coefficient is a bias times 20 K."""
    warm = {"thermal.ambient_offset_k": 5.0, "thermal.warm_up_k": 15.0}
    warm |= {"thermal.time_constant_s": 0.01}
    vary = {"accelerometers.bias_temperature_ug_per_k": "normal(0, 5)"}
    base = {"mode": "strapdown", "duration_s": 300.0}
    changing = load("ideal", Wishes(set={**base, **warm}, vary=vary, runs=1))
    constant = load("ideal", Wishes(set=base, vary={"accelerometers.bias_ug": "normal(0, 100)"}))
    one, other = (analyse(each.scenario, each.varied()) for each in (changing, constant))
    assert one.sigma == pytest.approx(other.sigma, rel=1e-9)
    assert "thermal" not in one.left_out


def test_correlated_keys_are_counted():
    """Scale factors and biases that go together: (1 + 2 r + 1) / 2 of what they are alone.

    At rest a gyro's scale factor error is a bias of the Earth's rate along its axis.
    """
    keys = "gyros.bias_dph", "gyros.g_sensitivity_dph_per_g"
    base = {"mode": "strapdown", "rimu.geometry": "orthogonal", "body.heading_deg": 0.0}
    vary = dict.fromkeys((f"{key}.3" for key in keys), "normal(0, 1)")
    parts = {}
    for r in (0.0, 0.8, -0.8):
        correlate = ((f"{keys[0]}.3", f"{keys[1]}.3", r),) if r else ()
        wishes = Wishes(duration_s=600, set=base, vary=vary, correlate=correlate, runs=1)
        definition = load("ideal", wishes)
        found = analyse(definition.scenario, definition.varied())
        parts[r] = found.sigmas[-1] ** 2
        assert sum(found.share(one) for one in found.sources) == pytest.approx(1.0)
    bias, sensitive = (one.variance[-1] for one in found.sources if "correl" not in one.name)
    for r in (0.8, -0.8):
        expected = bias + sensitive + 2.0 * r * np.sqrt(bias * sensitive)
        assert parts[r] == pytest.approx(expected, rel=1e-6, abs=1e-20)
