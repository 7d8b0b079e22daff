"""Diagnosis in exported and plotted logs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pyarrow.parquet
import pytest
from click.testing import CliRunner
from scapy.utils import RawPcapNgReader

from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics import table
from rrins.host_tools.cli.main import rrins
from rrins.log import BusLog

ASK, ANSWER = table.request_id(), table.response_id()
FRAMES = (
    (0.25, load().frame_id("XCP_RESPONSE"), "fe 22"),  # as long as its contents
    (0.5, ASK, "02 10 03"),  # of a tool that does not fill its frames up
    (0.5, ANSWER, "06 50 03 00 32 01 f4 cc"),
    (1.0, ASK, "10 0b 2e 10 04 3f e0 00"),
    (1.001, ANSWER, "30 00 01 cc cc cc cc cc"),
    (1.002, ASK, "21 00 00 00 00 00 cc cc"),
    (1.003, ANSWER, "03 7f 2e 33 cc cc cc cc"),
)
SAID = [
    "diagnostic_session_control_extended",
    "diagnostic_session_control_extended: p2_ms 50 ms, p2_star_10ms 500",
    "write_bridge: bridge_s 0.5 s",
    "write_bridge refused: securityAccessDenied (0x33): the computer is locked",
]
OTHERS = 40
"""Frames of SYNC in between."""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    sync = load().frame_id("SYNC")
    lines = [(0.02 * k, sync, "00 " * 8) for k in range(OTHERS)]
    text = [
        f"({time_s:.6f}) can0 {can_id:03X}#{data.replace(' ', '').upper()}"
        for time_s, can_id, data in sorted([*lines, *FRAMES], key=lambda one: one[0])
    ]
    path = tmp_path / "bus.log"
    path.write_text("\n".join(text) + "\n")
    return path


def call(*words: object, status: int = 0) -> str:
    done = CliRunner().invoke(rrins, [str(word) for word in words], prog_name="rrins")
    assert done.exit_code == status, done.output
    return done.output


def test_a_column_in_parquet(log, tmp_path):
    call("export", log, tmp_path / "tables")
    rows = []
    for name in ("DIAG_REQUEST", "DIAG_RESPONSE"):
        found = pyarrow.parquet.read_table(tmp_path / "tables" / f"{name}.parquet")
        columns = zip(found["time_s"].to_pylist(), found["diagnosis"].to_pylist(), strict=True)
        rows += [row for row in columns if row[1] is not None]
        assert found.schema.field("diagnosis").metadata[b"comment"]
    assert [text for _, text in sorted(rows, key=lambda row: row[0])] == SAID
    assert (
        "diagnosis" not in pyarrow.parquet.read_schema(tmp_path / "tables" / "SYNC.parquet").names
    )


def test_packets_of_xcp_are_kept_at_any_length(log, tmp_path):
    for out in ("tables", "bus.mcap"):
        told = json.loads(call("export", log, tmp_path / out, "--json"))
        assert told["wrong_length"] == 0
    found = pyarrow.parquet.read_table(tmp_path / "tables" / "XCP_RESPONSE.parquet").to_pylist()
    assert [(row["packet_id"], row["byte_1"], row["byte_2"]) for row in found] == [(254, 34, None)]


def test_pcapng_has_every_frame_and_the_words(log, tmp_path):
    path = tmp_path / "bus.pcapng"
    told = json.loads(call("export", log, path, "--json"))
    assert (told["frames"], told["diagnosis"]) == (OTHERS + len(FRAMES), len(SAID))
    packets = [*RawPcapNgReader(str(path))]
    assert {packet[1].linktype for packet in packets} == {227}
    found = []
    for data, meta in packets:
        can_id = int.from_bytes(data[:4], "big")
        ticks = meta.tshigh << 32 | meta.tslow
        found.append((ticks / meta.tsresol, can_id, data[8 : 8 + data[4]].hex(" ")))
    assert [one for one in found if one[1] in (ASK, ANSWER)] == [
        (pytest.approx(time_s, abs=1e-9), can_id, text) for time_s, can_id, text in FRAMES[1:]
    ]


def test_what_cannot_be_written_leaves_nothing(log, tmp_path):
    (folder := tmp_path / "folder").mkdir()
    said = call("export", log, folder / "missing" / "bus.pcapng", status=6)
    assert "cannot be written: No such file or directory" in said
    log.write_text("nothing\n")
    call("export", log, folder / "bus.pcapng", status=6)
    assert [*folder.iterdir()] == []


def test_from_python(log, tmp_path):
    rows = BusLog(log).export(tmp_path / "bus.pcapng", "pcapng")
    assert rows == {"frames": OTHERS + len(FRAMES)}


def test_wireshark_reads_it(log, tmp_path):
    """Wireshark shows our words, and its own dissectors find the same messages."""
    if shutil.which("tshark") is None and os.environ.get("RRINS_REQUIRE_TSHARK") != "1":
        pytest.skip("tshark is not installed (Debian: apt-get install tshark)")
    path = tmp_path / "bus.pcapng"
    call("export", log, path)

    def tshark(*words: str) -> list[str]:
        command = ["tshark", "-r", str(path), *words]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
        return done.stdout.splitlines()

    assert len(tshark()) == OTHERS + len(FRAMES)
    assert tshark("-Y", "_ws.malformed") == []
    assert tshark("-Y", "frame.comment", "-T", "fields", "-e", "frame.comment") == SAID
    uds = ("-o", "iso15765.can.ids:0x7df,0x7e0,0x7e8", "-d", "iso15765.subdissector,uds")
    found = tshark(*uds, "-Y", "uds", "-T", "fields", "-e", "uds.sid", "-e", "uds.err.code")
    assert [line.split("\t")[0] for line in found] == ["0x10", "0x10", "0x2e", "0x3f"]
    assert found[-1].endswith("0x33")


@pytest.mark.pictures
def test_a_plot_of_the_diagnosis(log, tmp_path):
    picture = tmp_path / "diagnosis.png"
    call("plot", log, "diagnosis", "SYNC.epoch", "--out", picture)
    assert picture.stat().st_size > 10_000
    assert "diagnosis: 4 messages" in call("plot", log, "--list")
    assert "no frames of diagnosis" in call("plot", log, "diagnosis", "--to", "0.1", status=6)


def test_mcap_has_the_dialogue(log, tmp_path):
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "bus.mcap"
    call("export", log, path)
    with path.open("rb") as file:
        found = [
            json.loads(message.data)
            for _, channel, message in reader.make_reader(file).iter_messages()
            if channel.topic == "/diagnosis"
        ]
    assert [one["message"] for one in found] == SAID
    assert [one["level"] for one in found] == [2, 2, 2, 3]


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (("bus.pcapng", "--format", "csv"), "names a file, pcapng, and not --format csv"),
        (("bus.blf",), "or ends in .mcap or .pcapng"),
        ((".", "--format", "pcapng"), "is a folder; pcapng is a file"),
    ],
)
def test_what_cannot_be_written(log, words, error):
    assert error in call("export", log, *words, status=2)
