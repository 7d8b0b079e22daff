"""The diagnostics in C answer as Python's do, and each reads the memory of the other."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rrins.firmware_py.core.records.initial_attitude import InitialAttitude
from rrins.firmware_py.diagnostics import parameters as p
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.access import key_of
from rrins.firmware_py.diagnostics.data_identifier import DataIdentifier
from rrins.firmware_py.diagnostics.identifiers import MemoryState
from rrins.firmware_py.diagnostics.routines import RoutineState
from rrins.firmware_py.diagnostics.store import PAGE
from rrins.host_tools.builds import build as building
from rrins.host_tools.builds import navigator, toolchain
from rrins.host_tools.builds.build import Build, build
from rrins.host_tools.builds.code import object_of
from rrins.host_tools.builds.images import Images
from rrins.host_tools.builds.targets import TARGETS
from rrins.host_tools.conformance.suite import CHECKS, conform
from rrins.host_tools.runs import run
from rrins.host_tools.runs.display import RunDisplay
from rrins.host_tools.runs.programs.program import Program
from rrins.host_tools.scenario.scenario import load
from rrins.host_tools.terminal import new_console
from rrins.host_tools.testing.errors import BenchError
from tests.firmware_py.diagnostics.test_fuzz import Requests
from tests.host_tools.builds import built_for_each
from tests.host_tools.builds.diagnosed import FUNCTIONAL, REQUEST, SANITISED, Beside, Tool, program
from tests.host_tools.builds.steps import EMULATORS

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the first of a machine compiles all

_STANDBY = {"navigate_at_s": 3600}
_FAULTS = {
    "faults": [
        {"kind": "gyro_absent", "sensor": 2, "at_s": 1, "for_s": 1},
        {"kind": "encoder_stuck", "axis": "inner", "at_s": 3},
    ]
}
_FLOW = [bytes([0x30, blocks, pause]) for blocks in (0, 1, 8) for pause in (0, 1, 5, 0xF3)]


@pytest.fixture(scope="module")
def answering(built: Build, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The navigation computer of the shared build."""
    return program(built, tmp_path_factory.mktemp("answering"))


def unlock(tool: Tool, session: int = 3) -> None:
    tool.ask(b"\x10\x03")
    if session != 3:
        tool.ask(bytes([0x10, session]))
    seed = tool.ask(b"\x27\x01")
    if seed is not None and seed[0] == 0x67:
        tool.ask(b"\x27\x02" + key_of(seed[2:]))


def ask_at_random(tool: Tool, count: int, seed: int) -> int:
    """Ask both the same, at random; return how many answers were positive."""
    rng = random.Random(seed)
    requests = Requests(seed, tool.beside.firmware.diagnostics)
    positive = 0
    for number in range(count):
        if number % 10 == 0 and rng.random() < 0.7:
            unlock(tool, rng.choice((2, 3, 3)))
        request = requests.next() or b"\x3e"
        answer = tool.ask(request, rng.choice(_FLOW), rng.random() < 0.1 and len(request) < 8)
        positive += answer is not None and answer[0] == request[0] + 0x40
    return positive


