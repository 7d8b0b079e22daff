"""Campaigns as processes that are killed, filled up and interrupted: nothing missing or double."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.campaigns.row import Work, rows_of
from rrins.host_tools.campaigns.store import Store

RUNS = 480  # more than the workers take at once
VARY = {"gyros.scale_error_ppm": "normal(0, 50)"}
OPTIONS = ("rimu_rotating", f"--runs={RUNS}", "--duration=10", "--set=sensors=prototype", "--json")
VARIED = ("--vary", "gyros.scale_error_ppm=normal(0, 50)", "--out", "c", "--workers=2")
COMMAND = (sys.executable, "-m", "rrins", "campaign", *OPTIONS, *VARIED)


@pytest.fixture(scope="module")
def table():
    """Return the rows as one thread gives them, but for their time."""
    wishes = Wishes(runs=RUNS, duration_s=10, set={"sensors": "prototype"}, vary=VARY)
    definition = load("rimu_rotating", wishes)
    store = Store(Path(), definition)
    return store, {row["run"]: row for row in rows_of(Work.of(definition), range(0, RUNS, 7))}


def begin(folder, *more, **keywords):
    return subprocess.Popen(
        [*COMMAND, *more], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **keywords
    )


def stored(folder):
    return sum(pq.read_metadata(path).num_rows for path in (folder / "c").glob("part-*"))


def wait_for(folder, runs, process):
    while stored(folder) < runs:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


def check_whole(folder, table):
    """Check that every run is there once, and is what one thread gives."""
    store = Store.open(folder / "c")
    assert store.stored().tolist() == list(range(RUNS))
    found = store.table().to_pylist()
    for run, row in table[1].items():
        for name in store.schema.names:
            if name != "wall_s" and "over_time" not in name:
                assert found[run][name] == row.get(name), (run, name)
        assert found[run]["east_over_time_m"] == row["east_over_time_m"].tolist()


def go_on(folder, *more):
    process = begin(folder, *more)
    out, err = process.communicate(timeout=200)
    assert process.returncode == 0, err
    return json.loads(out)


@pytest.mark.slow
def test_a_client_that_is_killed_goes_on(tmp_path, table):
    process = begin(tmp_path, "--engine=processes")
    wait_for(tmp_path, RUNS // 3, process)
    process.kill()
    process.communicate()
    before = stored(tmp_path)
    assert RUNS // 3 <= before < RUNS
    assert go_on(tmp_path)["run_now"] == RUNS - before
    check_whole(tmp_path, table)


@pytest.mark.slow
def test_a_worker_that_is_killed_is_replaced(tmp_path, table):
    process = begin(tmp_path, "--engine=processes")
    wait_for(tmp_path, 1, process)  # nearly all of the work is still to be done
    listed = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    workers = [pid for pid in listed if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    assert len(workers) == 2
    os.kill(int(workers[0]), signal.SIGKILL)
    out, err = process.communicate(timeout=200)
    assert process.returncode == 0, err
    assert json.loads(out)["lost_chunks"] >= 1
    check_whole(tmp_path, table)


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(tmp_path, table):
    process = begin(tmp_path)
    wait_for(tmp_path, RUNS // 8, process)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.decode().startswith("rrins: stopped by the user: ")
    assert go_on(tmp_path)["stored"] == RUNS
    check_whole(tmp_path, table)


@pytest.mark.slow
def test_a_disk_that_is_full_ends_it_in_one_line(tmp_path, table):
    """A limit on the size of files stands for the disk: writing fails in the same call."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    process = begin(tmp_path, preexec_fn=limit)
    _, err = process.communicate(timeout=200)
    assert process.returncode == 1
    assert b"cannot be written" in err.splitlines()[-1]
    assert not list((tmp_path / "c").glob(".part-*"))
    assert stored(tmp_path) < RUNS
    go_on(tmp_path)
    check_whole(tmp_path, table)
