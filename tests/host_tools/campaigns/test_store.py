from __future__ import annotations

import itertools
import json
import struct
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pytest

from rrins.host_tools.campaigns.conduct import Conductor
from rrins.host_tools.campaigns.definition import Wishes, load
from rrins.host_tools.campaigns.distributions import parse
from rrins.host_tools.campaigns.engines import Done
from rrins.host_tools.campaigns.errors import CampaignError
from rrins.host_tools.campaigns.manifest import MANIFEST, read_manifest
from rrins.host_tools.campaigns.store import Store


def campaign(**wishes):
    vary = {"gyros.bias_dph": "normal(0, 1)", "firmware.scheme": "list(16-position, 8-position)"}
    return load("rimu_rotating", Wishes(**{"runs": 10, "vary": vary, **wishes}))


def row(definition, run, **more):
    point = {one.column: value for one, value in definition.plan.point(run).items()}
    return {"run": run, "seed": run, "status": "ok", "wall_s": 0.1, **point, **more}


@pytest.fixture
def store(tmp_path):
    return Store.create(tmp_path / "c", campaign())


def test_rows_come_back_in_order_of_runs(store):
    for runs in ((7, 3), (0, 1)):
        store.write([row(store.definition, run, horizontal_error_m=run / 3) for run in runs])
    assert store.stored().tolist() == [0, 1, 3, 7]
    table = store.table()
    assert table["horizontal_error_m"].to_pylist() == [0, 1 / 3, 1, 7 / 3]
    assert set(table["firmware.scheme"].to_pylist()) <= {"16-position", "8-position"}
    assert store.values("horizontal_error_m") == {0: 0, 1: 1 / 3, 3: 1, 7: 7 / 3}


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("list(1, 2, 4)", "int64"),
        ("steps(1, 4, 4)", "int64"),
        ("steps(1, 2, 3)", "double"),
        ("list(1, 2.5)", "double"),
        ("uniform(1, 2)", "double"),
        ("list(true, false)", "bool"),
        ("list(16-position, 8)", "string"),
    ],
)
def test_a_column_has_the_type_of_its_values(text, kind):
    assert parse("key", text).stored_as == kind


def test_numbers_of_sensors_are_stored_whole(tmp_path):
    fault = {"kind": "gyro_bias", "at_s": 5, "size": 1, "sensor": "list(1, 2, 3, 4)"}
    store = Store.create(tmp_path / "c", campaign(faults=[fault]))
    store.write([row(store.definition, run) for run in range(10)])
    sensors = store.table(["faults.1.sensor"])["faults.1.sensor"].to_pylist()
    assert all(isinstance(one, int) for one in sensors)


def test_others_read_the_folder_as_it_is(store):
    store.write([row(store.definition, run, horizontal_error_m=1.0) for run in range(10)])
    (store.folder / "_report").mkdir()
    assert len(pd.read_parquet(store.folder)) == 10
    counted = duckdb.sql(f"select sum(horizontal_error_m) from '{store.folder}/*.parquet'")
    assert counted.fetchall() == [(10.0,)]


def test_another_campaign_is_refused_in_one_line(store):
    others = {"seed": 2, "duration_s": 9.0, "vary": {}, "design": "sobol", "runs": 5}
    for key, value in others.items():
        with pytest.raises(CampaignError, match=r"^[^\n]*another|runs, not") as refused:
            Store.create(store.folder, campaign(**{key: value}))
        assert "\n" not in str(refused.value)
    assert Store.create(store.folder, campaign(runs=20)).definition.runs == 20
    of_before = read_manifest(store.folder).model_copy(update={"sources": "of before"})
    of_before.write(store.folder)
    with pytest.raises(CampaignError, match="other sources"):
        Store.create(store.folder, campaign(runs=20))


def test_a_hypercube_cannot_grow(tmp_path):
    Store.create(tmp_path, campaign(design="lhs"))
    with pytest.raises(CampaignError, match="cannot grow"):
        Store.create(tmp_path, campaign(design="lhs", runs=20))


def test_two_clients_do_not_write_to_one_folder(store):
    with store.locked(), pytest.raises(CampaignError, match="another campaign writes"):
        store.locked().__enter__()


def test_a_part_that_is_damaged_or_double_is_named(store):
    store.write([row(store.definition, 0)])
    part = store.parts()[0]
    part.with_name("part-00000009.parquet").write_bytes(part.read_bytes())
    with pytest.raises(CampaignError, match="run 0 twice"):
        store.stored()
    part.write_bytes(b"PAR1 no more")
    with pytest.raises(CampaignError, match=r"part-00000000.*delete it"):
        store.stored()


