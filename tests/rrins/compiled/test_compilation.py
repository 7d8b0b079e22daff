"""Compiled code between runs: kept, healed, and not torn by Ctrl-C."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from rrins.compiled import code_folder
from rrins.compiled.code_folder import CodeFolder
from rrins.compiled.compilation import compiled_with
from rrins.compiled.compile_events import compiling_watched
from tests.processes import Fork

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


def half(x):
    return x / 2


def square(x):
    return x * x


@pytest.fixture
def folder(tmp_path):
    return CodeFolder(tmp_path / "rrins" / "0123456789abcdef")


def start(folder, function=half, argument=5):
    """Return the result of a function as a new process gets it, and how many were compiled."""
    counts = [0]
    with compiling_watched(counts.append):
        result = compiled_with(CodeFolder(folder.path))(function)(argument)
    return result, counts[-1]


def test_a_function_is_compiled_once_for_each_signature(folder):
    assert start(folder) == (2.5, 1)
    assert start(folder) == (2.5, 0)
    assert start(folder, argument=5.0) == (2.5, 1)
    assert start(folder, argument=5.0) == (2.5, 0)
    assert start(folder, square) == (25, 1)
    assert len(list(folder.path.glob("*.part-*.code"))) == 3


PLUS = """
from pathlib import Path
from rrins.compiled.code_folder import CodeFolder
from rrins.compiled.compilation import compiled_with
NUMBER = {number}
@compiled_with(CodeFolder(Path({folder!r})))
def plus(x):
    return x + NUMBER
