"""A recording as MCAP, read back by the format's own library."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from rrins.host_tools.cli.main import rrins
from rrins.host_tools.dashboard.mcap_file import attitude_quaternion

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def exported(recording, tmp_path_factory):
    """Return the summary and the messages of a recording's file: topic, time, content."""
    path = tmp_path_factory.mktemp("mcap") / "bus.mcap"
    done = CliRunner().invoke(rrins, ["export", str(recording), str(path), "--json"])
    assert done.exit_code == 0, done.output
    with path.open("rb") as file:
        found = [
            (schema.name, channel.topic, message.log_time, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages(log_time_order=False)
        ]
    return json.loads(done.output), found


def test_all_frames_are_there_with_names_units_and_times(exported):
    summary, found = exported
    of_bus = [one for one in found if one[1][1:].isupper()]
    assert len(of_bus) == summary["frames"]
    modes = [
        (time / 1e9, data["mode_name"])
        for _, topic, time, data in found
        if topic == "/FIRMWARE_STATUS"
    ]
    assert modes[0][1] == "SELF_TEST"
    assert modes[-1][1] == "NAVIGATION_ROTATING"
    assert 1.0 < min(at for at, name in modes if name == "NAVIGATION_ROTATING") < 1.3
    assert all(data["crc_holds"] for _, _, _, data in of_bus)


def test_transforms_are_the_angles_of_the_axes(exported):
    _, found = exported
    angles = [d["encoder_angle_deg"] for _, topic, _, d in found if topic == "/AXIS_INNER_STATUS"]
    turned = [
        d["rotation"]
        for _, topic, _, d in found
        if topic == "/tf" and d["child_frame_id"] == "sensors"
    ]
    assert len(angles) == len(turned) > 10_000
    half = np.radians(angles) / 2
    assert [q["z"] for q in turned] == pytest.approx(np.sin(half))
    assert [q["w"] for q in turned] == pytest.approx(np.cos(half))
    assert max(angles) > 170


def test_positions_and_events_have_the_schemas_that_viewers_know(exported):
    _, found = exported
    schemas = {topic: name for name, topic, _, _ in found}
    assert schemas["/tf"] == "foxglove.FrameTransform"
    assert schemas["/position"] == "foxglove.LocationFix"
    place = next(data for _, topic, _, data in found if topic == "/position")
    assert place["latitude"] == pytest.approx(40.3554, abs=1e-3)
    told = [data["message"] for _, topic, _, data in found if topic == "/events"]
    assert "navigation with rotation" in told
    assert any(text.startswith("the gyros disagree") for text in told)


@pytest.mark.parametrize(("roll", "pitch", "heading"), [(10, 20, 30), (-170, 80, 300), (0, 0, 90)])
def test_the_attitude_is_heading_then_pitch_then_roll(roll, pitch, heading):
    r, p, h = np.radians([roll, pitch, -heading])
    about_z = np.array([[np.cos(h), -np.sin(h), 0], [np.sin(h), np.cos(h), 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, np.cos(p), -np.sin(p)], [0, np.sin(p), np.cos(p)]])
    about_y = np.array([[np.cos(r), 0, np.sin(r)], [0, 1, 0], [-np.sin(r), 0, np.cos(r)]])
    wanted = about_z @ about_x @ about_y
    q = attitude_quaternion(roll, pitch, heading)
    x, y, z, w = q["x"], q["y"], q["z"], q["w"]
    found = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert found == pytest.approx(wanted, abs=1e-12)


def test_a_folder_is_no_file(recording, tmp_path):
    done = CliRunner().invoke(rrins, ["export", str(recording), str(tmp_path), "--format", "mcap"])
    assert done.exit_code == 2
    assert "is a folder; mcap is a file" in done.output


@pytest.mark.parametrize(
    ("out", "options", "says"),
    [
        (
            "bus.mcap",
            ["--format", "csv"],
            "bus.mcap names a file, mcap, and not --format csv",
        ),
        ("bus.parquet", [], "bus.parquet names one file; OUT is a folder for a table per message"),
        ("bus.log", [], "bus.log names one file; OUT is a folder"),
    ],
)
def test_the_ending_chooses_the_format(tmp_path, out, options, says):
    log = tmp_path / "bus.log.gz"
    log.write_bytes(gzip.compress(b"(0.0) a 010#00\n"))
    done = CliRunner().invoke(rrins, ["export", str(log), str(tmp_path / out), *options])
    assert done.exit_code == 2
    assert says in " ".join(done.output.split())
