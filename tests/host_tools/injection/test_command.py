"""`rrins inject`: what it prints, and how it ends."""

from __future__ import annotations

import json

import pytest
from click.testing import CliRunner

from rrins.host_tools.cli.main import rrins


@pytest.fixture
def inject(world):
    """Run `rrins inject` against a rehearsal; return exit status and lines."""

    def run(*arguments, channel=world.address.channel):
        with world.going():
            result = CliRunner().invoke(
                rrins, ["inject", *map(str, arguments), "--channel", channel]
            )
        return result.exit_code, result.output.splitlines()

    return run


def test_in_listed_and_out_again(inject):
    status, (line,) = inject("gyro_bias", "--sensor", 2, "--bias-dph", 10, "--for", 30)
    assert status == 0
    assert line.startswith("gyro_bias (sensor 2, bias_dph 10) since epoch ")
    assert line.endswith("s), for 30 s")
    assert inject("drop", "--message", "SENSOR_3", "--probability", 0.5)[0] == 0
    status, (head, *faults) = inject("list")
    assert head.startswith("2 faults active at epoch ")
    assert [line.split(" since ")[0].strip() for line in faults] == [
        "gyro_bias (sensor 2, bias_dph 10)",
        "drop (message SENSOR_3, probability 0.5)",
    ]
    status, (line,) = inject("list", "--json")
    listed = json.loads(line)
    assert listed["kinds"] == ["drop", "gyro_bias"]
    assert listed["affected_frames"] > 0
    first = listed["faults"][0]
    assert first | {"since_epoch": 0, "at_s": 0} == {
        "of": "hardware",
        "kind": "gyro_bias",
        "sensor": 2,
        "bias_dph": 10,
        "since_epoch": 0,
        "at_s": 0,
        "for_s": 30,
    }
    assert first["at_s"] == first["since_epoch"] / 200
    status, (line,) = inject("drop", "--message", "SENSOR_3", "--remove")
    assert line.startswith("drop (message SENSOR_3) removed at epoch ")
    status, (line,) = inject("clear")
    assert line.startswith("1 fault removed at epoch ")
    status, (line,) = inject("list")
    assert line.startswith("no faults active at epoch ")


def test_a_value_that_cannot_be_said_exactly_is_told(inject):
    status, (told, line) = inject("delay", "--message", "SENSOR_3", "--delay", 0.001)
    assert status == 0
    assert told == "rrins: delay_s 0.001 became 0.005, a whole number of epochs"
    assert line.startswith("delay (message SENSOR_3, delay_s 0.005) since epoch ")
    status, (told, line) = inject("drop", "--message", "SENSOR_2", "--probability", 0.12345)
    assert told.startswith("rrins: probability 0.12345 became 0.123")
    assert len(inject("delay", "--message", "SENSOR_3", "--delay", 0.02)[1]) == 1
    assert len(inject("drop", "--message", "SENSOR_2", "--probability", 0.3)[1]) == 1
    inject("clear")


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("list", "--axis", "inner"), 2, "list does not accept fault options such as --axis"),
        (("clear", "--remove"), 2, "clear does not accept fault options such as --remove"),
        (("gyro_bias", "--sensor", "two"), 2, "'two' is not a valid integer"),
        (("gyro_bia",), 3, "there is no fault 'gyro_bia', did you mean gyro_bias?"),
        (("axis_stall",), 3, "axis: is missing"),
        (("axis_stall", "--axis", "middle"), 3, "'inner' or 'outer', got 'middle'"),
        (("gyro_bias", "--bias-ug", 3), 3, "bias_ug: does not apply to gyro_bias"),
        (
            ("gyro_bias", "--axis", "inner"),
            3,
            "axis: does not apply to gyro_bias, only to axis_stall",
        ),
        (("drop", "--message", "SENSR_3"), 3, "did you mean SENSOR_3"),
        (("gyro_bias", "--bias-dph", "nan"), 3, "finite"),
        (("gyro_bias", "--for", 0), 3, "greater than 0"),
        (("gyro_bias", "--sensor", 9), 7, "gyro_bias (sensor 9): the hardware on this bus has"),
        (("gyro_bias", "--for", 66), 7, "for 66 s: a live fault lasts at most 65.535 s"),
        (("axis_stall", "--axis", "inner", "--remove"), 7, "is not active"),
    ],
)
def test_wrong_use_ends_in_one_line(request, arguments, status, words):
    if status == 7:
        result = request.getfixturevalue("inject")(*arguments)
    else:  # before any bus is looked for
        invoked = CliRunner().invoke(rrins, ["inject", *map(str, arguments)])
        result = invoked.exit_code, invoked.output.splitlines()
    assert result[0] == status
    assert words in result[1][-1]
    assert status == 2 or len(result[1]) == 1


def test_a_bus_that_is_not_there():
    result = CliRunner().invoke(rrins, ["inject", "list", "--channel", "nowhere"])
    assert result.exit_code == 4
    assert "not running" in result.output