@pytest.mark.parametrize(
    "changes", [_STANDBY, {}, _FAULTS], ids=["standby", "navigating", "faults"]
)
def test_requests_are_answered_byte_by_byte_as_by_python(
    changes: Mapping[str, Any], built: Build, answering: Path
) -> None:
    beside = Beside(load("imu_rotating", **changes), answering)
    tool = Tool(beside)
    tool.run(4.0)
    assert ask_at_random(tool, 300, 1) > 50
    ours, theirs = beside.close(built.images.ram.dtype)
    assert theirs == ours


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(20))
def test_many_requests_are_answered_as_by_python(seed: int, built: Build, answering: Path) -> None:
    changes = (_STANDBY, {}, _FAULTS)[seed % 3]
    beside = Beside(load("imu_rotating", **changes), answering)
    tool = Tool(beside)
    tool.run(1.0 + 0.5 * seed)
    ask_at_random(tool, 10_000, 100 + seed)
    ours, theirs = beside.close(built.images.ram.dtype)
    assert theirs == ours


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(3))
def test_no_request_makes_the_c_do_what_is_undefined(
    seed: int, built: Build, tmp_path: Path
) -> None:
    if shutil.which(SANITISED[0]) is None:
        pytest.skip(f"needs {SANITISED[0]}")
    beside = Beside(
        load("imu_rotating", **(_STANDBY, {}, _FAULTS)[seed]),
        program(built, tmp_path, SANITISED),
        (tmp_path / "ours", tmp_path / "theirs"),
    )
    tool = Tool(beside)
    tool.run(4.0)
    ask_at_random(tool, 5000, 200 + seed)
    send_at_random(tool, 5000, 300 + seed)
    ours, theirs = beside.close(built.images.ram.dtype)
    assert theirs == ours


def send_at_random(tool: Tool, epochs: int, seed: int) -> None:
    """Send both the same frames of all kinds, in any order."""
    rng = random.Random(seed)
    for _ in range(epochs):
        frames = []
        for _ in range(rng.choice((0, 0, 1, 1, 2, 8))):
            way = rng.randrange(5)
            if way == 0:
                frame = rng.randbytes(rng.randrange(9))
            elif way == 1:
                frame = rng.choice(_FLOW) + rng.randbytes(rng.randrange(6))
            elif way == 2:
                length = rng.choice((0, rng.randrange(512)))
                frame = bytes([0x10 | length >> 8, length & 0xFF]) + rng.randbytes(6)
            elif way == 3:
                frame = bytes([0x20 | rng.randrange(16)]) + rng.randbytes(7)
            else:
                frame = rng.choice((b"\x03\x22\x02\x02", b"\x03\x22\x02\x21", b"\x02\x3e\x00"))
            frames.append((rng.choice((REQUEST, REQUEST, FUNCTIONAL)), frame))
        tool.beside.step(frames)


def test_frames_of_all_kinds_are_answered_as_by_python(built: Build, answering: Path) -> None:
    beside = Beside(load("imu_rotating"), answering)
    send_at_random(Tool(beside), 2000, 1)
    ours, theirs = beside.close(built.images.ram.dtype)
    assert theirs == ours


def drawn(did: DataIdentifier, rng: random.Random) -> bytes:
    """Return a data record of a parameter, within its limits, and usable."""
    values: dict[str, Any] = {}
    for field in did.fields:
        low, high = field.minimum, field.maximum
        if field.name == "method":
            values[field.name] = rng.choice((InitialAttitude.GIVEN, InitialAttitude.SELF_ALIGNED))
        elif field.choices is not None:
            values[field.name] = int(rng.choice(list(field.choices)))
        elif field.name == "weights":
            values[field.name] = tuple(rng.uniform(0.3, 3.0) for _ in range(field.count))
        elif field.name == "alignment_s":
            values[field.name] = rng.uniform(0.5, 2.0)
        else:
            assert low is not None
            assert high is not None
            share = 1.0 if abs(high) < 200.0 else 1e-3
            value = rng.uniform(max(low, -share * high), share * high)
            values[field.name] = round(value) if field.format != "f64" else value
    return did.encode(values)


def compare_memories(beside: Beside, images: Images) -> None:
    """Switch both off; their memories are equal, up to how rounding began an estimator's."""
    ours, theirs = beside.close(images.ram.dtype)
    if images.variant.estimates:
        mine, its = (
            np.frombuffer(memory, images.ram.dtype)[0]["estimator"]["attitude_sigma"]
            for memory in (ours, theirs)
        )
        assert its == pytest.approx(mine, rel=1e-12)
    else:
        assert theirs == ours


