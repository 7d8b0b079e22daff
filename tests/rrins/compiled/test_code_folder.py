"""Files of compiled code: whole or not there, and nobody else's."""

from __future__ import annotations

import logging
import os
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rrins.compiled.code_folder import CodeFolder, CodeFolderError, name_of_code
from tests.processes import Fork

FIRST, SECOND = name_of_code("core.first", "float64"), name_of_code("core.second", "float64")


def folder_with_code(tmp_path):
    """Return a folder as a start finds it: with two files, not used in this process."""
    path = tmp_path / "rrins" / "0123456789abcdef"
    shutil.rmtree(path, ignore_errors=True)
    CodeFolder(path).save(FIRST, b"code of the first")
    CodeFolder(path).save(SECOND, b"code of the second")
    return CodeFolder(path)


def messages(caplog):
    return [record.getMessage() for record in caplog.records]


def test_what_is_saved_is_loaded_and_only_its_owner_can_write_there(tmp_path):
    folder = folder_with_code(tmp_path)
    assert folder.load(FIRST) == b"code of the first"
    assert folder.load(SECOND) == b"code of the second"
    assert folder.load(name_of_code("core.third", "float64")) is None
    assert folder.path.stat().st_mode & 0o777 == 0o700
    assert folder.path.parent.stat().st_mode & 0o777 == 0o700
    assert {path.stat().st_mode & 0o777 for path in folder.path.glob("*.code")} == {0o600}


def to_folder(path):
    path.unlink()
    path.mkdir()


DAMAGES = {
    "empty": lambda path: path.write_bytes(b""),
    "cut short": lambda path: os.truncate(path, path.stat().st_size - 1),
    "cut within its checksum": lambda path: os.truncate(path, 30),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "another's content": lambda path: shutil.copy(path.with_name(SECOND), path),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "a folder": to_folder,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_file_is_gone_with_one_line_and_can_be_saved_again(tmp_path, caplog, damage):
    folder = folder_with_code(tmp_path)
    damage(folder.path / FIRST)
    assert folder.load(FIRST) is None
    assert folder.load(FIRST) is None
    assert folder.load(SECOND) == b"code of the second"
    (line,) = messages(caplog)
    assert line == (
        f"compiled code in {folder.path} was damaged: 1 file deleted, to be compiled anew"
    )
    folder.save(FIRST, b"code of the first")
    assert CodeFolder(folder.path).load(FIRST) == b"code of the first"


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=60)
@given(byte=st.integers(0, 70), bit=st.integers(0, 7))
def test_no_flipped_bit_is_overlooked(tmp_path, byte, bit):
    folder = folder_with_code(tmp_path)
    path = folder.path / FIRST
    data = bytearray(path.read_bytes())
    assert len(data) == 71
    data[byte] ^= 1 << bit
    path.write_bytes(data)
    assert folder.load(FIRST) is None
    assert not path.exists()


def test_who_finds_damage_removes_all_of_it_so_others_need_not_say_it_again(tmp_path, caplog):
    folder = folder_with_code(tmp_path)
    for name in (FIRST, SECOND):
        os.truncate(folder.path / name, 40)
    assert folder.load(FIRST) is None
    assert CodeFolder(folder.path).load(SECOND) is None
    (line,) = messages(caplog)
    assert "2 files deleted" in line


@pytest.mark.parametrize("what", ["nothing", "a file", "a dangling link"])
def test_a_folder_that_went_away_is_made_anew(tmp_path, caplog, what):
    folder = folder_with_code(tmp_path)
    shutil.rmtree(folder.path)
    if what == "a file":
        folder.path.write_bytes(b"")
    elif what == "a dangling link":
        folder.path.symlink_to(tmp_path / "nowhere")
    assert folder.load(FIRST) is None
    folder.save(FIRST, b"code")
    assert folder.load(FIRST) == b"code"
    assert not messages(caplog)


