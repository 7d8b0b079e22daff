"""The modes: every transition of the table, and every one that is none."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rrins.dbc.values import AxisCommand, AxisState
from rrins.firmware_py.core.modes import modes
from rrins.firmware_py.core.modes.modes import FirmwareFault, Mode, ModeRequest
from rrins.firmware_py.core.records.memory import Ins
from rrins.firmware_py.core.settings import power_on

STRAPDOWN, ROTATING = Mode.NAVIGATION_STRAPDOWN, Mode.NAVIGATION_ROTATING

CHANGES = {  # what a request does at once; all others leave the mode
    **{(mode, ModeRequest.SHUTDOWN): Mode.SHUTDOWN for mode in Mode},
    **{(mode, ModeRequest.STANDBY): Mode.STANDBY for mode in Mode},
    (Mode.FAULT, ModeRequest.STANDBY): Mode.SELF_TEST,
    (Mode.POWER_ON, ModeRequest.STANDBY): Mode.POWER_ON,
    (Mode.SELF_TEST, ModeRequest.STANDBY): Mode.SELF_TEST,
    (Mode.SHUTDOWN, ModeRequest.STANDBY): Mode.SHUTDOWN,
    (STRAPDOWN, ModeRequest.NAVIGATE_ROTATING): ROTATING,
    (ROTATING, ModeRequest.NAVIGATE_STRAPDOWN): STRAPDOWN,
    (Mode.FINE_ALIGNMENT, ModeRequest.ALIGN): Mode.STANDBY,
}


@pytest.fixture
def state(tools, contract):
    return power_on(tools.settings(), contract)[0]


def in_mode(bench, mode):
    """Put a bench into a mode as the operator would; FAULT by failing."""
    if mode == Mode.FAULT:
        modes.fail(bench.state, FirmwareFault.SENSORS_LOST)
        return bench
    request = {
        Mode.ALIGNMENT: ModeRequest.ALIGN,
        STRAPDOWN: ModeRequest.NAVIGATE_STRAPDOWN,
        ROTATING: ModeRequest.NAVIGATE_ROTATING,
        Mode.SHUTDOWN: ModeRequest.SHUTDOWN,
    }.get(mode)
    bench.run_to(mode, request)
    return bench


@pytest.mark.parametrize("request_", [*ModeRequest, 9, 15])
@pytest.mark.parametrize("mode", Mode)
def test_a_request_changes_the_mode_as_the_table_says(state, mode, request_):
    state["modes"]["mode"] = mode
    state["modes"]["requested"] = request_
    modes.follow_request(state)
    assert state["modes"]["mode"] == CHANGES.get((mode, request_), mode)


def test_names_and_numbers_are_those_of_the_dbc(tools):
    choices = tools.codec.choices
    assert {int(m): m.name for m in Mode} == choices("FIRMWARE_STATUS", "mode")
    assert {int(f): f.name for f in FirmwareFault} == choices("FIRMWARE_STATUS", "fault")
    assert {int(r): r.name for r in ModeRequest} == choices("MODE_COMMAND", "mode_request")


def test_power_on_leads_through_the_self_test_to_standby(tools):
    bench = tools.Bench()
    assert bench.mode == Mode.POWER_ON
    bench.step()
    assert bench.mode == Mode.SELF_TEST
    for _ in range(99):
        bench.step()
        assert bench.mode == Mode.SELF_TEST
    bench.step()  # half a second at 200 Hz
    assert bench.mode == Mode.STANDBY


def test_an_unsound_epoch_takes_ten_sound_ones_back(tools):
    bench = tools.Bench()
    for _ in range(90):
        bench.step()
    bench.step(bench.frames()[:-1])
    for _ in range(20):
        bench.step()
        assert bench.mode == Mode.SELF_TEST
    bench.step()
    assert bench.mode == Mode.STANDBY


@pytest.mark.parametrize(("every", "mode"), [(15, Mode.STANDBY), (9, Mode.SELF_TEST)])
def test_a_bus_that_loses_a_frame_in_a_hundred_passes_the_self_test(tools, every, mode):
    bench = tools.Bench()
    for epoch in range(1000):
        bench.step(bench.frames()[:-1] if epoch % every == 1 else bench.frames())
    assert bench.mode == mode


@pytest.mark.parametrize("missing", range(7))
def test_the_self_test_needs_sync_all_sensors_and_both_axes(tools, missing):
    bench = tools.Bench(rate_hz=50)
    bench.step()
    for _ in range(499):
        frames = bench.frames()
        del frames[missing]
        bench.step(frames)
        assert bench.mode == Mode.SELF_TEST
    bench.step(bench.frames()[:-1])
    assert bench.mode == Mode.FAULT  # ten seconds at 50 Hz
    assert bench.state["modes"]["fault"] == FirmwareFault.SELF_TEST_FAILED


def test_the_self_test_refuses_an_axis_in_fault(tools):
    bench = tools.Bench(rate_hz=50)
    for _ in range(100):
        frames = bench.frames()
        frames[-1] = tools.frame("AXIS_OUTER_STATUS", bench.epoch, state=AxisState.FAULT)
        bench.step(frames)
    assert bench.mode == Mode.SELF_TEST


@pytest.mark.parametrize(
    ("request_", "end"),
    [
        (ModeRequest.ALIGN, Mode.ALIGNMENT),
        (ModeRequest.NAVIGATE_STRAPDOWN, STRAPDOWN),
        (ModeRequest.NAVIGATE_ROTATING, ROTATING),
        (ModeRequest.NONE, Mode.STANDBY),
    ],
)
def test_what_is_asked_for_at_power_on_is_remembered(tools, request_, end):
    bench = tools.Bench()
    bench.step(request=request_)
    seen = {bench.mode}
    for _ in range(130):
        bench.step()
        seen.add(bench.mode)
    assert bench.mode == end
    assert (Mode.ALIGNMENT in seen) == (request_ != ModeRequest.NONE)


@pytest.mark.parametrize("rotating", [False, True])
def test_alignment_alone_waits_for_the_request_to_navigate(tools, rotating):
    bench = in_mode(tools.Bench(), Mode.ALIGNMENT)
    for _ in range(100):
        bench.step()
    assert bench.mode == Mode.ALIGNMENT
    assert bench.state["alignment"]["done"]
    asked = ModeRequest.NAVIGATE_ROTATING if rotating else ModeRequest.NAVIGATE_STRAPDOWN
    bench.step(request=asked)
    assert bench.mode == (ROTATING if rotating else STRAPDOWN)


def test_an_alignment_waits_for_axes_that_still_turn_but_not_for_ever(tools):
    bench = in_mode(tools.Bench(rate_hz=50), Mode.STANDBY)
    bench.state.modes.pending = Mode.ALIGNMENT
    bench.state.assembly.encoder_rate_dps[1] = -1.0
    for _ in range(20):
        modes.standby(bench.state)
        assert bench.mode == Mode.STANDBY
    bench.state.modes.epochs = 10 * 50
    modes.standby(bench.state)
    assert bench.mode == Mode.ALIGNMENT


def test_alignment_takes_its_time(tools):
    bench = in_mode(tools.Bench(alignment_s=0.5), Mode.STANDBY)
    bench.step(request=ModeRequest.NAVIGATE_STRAPDOWN)
    for _ in range(99):
        bench.step()
        assert bench.mode == Mode.ALIGNMENT
    bench.step()
    assert bench.mode == STRAPDOWN


@pytest.mark.parametrize("mode", [STRAPDOWN, ROTATING])
@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("velocity_n", [3001, 0, 0]),
        ("velocity_n", [0, 0, math.nan]),
        ("latitude", math.radians(89.995)),
        ("latitude", -math.radians(89.995)),
    ],
)
def test_a_solution_beyond_reason_is_a_fault(tools, mode, field, value):
    bench = in_mode(tools.Bench(height_channel="free"), mode)
    bench.state["ins"][field] = value
    bench.step()
    assert bench.mode == Mode.FAULT
    assert bench.state["modes"]["fault"] == FirmwareFault.NAVIGATION_DIVERGED


def test_a_plausible_solution_is_let_be():
    ins = np.zeros(1, dtype=Ins.dtype)[0]
    ins["velocity_n"] = [1700, 1700, 1700]
    ins["latitude"] = math.radians(89.9)
    assert modes.plausible(ins)


def test_rotation_is_tried_again_unless_the_operator_has_given_it_up(tools):
    for asked in (ModeRequest.NAVIGATE_ROTATING, ModeRequest.NAVIGATE_STRAPDOWN):
        bench = in_mode(tools.Bench(), ROTATING)
        while bench.mode == ROTATING:
            bench.step()  # the inner axis stays at zero
        seen = []
        for _ in range(2 * round(1e9 / bench.state["parameters"]["period_ns"])):
            bench.step(request=asked)
            seen.append(bench.mode)
        assert (ROTATING in seen) == (asked == ModeRequest.NAVIGATE_ROTATING)


def test_a_change_between_the_navigation_modes_does_not_start_navigation_anew(tools):
    bench = in_mode(tools.Bench(), STRAPDOWN)
    bench.state["ins"]["longitude"] = 1.0
    bench.step(request=ModeRequest.NAVIGATE_ROTATING)
    assert bench.mode == ROTATING
    assert bench.state["ins"]["longitude"] == pytest.approx(1.0, abs=1e-9)


def test_a_new_navigation_starts_at_the_place_that_is_set(tools):
    bench = in_mode(tools.Bench(), STRAPDOWN)
    bench.state["ins"]["longitude"] = 1.0
    bench.run_to(Mode.STANDBY, ModeRequest.STANDBY)
    in_mode(bench, STRAPDOWN)
    assert bench.state["ins"]["longitude"] == pytest.approx(math.radians(116.0))


@pytest.mark.parametrize("mode", set(Mode) - {Mode.FINE_ALIGNMENT})
def test_the_axes_hold_but_for_rotation_and_shutdown(tools, mode):
    bench = in_mode(tools.Bench(), mode) if mode != Mode.POWER_ON else tools.Bench()
    expected = {ROTATING: AxisCommand.POSITION, Mode.SHUTDOWN: AxisCommand.OFF}
    expected[Mode.POWER_ON] = AxisCommand.OFF
    assert list(bench.state["sequencer"]["command"]) == 2 * [expected.get(mode, AxisCommand.HOLD)]


def test_a_fault_forgets_what_was_asked_for(tools):
    bench = in_mode(tools.Bench(), STRAPDOWN)
    modes.fail(bench.state, FirmwareFault.SENSORS_LOST)
    bench.step(request=ModeRequest.STANDBY)
    assert bench.mode == Mode.SELF_TEST
    assert bench.state["modes"]["fault"] == FirmwareFault.NONE
    for _ in range(150):
        bench.step()
    assert bench.mode == Mode.STANDBY


def test_a_request_that_is_repeated_is_acted_on_once(tools):
    bench = in_mode(tools.Bench(), STRAPDOWN)
    modes.fail(bench.state, FirmwareFault.SENSORS_LOST)
    for _ in range(20):
        bench.step(request=ModeRequest.NAVIGATE_STRAPDOWN)
    assert bench.mode == Mode.FAULT


def test_shutdown_is_the_end(tools):
    bench = in_mode(tools.Bench(), Mode.SHUTDOWN)
    for request in ModeRequest:
        bench.step(request=request)
        assert bench.mode == Mode.SHUTDOWN
    assert bench.firmware.is_shut_down