def write_and_reset(seed: int, name: str, program: Path, images: Images, folder: Path) -> None:
    """Write parameters to both, reset both, and let each go on with what the other has stored."""
    rng = random.Random(seed)
    memories = folder / "ours", folder / "theirs"
    beside = Beside(load(name, **_STANDBY), program, memories)
    tool = Tool(beside)
    tool.run(2.0)
    unlock(tool)
    written = 0
    for did in p.PARAMETERS:
        if rng.random() < 0.8:
            answer = tool.ask(b"\x2e" + did.number.to_bytes(2, "big") + drawn(did, rng))
            written += answer is not None and answer[0] == 0x6E
    assert tool.ask(b"\x11\x01") == b"\x51\x01"
    tool.run(1.0)
    state = tool.ask(b"\x22\x01\x09")
    assert state is not None
    found = table.identifier("parameter_memory").decode(state[3:])
    assert found["state"] == MemoryState.MEMORY
    assert isinstance(found["parameters"], int)
    assert found["parameters"] >= written > 10
    tool.run(5.0)
    ask_at_random(tool, 50, seed)
    compare_memories(beside, images)
    for suffix in ("", ".dtc"):
        mine, its = (path.with_name(path.name + suffix).read_bytes() for path in memories)
        assert its == mine
    beside = Beside(load(name), program, memories[::-1])
    tool = Tool(beside)
    tool.run(6.0)
    assert tool.ask(b"\x22\x01\x09") is not None
    assert tool.ask(b"\x19\x02\xff") is not None
    compare_memories(beside, images)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(k, marks=pytest.mark.soak) for k in range(2, 30))]
)
def test_parameters_take_effect_as_in_python(
    seed: int, built: Build, answering: Path, tmp_path: Path
) -> None:
    write_and_reset(seed, "imu_rotating", answering, built.images, tmp_path)


@pytest.mark.parametrize("routine", ["calibration", "table_calibration", "go_to_axis_angle"])
def test_a_routine_runs_as_in_python(routine: str, built: Build, answering: Path) -> None:
    beside = Beside(load("imu_rotating", **_STANDBY), answering)
    tool = Tool(beside)
    tool.run(2.0)
    unlock(tool)
    one = table.routine(routine)
    axes, angles = (0, 1, 0) + 61 * (0,), (90.0, -30.0, -90.0) + 61 * (0.0,)
    arguments = {
        "calibration": {"duration_s": 3, "store": 0},
        "table_calibration": {
            "positions": 3, "first": 1, "turn_rate_dps": 40.0, "stand_s": 1.5, "axis": axes,
            "angle_deg": angles,
        },
        "go_to_axis_angle": {"axis": 1, "angle_deg": 12.5},
    }[routine]  # fmt: skip
    number = one.number.to_bytes(2, "big")
    encoded = one.argument_layout.encode(arguments)  # type: ignore[arg-type]  # of all kinds
    assert tool.ask(b"\x31\x01" + number + encoded)
    for _ in range(120):
        results = tool.ask(b"\x31\x03" + number)
        if results is None or results[4] != RoutineState.RUNNING:
            break
        tool.run(1.0)
    assert results is not None
    assert results[4] == RoutineState.DONE
    if routine == "table_calibration":
        assert tool.ask(b"\x23\x24\x20\x00\x00\x00\x00\x40") is not None
    ours, theirs = beside.close(built.images.ram.dtype)
    assert theirs == ours


