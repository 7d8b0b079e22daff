"""The contract's dialects, read back by other readers than their writers where there are some."""

from __future__ import annotations

import canmatrix.formats
import cantools
import pytest
from click.testing import CliRunner

from rrins.dbc.codec import load
from rrins.host_tools.cli.main import rrins
from tests.conftest import warnings_as_errors

SIGNAL = (
    "start",
    "length",
    "byte_order",
    "is_signed",
    "scale",
    "offset",
    "minimum",
    "maximum",
    "unit",
)
SYM_LETTERS = 32
"""Longest name of a signal in PCAN tools."""


def written_as(tmp_path, ending):
    path = tmp_path / f"bus{ending}"
    done = CliRunner().invoke(rrins, ["export", str(path)], prog_name="rrins")
    assert done.exit_code == 0, done.output
    return path


def expected_name(message, signal, ending):
    if ending == ".sym":
        return f"{message.name}_{signal.name}"[:SYM_LETTERS]
    return f"{message.name}_{signal.name}" if ending == ".arxml" else signal.name


def test_names_are_unique_in_sym():
    messages = load().database.messages
    names = [expected_name(m, s, ".sym") for m in messages for s in m.signals]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("ending", [".dbc", ".kcd", ".sym", ".arxml"])
def test_cantools_reads_the_same(tmp_path, ending, caplog):
    written = written_as(tmp_path, ending)
    with warnings_as_errors():
        found = cantools.database.load_file(written)
    assert caplog.records == []
    own = load().database
    assert {one.name for one in found.messages} == {one.name for one in own.messages}
    for message in own.messages:
        other = found.get_message_by_name(message.name)
        assert (other.frame_id, other.length) == (message.frame_id, message.length)
        assert other.cycle_time == message.cycle_time, message.name
        if written.suffix != ".sym":  # has neither senders nor receivers
            assert set(other.senders) == set(message.senders)
            assert set(other.receivers) == set(message.receivers), message.name
        theirs = {signal.name: signal for signal in other.signals}
        for signal in message.signals:
            one = theirs.pop(expected_name(message, signal, written.suffix))
            for attribute in SIGNAL:
                want, have = getattr(signal, attribute), getattr(one, attribute)
                if isinstance(want, float):
                    want = pytest.approx(want, rel=1e-15)
                assert have == want, (message.name, signal.name, attribute)
            assert words(one.choices) == words(signal.choices)
            assert (one.comment or "") == (signal.comment or ""), signal.name
        assert theirs == {}


def words(choices):
    return {int(value): str(name) for value, name in (choices or {}).items()}


@pytest.mark.parametrize("ending", [".dbc", ".kcd", ".arxml"])  # it knows SYM to version 5
def test_canmatrix_reads_the_same(tmp_path, ending):
    written = written_as(tmp_path, ending)
    found = canmatrix.formats.loadp_flat(str(written))
    frames = {frame.arbitration_id.id: frame for frame in found.frames}
    for message in load().database.messages:
        frame = frames[message.frame_id]
        assert (frame.name, frame.size) == (message.name, message.length)
        theirs = {signal.name: signal for signal in frame.signals}
        for signal in message.signals:
            one = theirs[expected_name(message, signal, written.suffix)]
            assert one.size == signal.length
            assert one.get_startbit() == signal.start
            assert float(one.factor) == pytest.approx(signal.scale, rel=1e-15), signal.name
            assert float(one.offset) == signal.offset
            assert one.is_signed == signal.is_signed
            assert {int(k): v for k, v in one.values.items()} == words(signal.choices)


def test_protection_is_in_the_arxml(tmp_path):
    found = cantools.database.load_file(written_as(tmp_path, ".arxml"))
    codec = load()
    for message in found.messages:
        row = codec.messages[codec.message_index(message.name)]
        if codec.is_protected(message.name):
            assert message.autosar.e2e.category == "PROFILE_01"
            assert message.autosar.e2e.data_ids == [row["data_id"]]
        else:
            assert message.autosar.e2e is None
    (bus,) = found.buses
    assert bus.baudrate == codec.bits_per_s
