"""Communication parameters of UDS on CAN as ODX names them (ISO 22900-2, ISO 15765).

A file carries the definitions of the parameters that it sets. Their identities are those of the
published parameter sets, which a tool may put in their place.
"""

from __future__ import annotations

from dataclasses import dataclass

from odxtools.comparam import Comparam
from odxtools.comparaminstance import ComparamInstance
from odxtools.comparamspec import ComparamSpec
from odxtools.comparamsubset import ComparamSubset
from odxtools.complexcomparam import ComplexComparam
from odxtools.dataobjectproperty import DataObjectProperty
from odxtools.nameditemlist import NamedItemList
from odxtools.odxlink import DocType, OdxDocFragment, OdxLinkId, OdxLinkRef
from odxtools.odxtypes import DataType
from odxtools.physicaltype import PhysicalType
from odxtools.protstack import ProtStack
from odxtools.standardizationlevel import StandardizationLevel
from odxtools.usage import Usage

from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics import access, table
from rrins.host_tools.descriptions.dictionary import identical, named_numbers, unsigned

_US_PER_MS = 1000
_NUMBER, _REQUEST_FORMAT, _RESPONSE_FORMAT = "number", "request_format", "response_format"
_FORMATS = {
    _REQUEST_FORMAT: {5: "normal segmented 11-bit transmit with FC"},
    _RESPONSE_FORMAT: {5: "normal segmented 11-bit receive with FC"},
}
_STACK = "ISO_15765_3_on_ISO_15765_2"
_UNIQUE = "CP_UniqueRespIdTable"


@dataclass(frozen=True)
class _Parameter:
    name: str
    value: str
    kind: str  #: PARAM-CLASS
    usage: Usage
    coding: str = _NUMBER


@dataclass(frozen=True)
class _Set:
    """A set of parameters: a layer of the protocol."""

    name: str
    category: str
    parameters: tuple[_Parameter, ...]

    @property
    def place(self) -> tuple[OdxDocFragment]:
        return (OdxDocFragment(self.name, DocType.COMPARAM_SUBSET),)

    def reference(self, name: str) -> OdxLinkRef:
        return OdxLinkRef(f"{self.name}.{name}", self.place)


def _timing(name: str, ms: int) -> _Parameter:
    return _Parameter(name, str(ms * _US_PER_MS), "TIMING", Usage.TESTER)


def _number(name: str, value: int, kind: str = "COM") -> _Parameter:
    return _Parameter(name, str(value), kind, Usage.ECU_COMM)


def _sets() -> tuple[_Set, _Set, _Set]:
    """Return the sets of the application, the transport and the physical layer."""
    bit_rate = load().bits_per_s
    return (
        _Set("ISO_15765_3", "APP", (
            _timing("CP_P2Max", access.P2_MS),
            _timing("CP_P2Star", access.P2_STAR_MS),
            _Parameter("CP_TesterPresentTime", str(access.S3_MS * _US_PER_MS * 2 // 5),
                "TESTER_PRESENT", Usage.TESTER),
        )),
        _Set("ISO_15765_2", "TRANS", (
            _timing("CP_Bs", access.N_BS_MS),
            _timing("CP_Cr", access.N_CR_MS),
            _number("CP_BlockSize", access.BLOCK_SIZE),
            _number("CP_CanFillerByte", access.PADDING),
            _number("CP_CanFuncReqId", table.functional_id()),
        )),
        _Set("ISO_11898_2_DWCAN", "PHYS", (_number("CP_Baudrate", bit_rate, "BUSTYPE"),)),
    )  # fmt: skip


def _identifiers() -> tuple[_Parameter, ...]:
    """Return the parts of the table of CAN identifiers."""
    return (
        _number("CP_CanPhysReqId", table.request_id(), "UNIQUE_ID"),
        _Parameter("CP_CanPhysReqFormat", _FORMATS[_REQUEST_FORMAT][5], "UNIQUE_ID",
            Usage.ECU_COMM, _REQUEST_FORMAT),
        _number("CP_CanRespUSDTId", table.response_id(), "UNIQUE_ID"),
        _Parameter("CP_CanRespUSDTFormat", _FORMATS[_RESPONSE_FORMAT][5], "UNIQUE_ID",
            Usage.ECU_COMM, _RESPONSE_FORMAT),
    )  # fmt: skip


def _definition(of: _Set, parameter: _Parameter) -> Comparam:
    return Comparam(
        odx_id=OdxLinkId(f"{of.name}.{parameter.name}", of.place),
        short_name=parameter.name,
        param_class=parameter.kind,
        cptype=StandardizationLevel.STANDARD,
        cpusage=parameter.usage,
        physical_default_value_raw=parameter.value,
        dop_ref=of.reference(parameter.coding),
    )


def _codings(of: _Set) -> NamedItemList[DataObjectProperty]:
    found = []
    for name, names in ((_NUMBER, None), *_FORMATS.items()):
        physical = DataType.A_UINT32 if names is None else DataType.A_UNICODE2STRING
        found.append(
            DataObjectProperty(
                odx_id=OdxLinkId(f"{of.name}.{name}", of.place),
                short_name=name,
                diag_coded_type=unsigned(32),
                compu_method=identical(physical) if names is None else named_numbers(names),
                physical_type=PhysicalType(base_data_type=physical),
            )
        )
    return NamedItemList(found)


def parameter_sets() -> NamedItemList[ComparamSubset]:
    """Return the definitions of the parameters."""
    found = []
    for one in _sets():
        tables = []
        if one.category == "TRANS":
            tables.append(
                ComplexComparam(
                    odx_id=OdxLinkId(f"{one.name}.{_UNIQUE}", one.place),
                    short_name=_UNIQUE,
                    param_class="UNIQUE_ID",
                    cptype=StandardizationLevel.STANDARD,
                    cpusage=Usage.ECU_COMM,
                    subparams=NamedItemList([_definition(one, part) for part in _identifiers()]),
                    allow_multiple_values_raw=True,
                )
            )
        found.append(
            ComparamSubset(
                odx_id=OdxLinkId(one.name, one.place),
                short_name=one.name,
                category=one.category,
                comparams=NamedItemList([_definition(one, part) for part in one.parameters]),
                complex_comparams=NamedItemList(tables),
                data_object_props=_codings(one),
            )
        )
    return NamedItemList(found)


def protocol_stack() -> ComparamSpec:
    """Return the stack of protocols: UDS on ISO-TP on CAN."""
    place = (OdxDocFragment(_STACK, DocType.COMPARAM_SPEC),)
    name = f"{_STACK}_on_ISO_11898_2_DWCAN"
    stack = ProtStack(
        odx_id=OdxLinkId(f"PS_{name}", place),
        short_name=f"PS_{name}",
        pdu_protocol_type=_STACK,
        physical_link_type="ISO_11898_2_DWCAN",
        comparam_subset_refs=[OdxLinkRef(one.name, one.place) for one in _sets()],
    )
    return ComparamSpec(
        odx_id=OdxLinkId(f"CPS_{_STACK}", place),
        short_name=_STACK,
        prot_stacks=NamedItemList([stack]),
    )


def parameter_values() -> list[ComparamInstance]:
    """Return what the parameters are for this computer."""
    transport = _sets()[1]
    values = [
        ComparamInstance(spec_ref=one.reference(part.name), value=part.value)
        for one in _sets()
        for part in one.parameters
    ]
    identifiers = ComparamInstance(
        spec_ref=transport.reference(_UNIQUE), value=[part.value for part in _identifiers()]
    )
    return [*values, identifiers]
