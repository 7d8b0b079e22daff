"""`rrins reproduce`: what it prints and writes, with few seeds; in `make soak` with all cases."""

from __future__ import annotations

import json
import math
import os
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from rrins.host_tools.cli import output
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.experiments import drive, prototype, static, variation
from rrins.host_tools.experiments.constants import REFERENCE, SETS, WORST
from rrins.host_tools.experiments.fleet import Fleet, run
from rrins.host_tools.experiments.prototype import RATE_HZ
from rrins.host_tools.scenario.scenario import load

KEYS = {"experiment", "case", "quantity", "unit", "paper", "ours", "note"}
NAMES = ("scheme", "static", "rotating", "experiment", "drive")


def refuse(constant):
    raise AssertionError(f"{constant} is not JSON")


def keep_few(patch):
    """Leave few of the sets of constants, variants and geometries; a part of each run."""
    few = [case for case in prototype.CASES if case.constants == REFERENCE][:1]
    patch.setattr(prototype, "CASES", (*few, *prototype.CASES[-2:]))
    patch.setattr(prototype, "load", lambda name: load(name, duration_s=1800))
    patch.setattr(drive, "load", lambda name: load(name, duration_s=900))
    patch.setattr(drive, "CASES", ((SETS[1], False), (WORST, False), (WORST, True)))
    patch.setattr(drive, "_VARIANTS", dict([*drive._VARIANTS.items()][:2]))
    for name, last in (("STATIC", 2), ("ROTATING", 3)):
        simulation = getattr(static, name)
        variants = dict([*simulation.variants.items()][:last])
        patch.setattr(static, name, replace(simulation, variants=variants))
    patch.setattr(static, "load", lambda name: load(name, rate_hz=RATE_HZ, duration_s=2000))
    patch.setattr(variation, "GEOMETRIES", variation.GEOMETRIES[:1])


