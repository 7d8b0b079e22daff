"""Commands of faults: what cantools reads in them, and an independent check of their protection."""

from __future__ import annotations

import e2e
import pytest

from rrins.dbc.codec import load
from rrins.dbc.values import FaultAction
from rrins.host_tools.injection.errors import InjectionError
from rrins.host_tools.injection.messages import fault_commands, plain_command
from rrins.host_tools.scenario.scenario import fault_of

CODEC = load()


def decoded(message):
    """Return name and values of a message that is sound."""
    layout = CODEC.database.get_message_by_frame_id(message.arbitration_id)
    data_id = int(CODEC.messages[CODEC.message_index(layout.name)]["data_id"])
    assert e2e.p01.e2e_p01_check(bytearray(message.data), data_id)
    return layout.name, layout.decode(bytes(message.data), decode_choices=False)


def test_a_fault_on_the_wire():
    fault = fault_of({"kind": "delay", "message": "SENSOR_3", "for_s": 1.5, "delay_s": 0.02})
    (message,) = fault_commands(FaultAction.INJECT, fault, 7)
    name, values = decoded(message)
    assert name == "FAULT_COMMAND"
    assert (values["action"], values["kind"], values["alive_counter"]) == (1, 2, 7)
    assert (values["identifier"], values["node"]) == (0x42, 0)
    assert (values["duration_ms"], values["parameter"]) == (1500, 20)


def test_a_share_goes_before():
    fault = fault_of({"kind": "drop", "node": "firmware", "probability": 0.05})
    share, command = fault_commands(FaultAction.INJECT, fault, 14)
    assert decoded(share)[1] | {"crc": 0} == {
        "crc": 0,
        "alive_counter": 14,
        "action": FaultAction.SHARE,
        "kind": 1,
        "node": 1,
        "identifier": 4095,
        "duration_ms": 0,
        "parameter": 500,
    }
    assert decoded(command)[1]["alive_counter"] == 0


@pytest.mark.parametrize(
    ("keys", "kind", "target", "value"),
    [
        ({"kind": "axis_stall", "axis": "inner"}, 1, 1, 0),
        ({"kind": "axis_runaway", "axis": "outer", "rate_dps": -2.5}, 2, 2, -2.5),
        ({"kind": "encoder_offset", "axis": "inner", "offset_deg": -79.999}, 4, 1, -79.999),
        ({"kind": "gyro_bias", "sensor": 16, "bias_dph": 0.01}, 6, 16, 0.01),
        ({"kind": "gyro_noise"}, 7, 0, 1),
        ({"kind": "accelerometer_absent", "sensor": 1}, 12, 1, 0),
        ({"kind": "accelerometer_bias", "bias_ug": 1e6}, 10, 0, 1e6),
    ],
)
def test_a_fault_of_the_hardware(keys, kind, target, value):
    (message,) = fault_commands(FaultAction.INJECT, fault_of(keys | {"for_s": 65.535}))
    name, values = decoded(message)
    assert name == "HARDWARE_FAULT_COMMAND"
    assert (values["action"], values["kind"], values["target"]) == (1, kind, target)
    assert float(f"{values['value']}e{values['exponent']}") == value
    assert values["duration_ms"] == 65535


def test_the_cycle_of_an_intermittent_fault_goes_before():
    keys = {"kind": "gyro_bias", "sensor": 2, "bias_dph": 7, "period_s": 2.5, "duty": 0.2}
    cycle, command = (decoded(m)[1] for m in fault_commands(FaultAction.INJECT, fault_of(keys), 14))
    assert (cycle["action"], cycle["kind"], cycle["target"]) == (FaultAction.CYCLE, 6, 2)
    assert (cycle["value"], cycle["exponent"], cycle["duration_ms"]) == (2, -1, 2500)
    assert (command["action"], command["value"], command["alive_counter"]) == (1, 7, 0)
    with pytest.raises(InjectionError, match=r"a period of 66 s: at most 65\.535 s"):
        fault_commands(FaultAction.INJECT, fault_of(keys | {"period_s": 66}))


def test_a_removal_says_what_and_no_more():
    fault = fault_of({"kind": "gyro_bias", "sensor": 3, "bias_dph": 7, "for_s": 1000})
    (message,) = fault_commands(FaultAction.REMOVE, fault)
    values = decoded(message)[1]
    assert (values["action"], values["kind"], values["target"]) == (2, 6, 3)
    assert (values["value"], values["duration_ms"]) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("of_hardware", [False, True])
def test_commands_without_a_fault(of_hardware):
    name, values = decoded(plain_command(FaultAction.CLEAR, of_hardware, 3))
    assert name.startswith("HARDWARE") == of_hardware
    assert (values["action"], values["kind"], values["alive_counter"]) == (3, 0, 3)
