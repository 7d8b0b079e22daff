"""The shell: the same commands, one session, completion."""

from __future__ import annotations

import click
import pytest
from click.shell_completion import ShellComplete

from rrins.host_tools.cli.diag.diag import diag
from rrins.host_tools.cli.diag.shell import Shell
from rrins.host_tools.cli.main import rrins


def completions(*words):
    *before, begun = words
    found = ShellComplete(rrins, {}, "rrins", "_RRINS_COMPLETE").get_completions(
        ["diag", *before], begun
    )
    return [item.value for item in found]


def test_lines_share_one_session(computer):
    lines = "session extended --security\n\n# nothing\nsession\ndid write bridge 0.4\n"
    ended = computer.type("shell", input=lines)
    assert ended.status == 0
    assert ended.out.startswith("session EXTENDED, unlocked\nsession EXTENDED, unlocked\n")
    assert computer.stored == {0x1004: {"bridge_s": 0.4}}


@pytest.mark.parametrize(
    ("line", "status"),
    [
        ("did read postion", 2),  # codespell:ignore
        ("frobnicate", 2),
        ("did read 'x", 2),
        ("did write bridge 0.4", 22),
        ("did read mode --channel other", 2),
    ],
)
def test_the_first_line_that_fails_ends_a_script(computer, line, status):
    ended = computer.type("shell", input=f"{line}\ndid read epoch\n")
    assert ended.status == status
    assert "epoch" not in ended.out
    assert len(ended.err.splitlines()) == 1


def test_at_a_prompt_errors_end_nothing(computer):
    with computer.tester(is_securing=False) as tester:
        prompt = Shell(tester, diag, is_script=False)
        assert prompt.prompt == "bench> "
        assert not prompt.onecmd("did read postion")  # codespell:ignore
        assert not prompt.onecmd("session extended --security")
        assert prompt.prompt == "bench extended unlocked> "
        assert not prompt.onecmd("help did read")
        assert prompt.onecmd("exit")
        assert list(prompt.completions("did read pos")) == ["position "]
        assert list(prompt.completions("did write alignment me")) == ["method="]
        assert list(prompt.completions("se")) == ["session "]


def test_the_shell_tells_when_the_bus_has_gone(computer, monkeypatch):
    from rrins.host_tools.errors import BusError

    with computer.tester() as tester:
        prompt = Shell(tester, diag, is_script=False)

        def gone(*args):
            raise BusError("bus bench: has gone")

        monkeypatch.setattr(computer.medium, "receive", gone)
        assert prompt.onecmd("did read mode")
        assert prompt.exit_status == 4


def test_identifiers_routines_and_fields_are_completed():
    assert completions("did", "read", "axis_") == [
        "axis_inner",
        "axis_outer",
        "axis_angles",
        "axis_inner_control",
        "axis_outer_control",
        "axis_watch",
    ]
    assert completions("did", "write", "axis_") == ["axis_watch"]
    assert completions("did", "write", "axis_watch", "f") == ["follow_tolerance_deg="]
    assert completions("did", "write", "alignment", "method=") == [
        "method=GIVEN",
        "method=SELF_ALIGNED",
        "method=SELF_ALIGNED_SWAYING",
        "method=SELF_ALIGNED_MOVING",
        "method=TRANSFERRED",
    ]
    assert completions("routine", "start", "al") == ["alignment"]
    assert completions("routine", "start", "go_to_axis_angle", "axis=") == [
        "axis=INNER",
        "axis=OUTER",
    ]
    assert "sensor_3_silent" in completions("dtc", "read", "sensor_3")
    assert completions("memory", "read", "seque") == ["sequencer", "sequencer."]
    assert completions("did", "control", "excluded_sensors", "adj") == ["adjust"]


def test_messages_are_completed():
    complete = ShellComplete(rrins, {}, "rrins", "_RRINS_COMPLETE").get_completions
    found = [item.value for item in complete(["inject", "drop", "--message"], "sensor_1")]
    assert found == ["SENSOR_1", *(f"SENSOR_1{k}" for k in range(7))]
    assert "FIRMWARE_STATUS" in [item.value for item in complete(["monitor", "--filter"], "FIRM")]


def test_the_help_of_every_command(computer):
    def walk(group: click.Group, path: tuple[str, ...]):
        for name, command in group.commands.items():
            yield (*path, name)
            if isinstance(command, click.Group):
                yield from walk(command, (*path, name))

    for path in walk(diag, ()):
        ended = computer.type(*path, "--help")
        assert ended.status == 0
        assert ended.out.startswith("Usage: rrins diag ")