def test_parts_are_merged_and_whenever_that_ends_nothing_is_missing_or_double(
    tmp_path, monkeypatch
):
    steps = [(Path, "replace"), (Path, "unlink"), (Store, "_write_manifest")]
    calls = {step: getattr(*step) for step in steps}
    left = 0

    def until_killed(step):
        def call(*arguments, **named):
            nonlocal left
            left -= 1
            if left < 0:
                raise KeyboardInterrupt
            return calls[step](*arguments, **named)

        return call

    for survived in itertools.count():
        store = Store.create(tmp_path / str(survived), campaign())
        for runs in ((7, 3), (0, 1), (9,)):
            store.write([row(store.definition, run, horizontal_error_m=run / 3) for run in runs])
        before, left = store.table(), survived
        with monkeypatch.context() as patched:
            for step in steps:
                patched.setattr(*step, until_killed(step))
            try:
                store.merge()
                is_killed = False
            except KeyboardInterrupt:
                is_killed = True
        again = Store.open(store.folder)
        assert again.table().equals(before)
        with again.locked():
            again.merge()
        assert [part.name for part in again.parts()] == ["part-00000000-00000009.parquet"]
        assert len(list(store.folder.glob("*part*"))) == 1
        assert Store.open(store.folder).table().equals(before)
        if not is_killed:
            break
    assert survived > 5


def test_a_flipped_bit_of_a_part_is_named_and_never_another_number(store):
    rows = [row(store.definition, run, horizontal_error_m=run / 7) for run in range(10)]
    store.write(rows)
    (part,) = store.parts()
    whole = part.read_bytes()
    for bit in np.random.default_rng(1).integers(0, 8 * len(whole), 300).tolist():
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        part.write_bytes(damaged)
        for again in (store, Store.open(store.folder)):
            with pytest.raises(CampaignError, match=r"part-00000000.*delete it") as caught:
                again.table()
            assert "\n" not in str(caught.value)
    part.write_bytes(whole)
    assert Store.open(store.folder).stored().tolist() == list(range(10))


def test_checksums_of_pages_hold_where_no_digest_is_known(store):
    store.write([row(store.definition, 0, horizontal_error_m=1.5)])
    store._digests.clear()
    (part,) = store.parts()
    damaged = bytearray(part.read_bytes())
    damaged[damaged.index(struct.pack("<d", 1.5))] ^= 1
    part.write_bytes(damaged)
    with pytest.raises(CampaignError, match=r"part-00000000.*delete it"):
        store.table()


def test_a_flipped_bit_of_the_manifest_is_named(store):
    path = store.folder / MANIFEST
    whole = path.read_bytes()
    for bit in np.random.default_rng(1).integers(0, 8 * len(whole), 100).tolist():
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        found = _opened(store.folder)
        assert found == store.definition or (MANIFEST in found and "\n" not in found)


def _opened(folder):
    try:
        return Store.open(folder).definition
    except CampaignError as error:
        return str(error)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("runs", "many"), r"campaign\.runs: .*valid integer"),
        (("runs", 0), r"campaign\.runs: .*greater than"),
        (("rums", 3), r"campaign\.rums: no such key, did you mean runs"),
        (("scenario", "duration_s = "), "TOML|Invalid"),
        (("scenario", "duration_s = -1"), "duration_s"),
        (("correlate", [1]), r"campaign\.correlate"),
        (("vary", {"gyros.bias_dph": "abnormal(1)"}), "abnormal"),
        (("design", "by hand"), "design"),
    ],
)
def test_a_manifest_with_wrong_keys_or_types_is_one_line(store, change, words):
    path = store.folder / MANIFEST
    manifest = json.loads(path.read_text())
    del manifest["digest"]
    manifest["campaign"] |= dict([change])
    path.write_text(json.dumps(manifest))
    with pytest.raises(CampaignError, match=words) as caught:
        Store.open(store.folder)
    assert MANIFEST in str(caught.value)
    assert "\n" not in str(caught.value)


class _Quick:
    """An engine whose chunks come back at once, one at a time."""

    def __init__(self, definition):
        self._definition, self._runs = definition, ()

    def workers(self):
        return 1600

    def room(self):
        return not self._runs

    def submit(self, chunk):
        self._runs = chunk

    def wait(self, timeout_s):
        runs, self._runs = self._runs, ()
        return [Done(runs, [row(self._definition, run) | {"wall_s": 4.0} for run in runs])]

    def close(self):
        return []


def test_rows_that_come_soon_after_each_other_share_a_part(tmp_path, monkeypatch):
    store = Store.create(tmp_path, campaign(runs=300))
    monkeypatch.setattr(store, "merge", lambda: None)
    seen = []
    engine = _Quick(store.definition)
    progress = Conductor(store, engine, on_progress=lambda now: seen.append(now.stored)).run()
    assert store.stored().tolist() == list(range(300))
    assert len(seen) == 301  # a run to a chunk, as each takes 4 s, and the end
    assert len(store.parts()) <= 2 + progress.wall_s
