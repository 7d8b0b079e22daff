"""A campaign on a Dask scheduler with two workers, all of them real processes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from rrins.host_tools.campaigns.conduct import Conductor
from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.campaigns.engines import Threads
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.row import Work, rows_of
from rrins.host_tools.campaigns.running import Workers, run
from rrins.host_tools.campaigns.store import Store

distributed = pytest.importorskip("distributed")

RUNS = 160


def campaign():
    wishes = Wishes(runs=RUNS, duration_s=10, vary={"gyros.bias_dph": "normal(0, 0.1)"})
    return load("rimu_rotating", wishes)


class _Cluster:
    """A scheduler and two workers, as the page on clusters starts them."""

    def __init__(self, folder):
        self.file = folder / "scheduler.json"
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        dask = (sys.executable, "-m", "dask")
        options = ("--port", "0", "--no-dashboard", "--scheduler-file", str(self.file))
        self.scheduler = subprocess.Popen([*dask, "scheduler", *options], cwd=folder, **quiet)
        while not self.file.exists() or not self.file.read_text().endswith("}"):
            assert self.scheduler.poll() is None
            time.sleep(0.05)
        self.address = json.loads(self.file.read_text())["address"]
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
        self.workers = [
            subprocess.Popen([*dask, "worker", self.address, *options], cwd=folder, **quiet)
            for _ in range(2)
        ]

    def close(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    one = _Cluster(tmp_path_factory.mktemp("dask"))
    yield one
    one.close()


@pytest.fixture(scope="module")
def by_threads(tmp_path_factory):
    store = Store.create(tmp_path_factory.mktemp("threads"), campaign())
    Conductor(store, Threads(Work.of(store.definition), 2)).run()
    return store.table().drop(["wall_s"])


@pytest.mark.slow
def test_its_table_is_that_of_threads_though_a_worker_is_killed(cluster, by_threads, tmp_path):
    store = Store.create(tmp_path / "c", campaign())

    def kill(progress):
        if progress.stored > RUNS // 8 and cluster.workers[0].poll() is None:
            os.kill(cluster.workers[0].pid, signal.SIGKILL)

    run(store, Workers.of(scheduler_file=cluster.file), on_progress=kill)
    assert cluster.workers[0].wait(10) == -signal.SIGKILL
    assert store.table().drop(["wall_s"]).equals(by_threads)


@pytest.mark.slow
def test_by_address_and_without_a_word_it_ends(cluster, tmp_path):
    store = Store.create(tmp_path / "c", campaign().with_runs(4))
    run(store, Workers.of(cluster.address))
    assert store.stored().tolist() == [0, 1, 2, 3]
    store = Store.create(tmp_path / "d", campaign())
    cluster.workers[1].send_signal(signal.SIGSTOP)
    try:
        with pytest.raises(CampaignError, match="no worker has given anything for 1 s"):
            run(store, Workers.of(cluster.address), silence_s=1.0)
    finally:
        cluster.workers[1].send_signal(signal.SIGCONT)


@pytest.mark.slow
def test_a_scheduler_without_workers_is_told_of_at_once(tmp_path):
    store = Store.create(tmp_path / "c", campaign())
    told = []
    alone = {"n_workers": 0, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(**alone) as cluster:
        address = Workers.of(cluster.scheduler_address)
        with pytest.raises(CampaignError, match="no worker has come for 1 s: 0 of 160 runs"):
            run(store, address, silence_s=1.0, on_progress=lambda now: told.append(now.workers))
    assert told[0] == 0


@pytest.mark.parametrize("what", ["sources", "versions"])
def test_workers_of_other_sources_or_libraries_are_refused(what):
    work = Work.of(campaign())
    other = {"sources": "abc"} if what == "sources" else {"versions": (("numpy", "0.1"),)}
    with pytest.raises(CampaignError, match=r"^worker .*install the same"):
        rows_of(Work(**{**vars(work), **other}), [0])


@pytest.mark.parametrize(
    ("words", "engine"),
    [
        ((None, None), "threads"),
        (("3", "processes"), "processes"),
        (("tcp://10.0.0.1:8786", None), "dask"),
        (("node7:8786", None), "dask"),
        (("2", "dask"), "dask"),
    ],
)
def test_what_the_options_mean(words, engine):
    assert Workers.of(*words).engine == engine


@pytest.mark.parametrize("words", [("0", None), ("many", None), ("tcp://a:1", "threads")])
def test_what_they_cannot_mean(words):
    with pytest.raises(CampaignError):
        Workers.of(*words)


def test_without_dask_one_line_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CampaignError, match=r"^needs distributed: pip install 'rrins\[dask\]'$"):
        Workers.of("2", "processes").start(Work.of(campaign()))


def test_a_scheduler_that_is_not_there(tmp_path):
    with pytest.raises(CampaignError, match="is not there"):
        Workers.of(scheduler_file=tmp_path / "none.json")