def test_two_processes_may_make_the_folder_at_once(tmp_path, caplog, monkeypatch):
    late = CodeFolder(tmp_path / "rrins" / "0123456789abcdef")
    looks = iter([False])  # the other one makes the folder after this one has looked for it
    is_dir = Path.is_dir
    monkeypatch.setattr(
        Path, "is_dir", lambda path: next(looks, None) is not False and is_dir(path)
    )
    late.path.mkdir(parents=True, mode=0o700)
    late.save(FIRST, b"code")
    assert late.load(FIRST) == b"code"
    assert not messages(caplog)


def test_a_full_disk_or_a_file_in_the_way_is_said_once(tmp_path, caplog, monkeypatch):
    (tmp_path / "rrins").write_bytes(b"")
    folder = CodeFolder(tmp_path / "rrins" / "0123456789abcdef")
    for _ in range(3):
        folder.save(FIRST, b"code")
        assert folder.load(FIRST) is None
    (line,) = messages(caplog)
    assert line.endswith("every start compiles, or have XDG_CACHE_HOME name another folder")
    assert f"{folder.path} cannot be kept: " in line


@pytest.mark.parametrize("mode", [0o770, 0o702, 0o777, 0o1777])
@pytest.mark.parametrize("which", ["the folder", "the one above"])
def test_a_folder_that_others_can_write_is_refused(tmp_path, mode, which):
    folder = folder_with_code(tmp_path)
    path = folder.path if which == "the folder" else folder.path.parent
    path.chmod(mode)
    for use in (folder.check, lambda: folder.load(FIRST), lambda: folder.save(FIRST, b"code")):
        with pytest.raises(CodeFolderError, match=rf"{path}: others can write to it \(mode .*, or"):
            use()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_a_folder_of_another_user_is_refused(tmp_path):
    folder = folder_with_code(tmp_path)
    os.chown(folder.path.parent, 4711, -1)
    with pytest.raises(CodeFolderError, match="belongs to user 4711, you are user 0: have XDG"):
        folder.load(FIRST)


def test_folders_of_former_sources_do_not_pile_up(tmp_path):
    base = tmp_path / "rrins"
    day = 24 * 3600
    now = (tmp_path.stat().st_mtime // day) * day
    base.mkdir(mode=0o700)
    for age in range(8):
        path = base / f"{age:016x}"
        path.mkdir()
        os.utime(path, (now - (age + 2) * day,) * 2)
    for age in range(8, 16):  # used within the last day
        (base / f"{age:016x}").mkdir()
    (base / "mine").mkdir()
    folder = CodeFolder(base / "abcdef0123456789")
    folder.save(FIRST, b"code")
    left = {path.name for path in base.iterdir()}
    assert left == {"mine", folder.path.name} | {f"{age:016x}" for age in range(8, 16)}


def test_what_a_killed_process_did_not_finish_is_swept_out_later(tmp_path, caplog):
    folder = folder_with_code(tmp_path)
    old, young = folder.path / ".old.part", folder.path / ".young.part"
    for path in (old, young):
        path.write_bytes(b"half")
    os.utime(old, (0, 0))
    folder.save(SECOND, b"code")
    assert not old.exists()
    assert young.exists()
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


CLAIM = """
import signal, sys
from pathlib import Path
from rrins.compiled.code_folder import CodeFolder
signal.signal(signal.SIGALRM, signal.default_int_handler)
signal.setitimer(signal.ITIMER_REAL, 1.0)
try:
    with CodeFolder(Path(sys.argv[1])).claimed(sys.argv[2]):
        print("had it")
except KeyboardInterrupt:
    print("waited")
signal.setitimer(signal.ITIMER_REAL, 0.0)
"""


def test_a_claim_keeps_other_processes_waiting_open_to_ctrl_c(tmp_path):
    folder, script = folder_with_code(tmp_path), tmp_path / "claim.py"
    script.write_text(CLAIM)

    def claim(name):
        with Fork([script, folder.path, name], stdout=subprocess.PIPE, text=True) as process:
            return process.communicate()[0].strip()

    with folder.claimed(FIRST):
        with folder.claimed(SECOND):
            assert claim(SECOND) == "waited"
        assert claim(SECOND) == "had it"
        assert claim(FIRST) == "waited"
    assert claim(FIRST) == "had it"
