"""The A2L file: that other readers read it, and that what it says is so."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rrins.firmware_py.core.records.memory import Ram
from rrins.firmware_py.xcp.a2l import a2l_text, ascii_of, measurements, name_of
from rrins.firmware_py.xcp.characteristics import CHARACTERISTICS, SEGMENTS
from rrins.firmware_py.xcp.layout import by_path, epk, fields

TYPES = {"UBYTE": "u1", "SWORD": "<i2", "A_INT64": "<i8", "A_UINT64": "<u8", "FLOAT64_IEEE": "<f8"}
BLOCK_OF_IF_DATA = "may be used at most once here, only the last occurrence is kept"


@pytest.fixture(scope="module")
def text() -> str:
    return a2l_text(5_000_000)


def test_fields_cover_the_memory_without_gaps():
    at = 0
    for field in fields():
        assert field.address == at, field.path
        at += field.size
    assert at == Ram.dtype.itemsize


def test_a_field_has_the_unit_and_the_words_of_its_record():
    speed = by_path()["navigation.velocity_n"]
    assert (speed.unit, speed.shape, speed.dtype) == ("m/s", (3,), np.dtype("<f8"))
    assert by_path()["parameters.turn_rate_dps"].unit == "deg/s"
    assert by_path()["modes.mode"].names is not None
    assert by_path()["steps"].text == "since power-on"


def test_pya2l_reads_all_of_it(text):
    parser = pytest.importorskip("pya2l.parser")
    with parser.A2lParser() as reader:
        tree = reader.tree_from_a2l(text.encode())
        # pya2l 0.4 says so of every block in IF_DATA, even of a single one.
        assert [w for w in reader.warnings if not w.endswith(BLOCK_OF_IF_DATA)] == []
        again = reader.tree_from_a2l(reader.a2l_from_tree(tree, indent=1))
    for module in (tree.PROJECT.MODULE[0], again.PROJECT.MODULE[0]):
        assert len(module.MEASUREMENT) == len(measurements()) > 1000
        assert len(module.CHARACTERISTIC) == len(CHARACTERISTICS)
        assert module.MOD_PAR.EPK.Identifier.Value == epk()
        assert [s.Name.Value for s in module.MOD_PAR.MEMORY_SEGMENT] == list(SEGMENTS)
        for one in module.MEASUREMENT:
            field = by_path()[one.Name.Value.replace("[", ".").replace("]", "")]
            assert one.ECU_ADDRESS.Address.Value == field.address
            kind = np.dtype(TYPES[one.DataType.Value])
            assert kind == field.dtype or (kind, field.dtype) == (np.dtype("u1"), np.dtype(bool))
            assert one.LongIdentifier.Value == ascii_of(field.text)


def test_every_name_stands_once_and_every_reference_is_there(text):
    names = re.findall(r"/begin (?:MEASUREMENT|CHARACTERISTIC) (\S+)", text)
    assert len(set(names)) == len(names)
    groups = re.findall(r"/begin REF_(?:MEASUREMENT|CHARACTERISTIC) ([^/]*) /end", text)
    assert sorted(" ".join(groups).split()) == sorted(names)
    methods = set(re.findall(r"/begin COMPU_METHOD (\S+)", text)) | {"NO_COMPU_METHOD"}
    assert set(re.findall(r"(?:FLOAT64_IEEE|A_INT64|UBYTE) (\w+) 0 0 ", text)) <= methods
    assert set(re.findall(r"COMPU_TAB_REF (\S+)", text)) == set(
        re.findall(r"/begin COMPU_VTAB (\S+)", text)
    )


def test_identifiers_are_valid(text):
    assert text.isascii()  # older readers take the file for Latin-1
    part = r"[A-Za-z_]\w{0,31}(\[\d+\])*"
    for name in re.findall(r"/begin (?:MEASUREMENT|CHARACTERISTIC|COMPU_METHOD) (\S+)", text):
        assert re.fullmatch(rf"{part}(\.{part})*", name), name


def test_bus_and_event_channels_are_those_of_the_computer(text):
    assert "CAN_ID_MASTER 0x7D0 CAN_ID_SLAVE 0x7D8 BAUDRATE 1000000" in text
    assert '"epoch" "epoch" 0x0000 DAQ_STIM 0xFF 50 5 0' in text
    assert '"epoch" "epoch" 0x0000 DAQ_STIM 0xFF 100 4 0' in a2l_text(1_000_000)
    assert name_of(by_path()["modes.mode"]) == "modes.mode"


def test_another_layout_has_another_epk(monkeypatch):
    from rrins.firmware_py.xcp import layout

    before = epk()
    monkeypatch.setattr(layout, "fields", lambda: fields()[1:])
    assert layout.epk.__wrapped__() != before