@pytest.fixture(scope="module", params=["few", pytest.param("all", marks=pytest.mark.soak)])
def reproduced(request, tmp_path_factory):
    """Run all with two seeds; return the folder and the JSON object."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "few":
            keep_few(patch)
        yield _reproduced(tmp_path_factory)


def _reproduced(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reproduced")
    motion = tmp_path_factory.mktemp("motion") / "way.csv"
    lines = ["time_s,latitude_deg,longitude_deg,height_m"]
    for second in range(60):  # half a kilometre to the north, from rest to rest
        north_m = 500 * (1 - math.cos(math.pi * min(max(second - 5, 0), 50) / 50)) / 2
        lines.append(f"{second},{48 + north_m / 111_200:.10f},9.0,200.0")
    motion.write_text("\n".join(lines))
    arguments = ["reproduce", "all", "--seeds", "2", "--motion", str(motion)]
    arguments += ["--out", str(folder), "--json"]
    result = CliRunner().invoke(rrins, arguments)
    assert result.exit_code == 0, result.output
    line = result.stdout.strip()
    assert "\n" not in line
    return folder, json.loads(line, parse_constant=refuse)


def test_json_is_one_object_of_rows(reproduced):
    folder, printed = reproduced
    assert set(printed) == {"seeds", "rows", "report"}
    assert printed["seeds"] == 2
    assert printed["report"] == str(folder / "report.html")
    for row in printed["rows"]:
        assert set(row) == KEYS
        assert row["experiment"] in NAMES
        assert isinstance(row["case"], str)
        assert isinstance(row["quantity"], str)
        assert row["unit"] in ("m", "m/s", "rad", "1")
        assert row["paper"] is None or row["paper"] >= 0
        assert isinstance(row["ours"], float)
    assert {row["experiment"] for row in printed["rows"]} == set(NAMES)
    rows = [(row["experiment"], row["case"], row["quantity"]) for row in printed["rows"]]
    assert len(rows) == len(set(rows))


def rows_of(printed, experiment, case):
    return {
        row["quantity"]: row
        for row in printed["rows"]
        if (row["experiment"], row["case"]) == (experiment, case)
    }


def test_table_3_is_whole(reproduced):
    _, printed = reproduced
    expected = {
        ("static", "imu_strapdown"): (9000, 9000),
        ("static", "rimu_strapdown"): (950, 550),
        ("rotating", "imu_rotating"): (86, 69),
        ("rotating", "rimu_rotating"): (5, 2),
    }
    for (experiment, case), papers in expected.items():
        rows = rows_of(printed, experiment, case)
        sides = [rows[f"largest position error, {side}"] for side in ("east", "north")]
        assert tuple(row["paper"] for row in sides) == papers
    rows = rows_of(printed, "experiment", "50 ppm, 10″")
    papers = [
        rows[f"largest position error, {way}, {side}"]["paper"]
        for way in ("strapdown", "rotating")
        for side in ("east", "north")
    ]
    assert papers == [69_000, 192_000, 9600, 21_300]
    rows = rows_of(printed, "drive", "route 1")
    ends = [rows[f"end point error, {way}"]["paper"] for way in ("strapdown", "rotating")]
    assert ends == [195, 30]


def test_what_differs_has_the_closest_variant_and_the_run_behind_it(reproduced):
    _, printed = reproduced
    told = 0
    chosen = {}
    for row in printed["rows"]:
        if row["experiment"] in ("scheme", "experiment") or row["note"] == "variant":
            continue
        if not row["paper"] or 0.5 <= row["ours"] / row["paper"] <= 2:
            continue
        if "seeds" in row["note"]:
            continue
        match = re.search(
            r"closest of (\d+) variants over the \d figures of this case: (.*), [\d.,e-]+ m",
            row["note"],
        )
        if match is None:
            assert "is closer" in row["note"]
            continue
        told += 1
        chosen.setdefault((row["experiment"], row["case"]), set()).add(match[2])
        case = f"{row['case']}: {match[2]}"
        assert rows_of(printed, row["experiment"], case)[row["quantity"]]["note"] == "variant"
    assert told >= 4
    assert all(len(names) == 1 for names in chosen.values()), "one variant a case"


def test_each_set_of_constants_has_its_distribution(reproduced):
    _, printed = reproduced
    for case in prototype.CASES:
        rows = rows_of(printed, "experiment", case.words)
        assert len(rows) == 6
        for row in rows.values():
            assert row["note"].startswith("median; the range of 2 seeds: ")
            assert re.search(r"lies (inside|below|above).*; \d of 2 below it", row["note"])
    for constants in (case[0] for case in drive.CASES if not case[1]):
        assert len(rows_of(printed, "drive", constants.words)) == 3
    calibrated = rows_of(printed, "drive", "50 ppm, 60″, calibrated")
    uncalibrated = rows_of(printed, "drive", "50 ppm, 60″")
    assert len(calibrated) == 3
    for way in ("strapdown", "rotating"):
        name = f"end point error, {way}"
        assert calibrated[name]["ours"] < 0.2 * uncalibrated[name]["ours"]


def test_ideal_sensors_hold_on_the_drive(reproduced):
    _, printed = reproduced
    rows = rows_of(printed, "drive", "route 1")
    for way in ("strapdown", "rotating"):
        assert rows[f"largest position error, ideal sensors, {way}"]["ours"] < 0.5


def test_section_4_2_integrates_to_zero(reproduced):
    _, printed = reproduced
    for geometry in variation.GEOMETRIES:
        remaining = set()
        for row in printed["rows"]:
            if row["experiment"] != "scheme" or not row["case"].startswith(geometry):
                continue
            excursion = float(re.search(r"excursion ([-+.\de]+)", row["note"])[1])
            if abs(row["ours"]) > 1e-9 * excursion:
                _, kind, error = row["case"].split(", ")
                remaining.add((kind.split()[0], error, row["quantity"].split(" on ")[1][0]))
        leaving = {("accelerometer", error, "z") for error in ("MESSF", "MEIE")}
        assert remaining == leaving, geometry


class Page(HTMLParser):
    """Collects what a page refers to, and checks that its tags close."""

    VOID = ("meta", "img", "br")

    def __init__(self):
        super().__init__()
        self.references, self.identifiers, self.open = [], [], []
        self.words = []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "srcset", "data", "poster", "action"):
                self.references.append(value)
            if name == "id":
                self.identifiers.append(value)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_the_report_is_one_file_that_needs_no_other(reproduced):
    folder, _ = reproduced
    text = (folder / "report.html").read_text(encoding="utf-8")
    page = Page()
    page.feed(text)
    assert page.open == []
    for reference in page.references:
        assert reference.startswith(("data:image/png;base64,", "#")), reference[:80]
        if reference.startswith("#"):
            assert reference[1:] in page.identifiers
    assert "url(" not in text
    assert "@import" not in text
    assert "<script" not in text
    assert set(NAMES) | {"table3", "table1"} == set(page.identifiers)
    words = " ".join(page.words)
    for heading in ("Settings", "Open in the paper", "Found", "Variants of what the paper"):
        assert heading in words
    assert "5-95 %" not in words  # two seeds have no such percentiles
    assert "Experiment: median of 2 seeds" in words
    assert "nan" not in words.lower().split()


PICTURES = {
    "figure_7", "figure_8", "figure_9", "figure_10", "figure_12", "figure_15",
    "figure_15_recorded", "figure_4_4_ratio", "figure_4_5_spread",
}  # fmt: skip


def test_the_pictures_are_files_as_well(reproduced):
    folder, _ = reproduced
    names = {path.stem for path in folder.iterdir() if path.suffix == ".png"}
    assert names == PICTURES
    for path in folder.glob("*.png"):
        data = path.read_bytes()
        assert data.startswith(b"\x89PNG")
        assert len(data) < 120_000
    assert {path.name for path in folder.iterdir()} - {f"{n}.png" for n in PICTURES} == {
        "report.html"
    }


def test_a_recorded_motion_stands_beside_the_synthetic_one(reproduced):
    _, printed = reproduced
    rows = rows_of(printed, "drive", "way.csv")
    assert all(row["paper"] is None for row in rows.values())
    assert re.match(r"[56]\d s, 200 Hz", rows["end point error, strapdown"]["note"])
    for way in ("strapdown", "rotating"):
        assert rows[f"largest position error, ideal sensors, {way}"]["ours"] < 0.01


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("statik",), 2, "statik"),
        (("static", "--seeds", 0), 2, "--seeds"),
        (("drive", "--motion", "none.csv"), 2, "none.csv"),
        (("static", "--out", "/proc/none/deep"), 1, "/proc/none/deep: cannot be created"),
    ],
)
def test_wrong_use_ends_at_once(arguments, status, words):
    result = CliRunner().invoke(rrins, ["reproduce", *map(str, arguments)])
    assert (result.exit_code, result.stdout) == (status, "")
    assert words in result.stderr


def test_a_folder_that_cannot_be_written_to_is_told_before_anything_is_run(monkeypatch, tmp_path):
    forbidden = SimpleNamespace(access=lambda path, mode: False, W_OK=os.W_OK, X_OK=os.X_OK)
    monkeypatch.setattr(output, "os", forbidden)  # the tests may run as root
    result = CliRunner().invoke(rrins, ["reproduce", "static", "--out", str(tmp_path)])
    assert result.exit_code == 1
    assert result.stderr.strip() == f"rrins: --out {tmp_path}: cannot be written to"
    assert list(tmp_path.iterdir()) == []


# What the runs stand on


@pytest.mark.parametrize("name", ["experiment_strapdown", "experiment_rotating"])
def test_at_standstill_the_errors_do_not_hang_on_the_rate(name):
    # Without white noise, whose draws are others at another rate.
    quiet = {
        "gyros__angle_random_walk_deg_per_sqrt_h": 0,
        "accelerometers__white_noise_ug_per_sqrt_hz": 0,
    }
    scenario = SETS[4].drawn(load(name, duration_s=3600).varied(**quiet), 1)
    slow, fast = Fleet().run_all([scenario.varied(rate_hz=rate) for rate in (RATE_HZ, 200)], 10.0)
    largest = max(fast.largest()["max_abs_position_error_m"].values())
    for ours, theirs in (
        (slow.position_east_m, fast.position_east_m),
        (slow.position_north_m, fast.position_north_m),
    ):
        count = min(len(ours), len(theirs))
        assert np.abs(ours[:count] - theirs[:count]).max() < 5e-3 * largest


def test_a_fleet_keeps_its_order_and_its_runs_apart():
    scenarios = [
        load("experiment_rotating").varied(duration_s=20 + 10 * k, rate_hz=50, seed=k)
        for k in range(6)
    ]
    done = []
    together = Fleet(lambda: done.append(1)).run_all(scenarios, 1.0)
    alone = [run(scenario, 1.0) for scenario in scenarios]
    assert len(done) == 6
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(one.position_east_m, other.position_east_m)
        assert np.array_equal(one.heading_deg, other.heading_deg)
    assert not np.array_equal(alone[0].position_east_m, alone[1].position_east_m[: len(alone[0])])