def test_a_power_cut_while_the_memory_is_written_leaves_what_was_there_before(
    built: Build, answering: Path, tmp_path: Path
) -> None:
    memory = tmp_path / "memory"
    bridge = p.PARAMETERS[3]
    request = b"\x2e" + bridge.number.to_bytes(2, "big")

    def start() -> Tool:
        return Tool(Beside(load("imu_rotating", **_STANDBY), answering, (tmp_path / "own", memory)))

    def write(seconds: float) -> bytes:
        tool = start()
        tool.run(2.0)
        unlock(tool)
        assert tool.ask(request + bridge.encode({"bridge_s": seconds})) is not None
        tool.beside.close(built.images.ram.dtype)
        return memory.read_bytes()

    write(1.0)
    before, after = write(2.0), write(3.0)
    own = (tmp_path / "own").read_bytes()
    assert own == after
    changed = [k for k in range(len(before)) if before[k] != after[k]]
    assert changed
    assert changed[-1] - changed[0] < PAGE, "both copies were written"
    cuts = range(changed[0], changed[-1] + 1, 7)
    for cut in (*cuts, changed[-1] + 1):
        torn = after[:cut] + before[cut:]
        for path in (memory, tmp_path / "own"):
            path.write_bytes(torn)
        tool = start()
        tool.beside.step()
        found = tool.ask(b"\x22" + request[1:])
        assert found is not None
        value = bridge.decode(found[3:])["bridge_s"]
        assert value == (3.0 if cut > changed[-1] else 2.0)
        tool.beside.close(built.images.ram.dtype)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["rimu_rotating", "drive_aided", "ship_moored"])
def test_other_scenarios_are_diagnosed_as_by_python(name: str, tmp_path: Path) -> None:
    built = build(load(name), name, "x86_64-linux", tmp_path)
    path = program(built, tmp_path)
    for seed, changes in enumerate((_STANDBY, {}, _FAULTS)):
        beside = Beside(load(name, **changes), path)
        tool = Tool(beside)
        tool.run(20.0)
        ask_at_random(tool, 3000, seed)
        ours, theirs = beside.close(built.images.ram.dtype)
        assert theirs == ours
    tool = Tool(Beside(load(name, **_STANDBY), path))
    tool.run(2.0)
    unlock(tool)
    record = table.identifier("gyro_weights").encode(
        {"weights": (1e-9, 1e-9, 1.0, 1e9, *12 * [1.0])}
    )
    assert tool.ask(b"\x2e\x10\x07" + record) == b"\x6e\x10\x07"  # H' W H is singular in doubles
    tool.beside.close(built.images.ram.dtype)
    for seed in range(10):
        folder = tmp_path / str(seed)
        folder.mkdir()
        write_and_reset(seed, name, path, built.images, folder)


@pytest.mark.soak
@pytest.mark.parametrize("target", [name for name, one in TARGETS.items() if one.has_linux])
def test_the_c_has_no_warning_for_any_processor(target: str, built: Build, tmp_path: Path) -> None:
    for name in navigator.write_sources(tmp_path, built.images):
        toolchain.zig(
            "cc", "-target", TARGETS[target].system, "-std=c11", *navigator.STRICT, "-c",
            "-I", built.folder, "-I", tmp_path, tmp_path / name, "-o", tmp_path / f"{name}.o",
        )  # fmt: skip


def test_a_file_that_is_no_memory_is_refused_with_a_line(answering: Path, tmp_path: Path) -> None:
    other, taken = tmp_path / "other", tmp_path / "taken"
    other.write_text("not ours\n")
    with taken.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        for path, reason in (
            (other, "not a memory of this kind; left unchanged"),
            (taken, "in use by another firmware process"),
            (tmp_path, "is not a file"),
            (tmp_path / "none" / "memory", "cannot be opened: No such file or directory"),
        ):
            done = subprocess.run([answering, path], input=b"", capture_output=True, check=False)
            assert (done.returncode, done.stderr.decode()) == (1, f"{reason}\n")
    assert other.read_text() == "not ours\n"


