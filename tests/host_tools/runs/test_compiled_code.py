"""Compiled code as a user meets it: kept, refused where others can write, and Ctrl-C."""

from __future__ import annotations

import os
import re
import shutil
import signal

import pytest

from rrins.compiled.code_folder import code_folder


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return an empty cache folder for the commands of a test."""
    code_folder()  # that of this process stays what it is
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "rrins"


@pytest.mark.parametrize("command", ["rehearse", pytest.param("firmware", marks=pytest.mark.soak)])
def test_a_folder_that_others_can_write_is_refused_in_one_line(start, cache, command):
    cache.mkdir(parents=True)
    cache.chmod(0o777)
    running = start(command, "--duration=1", is_program=True)
    assert running.finish()[0] == 1
    said = [line for line in running.said if " on rrins:" not in line and line != "preparing"]
    assert said == [
        f"rrins: folder of compiled code {cache}: others can write to it (mode 777): delete it, or "
        "have XDG_CACHE_HOME name another folder"
    ]


@pytest.fixture
def copied_cache(run, cache, monkeypatch):
    """Return a cache folder for the commands of a test, with a copy of what is compiled."""
    own, copy = code_folder().path, cache / code_folder().path.name
    with monkeypatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", str(own.parents[1]))
        run("rehearse", "--duration=1")  # compiles, where nothing is compiled yet
    shutil.copytree(own, copy)
    cache.chmod(0o700)
    return copy


@pytest.mark.soak  # a function heals in tests/rrins/compiled
def test_a_rehearsal_heals_a_damaged_cache_with_one_line(start, copied_cache):
    damaged = [path for name in ("gravity", "span_of") for path in copied_cache.glob(f"*.{name}-*")]
    assert len(damaged) >= 2
    for path in damaged:
        os.truncate(path, path.stat().st_size // 2)
    for lines in (1, 0):
        running = start("rehearse", "--duration=1", is_program=True)
        assert running.finish()[0] == 0, running.said
        assert len([line for line in running.said if "compiled code in" in line]) == lines
        assert not [line for line in running.said if "Traceback" in line]


SOAK = [pytest.param(one, marks=pytest.mark.soak) for one in (("simulate",), ("firmware",))]


@pytest.mark.slow
@pytest.mark.parametrize("command", [("rehearse",), *SOAK])
def test_ctrl_c_while_it_compiles_is_one_line(start, cache, command):
    running = start(*command, "--duration=1", is_program=True)
    running.wait_for_line("compiling")
    running.process.send_signal(signal.SIGINT)
    assert running.finish()[0] == 130
    after = running.said[1 + next(k for k, line in enumerate(running.said) if "compil" in line) :]
    said = [line for line in after if line != "preparing"]  # as the other side may be only now
    assert said == ["rrins: stopped by the user"]
    assert not [line for line in running.said if re.search("Traceback|Exception", line)]