"""


def test_code_of_a_source_that_changed_since_it_was_imported_is_not_that_of_the_new_one(
    folder, tmp_path
):
    path = tmp_path / "plus.py"

    def imported(number):
        path.write_text(PLUS.format(number=number, folder=str(folder.path)))
        spec = importlib.util.spec_from_file_location("plus", path)
        module = importlib.util.module_from_spec(spec)
        exec(compile(path.read_text(), path, "exec"), vars(module))
        return module.plus

    old = imported(1)
    new = imported(2)
    assert (old(10), new(10)) == (11, 12)
    assert (imported(1)(10), imported(2)(10)) == (11, 12)


def code_of(folder, name):
    """Return the file of a function that Python calls, or that of a part, whose name is longer."""
    (path,) = folder.path.glob(f"*{name}-*.code")
    return path


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.999])
def test_code_cut_short_is_made_anew(folder, caplog, share):
    start(folder)
    path = code_of(folder, "half")
    whole = path.read_bytes()
    os.truncate(path, int(len(whole) * share))
    assert start(folder) == (2.5, 0)  # made anew of its part
    assert path.read_bytes() == whole
    assert len(caplog.records) == 1


def test_flipped_bits_are_never_run(folder, caplog):
    start(folder)
    path = code_of(folder, "half")
    whole = path.read_bytes()
    step = len(whole) // 12
    for byte in range(0, len(whole), step):
        path.write_bytes(whole[:byte] + bytes([whole[byte] ^ 0x10]) + whole[byte + 1 :])
        assert start(folder) == (2.5, 0), byte  # made anew of its part
        assert path.read_bytes() == whole
    assert len(caplog.records) == len(range(0, len(whole), step))


def test_exchanged_code_is_not_run(folder, caplog):
    start(folder)
    start(folder, square)
    one, other = code_of(folder, "half"), code_of(folder, "square")
    first, second = one.read_bytes(), other.read_bytes()
    one.write_bytes(second)
    other.write_bytes(first)
    assert start(folder) == (2.5, 0)
    assert start(folder, square) == (25, 0)
    assert (one.read_bytes(), other.read_bytes()) == (first, second)
    assert len(caplog.records) == 1  # both are deleted at once


def test_a_file_that_was_written_wrong_is_made_anew(folder, caplog):
    start(folder)
    folder.save(code_of(folder, "half").name, b"no object, but with its checksum")
    assert start(folder) == (2.5, 0)
    assert len(caplog.records) == 1


def test_arguments_and_results_are_those_of_python(folder):
    @compiled_with(folder)
    def told(number, whole, flag, nothing, table, record):
        table[1, 0] += record["x"]
        is_none = nothing is None
        return number * 2, whole, not flag, (is_none, table.shape[1]), table[1, 0]

    table = np.arange(6.0).reshape(2, 3)
    record = np.zeros(1, np.dtype((np.record, [("x", "<f8"), ("k", "u1")])))[0]
    record["x"] = 0.5
    for given in (table, np.asfortranarray(table), np.stack([table, table])[0, :, ::1]):
        given[1, 0] = 3.0
        assert told(1.5, 2, True, None, given, record) == (3.0, 2, False, (True, 3), 3.5)
    assert told(1, np.uint64(2**64 - 2), False, 0, table, record)[:2] == (2, 2**64 - 2)
    named = {"nothing": None, "table": table, "record": record}
    assert told(1, whole=-1, flag=0, **named)[1:3] == (-1, True)
    with pytest.raises(TypeError, match="compiled code takes no str"):
        told("1", 2, True, None, table, record)
    with pytest.raises(TypeError, match="missing"):
        told(1, 2)


def test_what_allocates_is_refused(folder):
    @compiled_with(folder)
    def makes(table):
        table[0] = np.zeros(2)[0]

    @compiled_with(folder)
    def moves(table):
        table[0:2] = table[1:3]

    for function in (makes, moves):
        with pytest.raises(TypeError, match=rf"allocates nothing.*{function.__name__}\)"):
            function(np.arange(3.0))


def test_calls_leave_the_counts_of_references_as_they_were(folder):
    @compiled_with(folder)
    def nothing(array, flag):
        array[0] = flag
        return None, flag, 1.5

    @compiled_with(folder)
    def none(array):
        array[0] = 0.0

    array = np.zeros(1)
    counted = (None, True, array)
    nothing(array, True)
    none(array)
    before = [sys.getrefcount(each) for each in counted]
    for _ in range(1000):
        nothing(array, True)
        none(array)
    after = [sys.getrefcount(each) for each in counted]
    assert all(abs(b - a) < 100 for a, b in zip(before, after, strict=True))


def test_an_exception_of_compiled_code_is_that_of_python(folder):
    @compiled_with(folder)
    def divide(a, b):
        if b < 0:
            raise ValueError("b is negative")
        return a // b

    assert divide(7, 2) == 3
    with pytest.raises(ZeroDivisionError, match="by zero"):
        divide(7, 0)
    with pytest.raises(ValueError, match="b is negative"):
        divide(7, -1)


def test_code_that_is_kept_runs_without_the_compiler(folder, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT + "print('numba' in sys.modules)\n")
    command = [sys.executable, script, folder.path]
    for is_compiling in (True, False):
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        assert said == f"5 6.5\n{is_compiling}\n"


STEPS = """
import rrins
said = rrins.simulate("rimu_rotating", duration_s=0.02).summary["navigation_sha256"]
"""


@pytest.mark.parametrize("is_of_numba", [True, False])
def test_a_numba_that_cannot_compile_the_steps_is_done_without(is_of_numba, tmp_path):
    """One that nobody has tried: tried once, and then all is plain Python, with the same bytes.

    If the trial failed for lack of memory, the next start tries again."""
    (tmp_path / "numba").mkdir()
    code = "" if is_of_numba else "raise MemoryError('not for numba')"
    (tmp_path / "numba" / "__init__.py").write_text(code)
    (tmp_path / "numba-99.0.dist-info").mkdir()
    (tmp_path / "numba-99.0.dist-info" / "METADATA").write_text("Name: numba\nVersion: 99.0\n")
    paths = os.pathsep.join((str(tmp_path), *sys.path))
    environment = os.environ | {"PYTHONPATH": paths, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    environment.pop("NUMBA_CACHE_DIR", None)

    def lines_of(script):
        arguments = [sys.executable, "-c", script]
        done = subprocess.run(arguments, env=environment, capture_output=True, text=True)
        return done.stdout, done.stderr.splitlines()

    scope = {}
    exec(STEPS, scope)
    said, first = lines_of(f"{STEPS}print(said)")
    assert said == f"{scope['said']}\n"
    _, second = lines_of("import rrins.compiled.compilation")
    assert first[0].startswith("numba 99.0 is newer than any that was tried")
    assert second == (first[1:] if is_of_numba else first)
    assert second[-1].startswith("numba 99.0 cannot compile the steps (")
    assert "numba" in second[-1].partition("(")[2].partition(")")[0]  # what is missing in it
    assert "): all runs as plain Python" in second[-1]


def test_objects_that_the_package_carries_are_used_if_they_are_of_its_sources(
    folder, tmp_path, monkeypatch
):
    start(folder)
    carried = tmp_path / "objects"
    carried.mkdir()
    file = code_of(folder, "half").name
    (carried / file).write_bytes(folder.load(file))
    monkeypatch.setattr(code_folder, "SHIPPED", carried)
    for key, compiled in ((code_folder.shipped_key(), 0), ("of other sources", 1)):
        (carried / code_folder.KEY).write_text(key)
        code_folder.shipped.cache_clear()
        empty = CodeFolder(tmp_path / "rrins" / f"{compiled:016}")
        assert start(empty) == (2.5, compiled)
        assert empty.path.exists() == bool(compiled)
    monkeypatch.undo()
    code_folder.shipped.cache_clear()


SCRIPT = """
import sys
from pathlib import Path
from rrins.compiled.code_folder import CodeFolder
from rrins.compiled.compilation import compiled_with
keep = compiled_with(CodeFolder(Path(sys.argv[1])))
@keep
def inner(x):
    return x + 1
@keep
def outer(x):
    return inner(x) + inner(x + 0.5)