def build_for(scenario_file: Path, folder: Path, target: str) -> None:
    """Build the program for a scenario, where `built_for_each` looks; steps are kept."""
    images = Images.of(load(str(scenario_file)))
    made = folder / hashlib.sha256(images.setup.encode() + images.ram.tobytes()).hexdigest()[:16]
    if not made.exists():
        made.mkdir()
        step = folder / f"{hashlib.sha256(str(images.variant).encode()).hexdigest()[:16]}.o"
        if not step.exists():
            step.write_bytes(object_of("firmware", images.variant, target))
        (made / "rrins_firmware.o").write_bytes(step.read_bytes())
        (made / "rrins_images.o").write_bytes(building._images_object(images, TARGETS[target]))
        for name, text in (building._headers(images) | building._frames()).items():
            (made / name).write_text(text)
        navigator.link(made, TARGETS[target], images)
    built_for_each.place(scenario_file, folder).symlink_to(made / "navigator")


@pytest.mark.soak
@pytest.mark.parametrize("target", ["x86_64-linux", "aarch64-linux"])
def test_the_program_passes_all_checks_each_with_the_set_up_that_it_was_built_for(
    target: str, tmp_path: Path
) -> None:
    if EMULATORS[target] and shutil.which(EMULATORS[target][0]) is None:
        pytest.skip(f"needs {EMULATORS[target][0]}: Debian's qemu-user")
    starter = (sys.executable, "-S", built_for_each.__file__, str(tmp_path))
    words = shlex.join((*starter, *EMULATORS[target]))
    outcomes = {}
    for check in CHECKS:
        wanted: list[Path] | None = None
        while wanted or wanted is None:
            (finding,) = conform(words, (check,))
            wanted = list(tmp_path.glob(built_for_each.WANTED))
            for file in wanted:
                build_for(file, tmp_path, target)
                file.unlink()
        outcomes[check.name] = finding.outcome, finding.line
        print(check.name, *outcomes[check.name], flush=True)
    assert {name: one for name, one in outcomes.items() if one[0] != "passed"} == {}


def test_a_program_that_is_stopped_ends_its_epoch_and_writes_its_trouble_codes(
    built: Build, tmp_path: Path, rrins_bench: Callable[..., Any]
) -> None:
    linked = navigator.link(built.folder, TARGETS[built.target], built.images)
    memory = tmp_path / "memory"
    bench = rrins_bench("imu_rotating", program=f"{linked} --memory {memory}")
    bench.advance(1)
    (process,) = processes_of(linked)
    os.kill(process, signal.SIGTERM)
    with pytest.raises(BenchError, match="SIGTERM"):
        bench.advance(1)
    assert memory.with_name("memory.dtc").stat().st_size > 0


@pytest.mark.soak
@pytest.mark.skipif(os.geteuid() != 0, reason="real-time priority needs root")
def test_in_real_time_the_loop_has_its_priority_and_the_memory_is_written_beside_it(
    built: Build, tmp_path: Path
) -> None:
    """musl's `sched_setscheduler` refuses always: the program asks the kernel itself."""
    program = navigator.link(built.folder, TARGETS[built.target], built.images)
    memory = tmp_path / "memory"
    scenario = load("imu_rotating", duration_s=5.0)
    plan = run.Plan(
        "imu_rotating",
        scenario,
        run.Overrides(5.0),
        speed=1.0,
        firmware=Program.parse(f"{program} --memory {memory}"),
    )
    policies: set[int] = set()
    with RunDisplay(scenario, new_console(stderr=True), quiet=True) as display:
        watching = threading.Event()
        watcher = threading.Thread(target=watch, args=(program, policies, watching))
        watcher.start()
        outcome = run.rehearse(plan, display)
        watching.set()
        watcher.join()
    outcome.check()
    assert policies == {os.SCHED_FIFO}
    assert memory.with_name("memory.dtc").stat().st_size > 0


def watch(program: Path, policies: set[int], is_over: threading.Event) -> None:
    """Note the scheduling policies of the processes of a program, but those of its first second."""
    while not is_over.wait(1.0):
        policies |= {os.sched_getscheduler(process) for process in processes_of(program)}


def processes_of(program: Path) -> Iterator[int]:
    """Return the processes that run a program."""
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if (process / "exe").samefile(program):
                yield int(process.name)
