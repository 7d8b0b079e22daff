"""Campaigns as processes that are killed, filled up and interrupted: nothing missing or double."""

from __future__ import annotations

import functools
import json
import os
import resource
import signal
import subprocess
import sys
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
COMMAND = ("campaign", *OPTIONS, *VARIED)
PAUSES = """
import os, signal
from rrins.host_tools.campaigns.store import Store
from rrins.host_tools.cli.main import main

write, runs = Store.write, {runs}

def write_and_pause(store, rows):
    global runs
    write(store, rows)
    if runs <= len(store.stored()):
        runs = {never}
        os.kill(os.getpid(), signal.SIGSTOP)

Store.write = write_and_pause
main()
"""


@pytest.fixture(scope="module")
def table():
    """Return the rows as one thread gives them, but for their time."""
    wishes = Wishes(runs=RUNS, duration_s=10, set={"sensors": "prototype"}, vary=VARY)
    definition = load("rimu_rotating", wishes)
    store = Store(Path(), definition)
    return store, {row["run"]: row for row in rows_of(Work.of(definition), range(0, RUNS, 7))}


def begin(folder, *more, entry=("-m", "rrins"), **keywords):
    command = [sys.executable, *entry, *COMMAND, *more]
    return subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **keywords
    )


def begin_and_pause(folder, runs, *more, **keywords):
    """Begin a campaign that the kernel stops as soon as it has stored so many runs."""
    pauses = PAUSES.format(runs=runs, never=RUNS + 1)
    process = begin(folder, *more, entry=("-c", pauses), **keywords)
    ended = os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)
    assert ended.si_code == os.CLD_STOPPED, process.communicate()
    return process


def kill_a_worker(process):
    threads = Path(f"/proc/{process.pid}/task").glob("*/children")
    listed = [pid for one in threads for pid in one.read_text().split()]
    workers = [pid for pid in listed if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]
    assert len(workers) == 2
    os.kill(int(workers[0]), signal.SIGKILL)


def stored(folder):
    return sum(pq.read_metadata(path).num_rows for path in (folder / "c").glob("part-*"))


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


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["threads", pytest.param("processes", marks=pytest.mark.soak)])
def test_whatever_ends_it_it_goes_on_until_every_run_is_there_once(tmp_path, table, engine):
    # A disk that is full: a limit on the size of files, writing fails in the same call.
    limit = functools.partial(resource.setrlimit, resource.RLIMIT_FSIZE, (20_000, 20_000))
    no_bytecode = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"}  # Python would cut it short
    process = begin(tmp_path, preexec_fn=limit, env=no_bytecode)
    _, err = process.communicate(timeout=200)
    assert process.returncode == 1
    assert b"cannot be written" in err.splitlines()[-1]
    assert not list((tmp_path / "c").glob(".part-*"))
    # A client that is killed.
    process = begin_and_pause(tmp_path, stored(tmp_path) + 1, f"--engine={engine}")
    process.kill()
    process.communicate()
    before = stored(tmp_path)
    # Ctrl-C.
    process = begin_and_pause(tmp_path, before + 1)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGCONT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.decode().startswith("rrins: stopped by the user: ")
    interrupted = stored(tmp_path)
    assert 0 < before < interrupted < RUNS
    # A worker that is killed is replaced.
    if engine == "processes":
        process = begin_and_pause(tmp_path, interrupted + 1, f"--engine={engine}")
        kill_a_worker(process)
        process.send_signal(signal.SIGCONT)
    else:
        process = begin(tmp_path)
    out, err = process.communicate(timeout=200)
    assert process.returncode == 0, err
    printed = json.loads(out)
    assert (printed["lost_chunks"] >= 1) == (engine == "processes")
    assert printed["run_now"] == RUNS - interrupted
    check_whole(tmp_path, table)


@pytest.mark.soak
def test_ctrl_c_in_a_terminal_reaches_workers_too_and_gives_one_line(tmp_path):
    process = begin_and_pause(tmp_path, 1, "--engine=processes", start_new_session=True)
    os.killpg(process.pid, signal.SIGINT)
    process.send_signal(signal.SIGCONT)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.decode().startswith("rrins: stopped by the user: ")
    assert len(err.splitlines()) == 1