print(inner(4), outer(1.0) + 2)
"""


def begin(script, *arguments):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return Fork([script, *arguments], text=True, **pipes)


def run(script, *arguments):
    with begin(script, *arguments) as process:
        out, err = process.communicate(timeout=100)
    return subprocess.CompletedProcess(script, process.returncode, out, err)


def test_processes_that_start_at_once_do_not_disturb_each_other(folder, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    for process in [begin(script, folder.path) for _ in range(2)]:
        with process:
            assert process.communicate(timeout=100) == ("5 6.5\n", "")
        assert process.returncode == 0


INTERRUPTED_AT_MANY_INSTANTS = """
import signal, sys
from pathlib import Path
from llvmlite.binding import ffi
from rrins.compiled import compile_events
from rrins.compiled.code_folder import CodeFolder
from rrins.compiled.compilation import compiled_with
keep = compiled_with(CodeFolder(Path(sys.argv[1])))
# A signal in the place of Ctrl-C that comes when it is wanted, however busy the machine is.
compile_events._SIGNALS = (signal.SIGVTALRM,)
signal.signal(signal.SIGVTALRM, signal.default_int_handler)

def watch(kind, let_go):
    def watched(self):
        if signal.getsignal(signal.SIGVTALRM) is signal.default_int_handler:
            print(kind.__name__, "would lose an interruption", file=sys.stderr)
        let_go(self)
    kind.__del__ = watched
for kind in ffi.ObjectRef, ffi.OutputString:
    watch(kind, kind.__del__)

stopped, kept = 0, []  # an interruption of numba's farewell to a function would be lost
for k in range(41):
    @keep
    def inner(x):
        return x * k + 1
    @keep
    def outer(x):
        return inner(x) + k
    kept += inner, outer
    try:
        if k:
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.003 * k - 0.002)
        outer(1)
        while k:
            pass
    except KeyboardInterrupt:
        stopped += 1
print(stopped)
"""


def test_ctrl_c_while_compiling_stops_without_a_traceback(folder, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(INTERRUPTED_AT_MANY_INSTANTS)
    done = subprocess.run(  # a process that has not loaded LLVM yet, as a fork has
        [sys.executable, script, folder.path], capture_output=True, text=True, timeout=200
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "40\n"


PARTS = """
import sys
from rrins.compiled.code_folder import code_folder
code_folder.cache_clear()  # that of the server
from rrins.compiled.compilation import compiled, compiled_with
from rrins.compiled.compile_events import compiling_watched
@compiled
def deepest(x):
    return x + 0.5
@compiled_with(is_unit=True)
def inner(x):
    return deepest(x) * 2
@compiled
def other(x):
    return deepest(x) * 3
@compiled
def outer(x):
    return inner(x) + other(x)
counts = [0]
with compiling_watched(counts.append):
    value = globals()[sys.argv[1]](1.0)
print(value, counts[-1])
"""


@pytest.fixture
def parts(tmp_path, monkeypatch):
    """Return what calls a function of `PARTS` in a new process: its value, and what it compiled."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    script = tmp_path / "script.py"
    script.write_text(PARTS)

    def call(name):
        done = run(script, name)
        assert done.returncode == 0, done.stderr
        value, count = done.stdout.split()
        return float(value), int(count)

    return call


def test_parts_are_compiled_once_for_all_callers(parts):
    assert parts("outer") == (7.5, 4)  # deepest, inner, other and outer
    assert parts("outer") == (7.5, 0)
    assert parts("inner") == (3.0, 0)  # its part is there


def test_a_damaged_part_is_compiled_anew_with_who_calls_it(parts, tmp_path):
    assert parts("inner") == (3.0, 2)
    folder = CodeFolder(next(p for p in (tmp_path / "cache" / "rrins").iterdir() if p.is_dir()))
    path = code_of(folder, "deepest.part")
    os.truncate(path, path.stat().st_size // 2)
    assert parts("outer") == (7.5, 4)
    folder.save(path.name, b"no pickle, but with its checksum")
    assert parts("other") == (4.5, 2)
    unit = code_of(folder, "inner.unit")
    os.truncate(unit, unit.stat().st_size // 2)
    assert parts("outer") == (7.5, 0)  # made of its parts


def test_what_is_compiled_with_numba_alone_calls_our_functions(folder):
    @compiled_with(folder)
    def deepest(x):
        return x + 0.5

    @compiled_with(folder)
    def inner(x):
        return deepest(x) * 2

    @numba.njit
    def outer(x):
        return inner(x) + 1

    assert outer(1.0) == 4.0


BESIDE = """
import os, sys, time
from pathlib import Path
from rrins.compiled.code_folder import code_folder
from rrins.compiled.compilation import compiled
from rrins.compiled.compile_events import compiling_watched
from rrins.compiled.compiled_beside import Beside, compiled_beside
code_folder.cache_clear()  # that of the server
@compiled
def inner(x):
    return x + 0.5
@compiled
def other(x):
    return x * 2
@compiled
def outer(x):
    return inner(x) + other(x)
counts = [0]
with compiling_watched(counts.append), compiled_beside(Beside(other, (float,))):
    inner(1.0)
    while not list(code_folder().path.glob("*.other.part-*.code")):
        time.sleep(0.01)
    value = outer(1.0)
try:
    os.waitpid(-1, 0)
except ChildProcessError:
    print(value, counts[-1])
"""


def test_a_second_process_compiles_parts_and_is_gone_with_the_block(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    script = tmp_path / "script.py"
    script.write_text(BESIDE)
    done = run(script)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "3.5 2\n"  # inner and outer; not the other
