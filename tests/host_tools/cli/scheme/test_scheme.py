"""`rrins scheme` as a user meets it."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins

TURNS = """
turn_rate_dps = 4
stand_s = 5
[[turns]]
axis = "inner"
angle_deg = 180
[[turns]]
axis = "inner"
angle_deg = -180
"""


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")

    def runner(*arguments, status=0):
        result = CliRunner().invoke(rrins, ["scheme", *arguments], prog_name="rrins")
        assert result.exit_code == status, result.output
        return result.stdout if status == 0 else result.stderr

    return runner


@pytest.fixture
def write(tmp_path):
    def writer(name, text):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return name

    return writer


def test_the_built_in_schemes_are_listed(run):
    listed = [line.split()[0] for line in run("list").splitlines()]
    assert {"16-position", "8-position", "4-position", "single-axis-4-position"} <= set(listed)
    assert len(json.loads(run("list", "--json"))["schemes"]) == len(listed)


@pytest.mark.slow
@pytest.mark.parametrize("geometry", ["tetrahedron", "dodecahedron", "cone"])
def test_analyse_says_what_section_4_2_says(run, geometry):
    result = json.loads(run("analyse", "16-position", "--rimu", geometry, "--json"))
    for row in result["rows"]:
        may_stay = (
            row["sensor_kind"] == "accelerometer"
            and row["error"] in ("MESSF", "MEIE")
            and row["axis"] == "z"
        )
        assert row["vanishes"] or may_stay
        assert may_stay or row["residual_ratio"] < 1e-9
        assert row["residual"] == pytest.approx(row["closed_form"], rel=1e-9, abs=1e-15)
    assert any(not row["vanishes"] for row in result["rows"])
    assert result["scheme"]["cycle_s"] == 1600


@pytest.mark.pictures
@pytest.mark.slow
def test_analyse_draws_the_figures_of_the_chosen_sensor(run, tmp_path):
    text = run("analyse", "8-position", "--sensor", "2", "--out", "pictures")
    assert "gyro 2" in text
    assert max(len(line) for line in text.splitlines()) <= 100
    for name in ("gyro_errors.png", "accelerometer_errors.png"):
        assert (tmp_path / "pictures" / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_scheme_a_geometry_and_errors_from_files(run, write):
    scheme = write("own.toml", TURNS)
    axes = "[[0, 0], [90, 0], [90, 90]]"
    rimu = write("rimu.toml", f"gyro_axes_deg = {axes}\naccelerometer_axes_deg = {axes}\n")
    errors = write("errors.toml", "[gyros]\nbias_dph = [1, 2, 3]\n")
    result = json.loads(
        run("analyse", scheme, "--rimu", rimu, "--errors", errors, "--stand", "20", "--json")
    )
    assert result["scheme"]["cycle_s"] == 2 * (45 + 20)
    assert result["geometry"] == "rimu"
    assert result["errors"]["gyros"]["bias_dph"] == [1, 2, 3]
    moved = {(row["sensor"], row["error"]) for row in result["rows"] if row["excursion"]}
    assert moved == {(1, "bias"), (2, "bias"), (3, "bias")}


@pytest.mark.slow
def test_the_best_found_can_be_analysed_and_rehearsed(run, write):
    run("search", "--positions", "8", "--save", "best.toml")
    found = json.loads(run("search", "--positions", "8", "--top", "1", "--json"))
    again = json.loads(run("analyse", "best.toml", "--json"))
    assert again["scheme"]["turns"] == found["best"][0]["turns"]
    from rrins.host_tools.scenario.scenario import load

    scenario = write("scenario.toml", "duration_s = 10\n" + found["toml"])
    assert [turn.model_dump() for turn in load(scenario).scheme.turns] == found["best"][0]["turns"]


def test_compare_puts_schemes_side_by_side(run):
    text = run("compare", "single-axis-4-position", "4-position", "8-position", "16-position")
    assert max(len(line) for line in text.splitlines()) <= 100
    for words in ("16-position", "1600 s", "0 to 720°", "-180 to 180°", "ring, +720°"):
        assert words in text
    result = json.loads(run("compare", "8-position", "16-position", "--json"))
    eight, sixteen = result["schemes"]
    assert sixteen["errors"]["gyro"]["MESSF"]["residual"] == 0
    assert sixteen["errors"]["accelerometer"]["MEIE"]["axes_left"] == ["z"]
    assert eight["travel"]["inner"]["net_deg"] == 720
    assert sixteen["travel"]["inner"]["backward_deg"] == 720


def test_search_reports_table_1_beside_the_best(run):
    text = run("search", "--top", "2")
    assert max(len(line) for line in text.splitlines()) <= 100
    assert "table 1" in text
    assert "scheme = [" in text


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("analyse", "16-positon"), ["16-positon", "did you mean 16-position"]),
        (("analyse", "16-position", "--rimu", "tetrahedrom"), ["did you mean tetrahedron"]),
        (("analyse", "16-position", "--errors", "none.toml"), ["none.toml", "no such file"]),
        (("analyse", "bad.toml"), ["bad.toml", "turns.1.angel_deg", "did you mean angle_deg"]),
        (("analyse", "rate.toml"), ["rate.toml", "turn_rate_dsp", "did you mean turn_rate_dps"]),
        (("analyse", "text.toml"), ["text.toml", "not TOML"]),
        (
            ("analyse", "16-position", "--errors", "key.toml"),
            ["key.toml", "gyros.bais_dph", "did you mean bias_dph"],
        ),
        (
            ("analyse", "16-position", "--rimu", "cone", "--errors", "three.toml"),
            ["three.toml", "3 values for 4"],
        ),
        (("compare", "8-position", "--rimu", "flat.toml"), ["flat.toml", "one plane"]),
        (("search", "--errors", "table.toml"), ["table.toml", "did you mean gyros"]),
    ],
)
def test_what_is_wrong_is_told_in_one_line(run, write, arguments, words):
    write("bad.toml", '[[turns]]\naxis = "inner"\nangel_deg = 180\n')
    write("rate.toml", "turn_rate_dsp = 3\n" + TURNS)
    write("text.toml", "turns = [")
    write("key.toml", "[gyros]\nbais_dph = 1\n")
    write("three.toml", "[gyros]\nbias_dph = [1, 2, 3]\n")
    write("table.toml", "[gyro]\nbias_dph = 1\n")
    flat = "[[90, 0], [90, 40], [90, 80]]"
    write("flat.toml", f"gyro_axes_deg = {flat}\naccelerometer_axes_deg = {flat}\n")
    message = run(*arguments, status=3)
    assert len(message.splitlines()) == 1
    for word in words:
        assert word in message


def test_a_sensor_that_is_not_there_is_told(run):
    assert "has 4 sensors" in run("analyse", "16-position", "--sensor", "9", status=1)


def test_limits_that_nothing_keeps_are_told(run):
    assert "even" in run("search", "--positions", "9", status=1)
