"""Values as ODX describes them: data object properties, units, structures, fields and tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from html import escape

from odxtools.compumethods.compucategory import CompuCategory
from odxtools.compumethods.compuconst import CompuConst
from odxtools.compumethods.compuinternaltophys import CompuInternalToPhys
from odxtools.compumethods.compumethod import CompuMethod
from odxtools.compumethods.compuscale import CompuScale
from odxtools.compumethods.identicalcompumethod import IdenticalCompuMethod
from odxtools.compumethods.limit import Limit
from odxtools.compumethods.texttablecompumethod import TexttableCompuMethod
from odxtools.dataobjectproperty import DataObjectProperty
from odxtools.description import Description
from odxtools.determinenumberofitems import DetermineNumberOfItems
from odxtools.diagcodedtype import DiagCodedType
from odxtools.diagdatadictionaryspec import DiagDataDictionarySpec
from odxtools.diagnostictroublecode import DiagnosticTroubleCode
from odxtools.dtcdop import DtcDop
from odxtools.dynamiclengthfield import DynamicLengthField
from odxtools.endofpdufield import EndOfPduField
from odxtools.internalconstr import InternalConstr
from odxtools.minmaxlengthtype import MinMaxLengthType
from odxtools.nameditemlist import NamedItemList
from odxtools.odxlink import OdxDocFragment, OdxLinkId, OdxLinkRef
from odxtools.odxtypes import DataType
from odxtools.parameters.codedconstparameter import CodedConstParameter
from odxtools.parameters.parameter import Parameter
from odxtools.parameters.tablekeyparameter import TableKeyParameter
from odxtools.parameters.tablestructparameter import TableStructParameter
from odxtools.parameters.valueparameter import ValueParameter
from odxtools.physicaltype import PhysicalType
from odxtools.radix import Radix
from odxtools.standardlengthtype import StandardLengthType
from odxtools.staticfield import StaticField
from odxtools.structure import Structure
from odxtools.table import Table
from odxtools.tablerow import TableRow
from odxtools.termination import Termination
from odxtools.text import Text
from odxtools.unit import Unit
from odxtools.unitspec import UnitSpec

from rrins.firmware_py.core.records.troubles import Status
from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.codecs import Field
from rrins.host_tools.descriptions.names import unit_name
from rrins.host_tools.diag.exchanges import (
    EXTENDED_DATA,
    IDENTIFIERS,
    Bytes,
    Code,
    Constant,
    Number,
    Part,
    Record,
    Repeated,
    StatusByte,
)

_NUMBERS = {"u": DataType.A_UINT32, "i": DataType.A_INT32}
_FLOATS = {"f32": DataType.A_FLOAT32, "f64": DataType.A_FLOAT64}
_HALF = 32  # bits: the longest integer of ODX
_TEXT = DataType.A_UNICODE2STRING


def described(text: str) -> Description | None:
    """Return a description of plain text; None without text."""
    return Description.from_string(f"<p>{escape(text, quote=False)}</p>") if text else None


def unsigned(bits: int) -> StandardLengthType:
    """Return the coding of an unsigned number."""
    return StandardLengthType(base_data_type=DataType.A_UINT32, bit_length=bits)


def identical(data_type: DataType) -> CompuMethod:
    """Return the conversion of a value that is shown as it is coded."""
    return IdenticalCompuMethod(
        category=CompuCategory.IDENTICAL, internal_type=data_type, physical_type=data_type
    )


def named_numbers(names: dict[int, str], internal: DataType = DataType.A_UINT32) -> CompuMethod:
    """Return the conversion of numbers to their names."""
    scales = []
    for number, name in names.items():
        limit = Limit(value_raw=str(number), value_type=internal)
        scales.append(
            CompuScale(
                lower_limit=limit,
                upper_limit=limit,
                compu_const=CompuConst(vt=name, data_type=_TEXT),
                domain_type=internal,
                range_type=_TEXT,
            )
        )
    return TexttableCompuMethod(
        category=CompuCategory.TEXTTABLE,
        compu_internal_to_phys=CompuInternalToPhys(compu_scales=scales),
        internal_type=internal,
        physical_type=_TEXT,
    )


class Dictionary:
    """All descriptions of values of a diagnostic layer; each is made once, when it is first used.

    Parameters
    ----------
    place : tuple of OdxDocFragment
        The document that they belong to.
    """

    def __init__(self, place: tuple[OdxDocFragment]) -> None:
        self.place = place
        self._references: dict[object, OdxLinkRef] = {}
        self._names: set[str] = set()
        self._properties: list[DataObjectProperty] = []
        self._troubles: list[DtcDop] = []
        self._units: dict[str, Unit] = {}
        self._structures: list[Structure] = []
        self._arrays: list[StaticField] = []
        self._ends: list[EndOfPduField] = []
        self._counted: list[DynamicLengthField] = []
        self._tables: list[Table] = []

    def identity(self, kind: str, name: str) -> OdxLinkId:
        """Return the identity of an object."""
        return OdxLinkId(f"{kind}.{name}", self.place)

    def specification(self) -> DiagDataDictionarySpec:
        """Return all that was described so far."""
        return DiagDataDictionarySpec(
            data_object_props=NamedItemList(self._properties),
            dtc_dops=NamedItemList(self._troubles),
            structures=NamedItemList(self._structures),
            static_fields=NamedItemList(self._arrays),
            end_of_pdu_fields=NamedItemList(self._ends),
            dynamic_length_fields=NamedItemList(self._counted),
            tables=NamedItemList(self._tables),
            unit_spec=UnitSpec(units=NamedItemList(self._units.values())),
        )

    # ---- parameters of requests, responses and structures

    def parameters(self, owner: str, parts: Iterable[Part]) -> NamedItemList[Parameter]:
        """Return consecutive parameters; what follows parts of fixed length has its position."""
        found: list[Parameter] = []
        position: int | None = 0
        for part in parts:
            found += self._parameters_of(owner, part, position)
            size = _size(part)
            position = None if position is None or size is None else position + size
        return NamedItemList(found)

    def _parameters_of(self, owner: str, part: Part, position: int | None) -> list[Parameter]:
        if isinstance(part, Constant):
            return [
                CodedConstParameter(
                    short_name=part.name,
                    byte_position=position,
                    diag_coded_type=unsigned(8 * part.size),
                    coded_value_raw=str(part.value),
                )
            ]
        if isinstance(part, Record):
            key = self.identity("KEY", f"{owner}.{part.name}")
            return [
                TableKeyParameter(
                    odx_id=key,
                    short_name=f"{part.name}_number",
                    byte_position=position,
                    table_ref=self._table(part.of),
                ),
                TableStructParameter(short_name=part.name, table_key_ref=OdxLinkRef.from_id(key)),
            ]
        return [
            ValueParameter(
                short_name=part.name,
                description=described(part.text) if isinstance(part, Field) else None,
                byte_position=position,
                semantic="DATA",
                dop_ref=self._reference(owner, part),
            )
        ]

    def _reference(self, owner: str, part: Part) -> OdxLinkRef:
        """Return a reference to the description of a part, which is made if it is new."""
        key: object = part
        if isinstance(part, Field):
            key = replace(part, name="", source="", factor=1.0, offset=0, text="")
        if key not in self._references:
            self._references[key] = OdxLinkRef.from_id(self._describe(owner, part))
        return self._references[key]

    def _describe(self, owner: str, part: Part) -> OdxLinkId:
        if isinstance(part, Field):
            return self._array(owner, part) if _is_array(part) else self._value(part)
        if isinstance(part, Bytes):
            return self._bytes(part)
        if isinstance(part, Code):
            return self._trouble_codes()
        if isinstance(part, StatusByte):
            return self._status()
        if isinstance(part, Number):
            names = {did.number: did.name for did in table.IDENTIFIERS}
            return self._named("identifier", 16, names)
        assert isinstance(part, Repeated)
        return self._repeated(owner, part)

    # ---- simple values

    def _value(self, field: Field) -> OdxLinkId:
        if field.choices is not None:
            names = {int(choice): choice.name for choice in field.choices}
            return self._named(field.choices.__name__, 8 * field.size, names)
        if field.size * 8 > _HALF and not field.is_float and field.format != "ascii":
            return self._halves(field)
        coding, physical = _coding(field)
        unit = unit_name(field.unit)
        is_limited = field.minimum is not None and field.maximum is not None
        name = field.name if is_limited else "_".join(filter(None, (_kind(field), unit)))
        return self._property(
            name, coding, identical(coding.base_data_type), physical,
            None if not field.unit else self._unit(field.unit), _limits(field, physical),
        )  # fmt: skip

    def _named(self, name: str, bits: int, names: dict[int, str]) -> OdxLinkId:
        return self._property(name, unsigned(bits), named_numbers(names), _TEXT)

    def negative_response_code(self, names: dict[int, str]) -> OdxLinkRef:
        """Return a reference to the description of negative response codes."""
        return OdxLinkRef.from_id(self._named("negative_response_code", 8, names))

    def _halves(self, field: Field) -> OdxLinkId:
        """Describe an integer of 64 bits: ODX has none of more than 32."""
        high = Field("high", "i32") if field.format.startswith("i") else Field("high", "u32")
        return self._structure(
            field.format,
            (high, Field("low", "u32")),
            "A number of 64 bits: high · 2³² + low.",
        )

    def _bytes(self, part: Bytes) -> OdxLinkId:
        coding: DiagCodedType
        if part.size is not None:
            name = f"bytes_{part.size}"
            coding = StandardLengthType(
                base_data_type=DataType.A_BYTEFIELD, bit_length=8 * part.size
            )
        else:
            name = "_".join(["bytes", *(str(end) for end in (part.least, part.most) if end)])
            coding = MinMaxLengthType(
                base_data_type=DataType.A_BYTEFIELD,
                min_length=part.least,
                max_length=part.most,
                termination=Termination.END_OF_PDU,
            )
        return self._property(name, coding, identical(DataType.A_BYTEFIELD), DataType.A_BYTEFIELD)

    def _property(
        self,
        name: str,
        coding: DiagCodedType,
        conversion: CompuMethod,
        physical: DataType,
        unit: OdxLinkRef | None = None,
        limits: InternalConstr | None = None,
    ) -> OdxLinkId:
        name = self._unique(name)
        identity = self.identity("DOP", name)
        is_plain = isinstance(coding, StandardLengthType) and physical == DataType.A_UINT32
        self._properties.append(
            DataObjectProperty(
                odx_id=identity,
                short_name=name,
                diag_coded_type=coding,
                compu_method=conversion,
                physical_type=PhysicalType(
                    base_data_type=physical, display_radix=Radix.DEC if is_plain else None
                ),
                unit_ref=unit,
                internal_constr=limits,
            )
        )
        return identity

    def _unit(self, text: str) -> OdxLinkRef:
        name = unit_name(text)
        if name not in self._units:
            self._units[name] = Unit(
                odx_id=self.identity("UNIT", name), short_name=name, display_name=text
            )
        return OdxLinkRef.from_id(self._units[name].odx_id)

    # ---- values of several parts

    def _structure(self, name: str, parts: Sequence[Part], text: str = "") -> OdxLinkId:
        name = self._unique(name)
        identity = self.identity("STRUCTURE", name)
        self._structures.append(
            Structure(
                odx_id=identity,
                short_name=name,
                description=described(text),
                parameters=self.parameters(name, parts),
            )
        )
        return identity

    def _array(self, owner: str, field: Field) -> OdxLinkId:
        one = replace(field, name="value", count=1, text="")
        name = self._unique(f"{field.name}_{field.count}")
        element = self._structure(f"{name}_element", (one,))
        identity = self.identity("ARRAY", name)
        self._arrays.append(
            StaticField(
                odx_id=identity,
                short_name=name,
                structure_ref=OdxLinkRef.from_id(element),
                fixed_number_of_items=field.count,
                item_byte_size=one.size,
            )
        )
        return identity

    def _repeated(self, owner: str, part: Repeated) -> OdxLinkId:
        name = self._unique(f"{owner}_{part.name}")
        element = OdxLinkRef.from_id(self._structure(f"{name}_element", part.parts))
        identity = self.identity("FIELD", name)
        if not part.is_counted:
            self._ends.append(
                EndOfPduField(odx_id=identity, short_name=name, structure_ref=element)
            )
            return identity
        number = self._reference(owner, Field("count", "u8"))
        self._counted.append(
            DynamicLengthField(
                odx_id=identity,
                short_name=name,
                structure_ref=element,
                offset=1,
                determine_number_of_items=DetermineNumberOfItems(byte_position=0, dop_ref=number),
            )
        )
        return identity

    def _status(self) -> OdxLinkId:
        name = self._unique("trouble_status")
        bit = self._named("bit", 1, {0: "no", 1: "yes"})
        identity = self.identity("STRUCTURE", name)
        parameters = [
            ValueParameter(
                short_name=status.name.lower(),
                byte_position=0,
                bit_position=status.bit_length() - 1,
                dop_ref=OdxLinkRef.from_id(bit),
            )
            for status in Status
        ]
        self._structures.append(
            Structure(
                odx_id=identity,
                short_name=name,
                byte_size=1,
                parameters=NamedItemList[Parameter](parameters),
            )
        )
        return identity

    def _trouble_codes(self) -> OdxLinkId:
        codes = [
            DiagnosticTroubleCode(
                odx_id=self.identity("DTC", trouble.name),
                short_name=trouble.name,
                trouble_code=trouble.number,
                display_trouble_code=trouble.code,
                text=Text(text=trouble.text),
            )
            for trouble in table.TROUBLES
        ]
        identity = self.identity("DTC-DOP", "trouble_code")
        self._troubles.append(
            DtcDop(
                odx_id=identity,
                short_name="trouble_code",
                diag_coded_type=unsigned(24),
                physical_type=PhysicalType(
                    base_data_type=DataType.A_UINT32, display_radix=Radix.HEX
                ),
                compu_method=identical(DataType.A_UINT32),
                dtcs_raw=[*codes],
            )
        )
        return identity

    def _table(self, of: str) -> OdxLinkRef:
        if of not in self._references:
            self._references[of] = OdxLinkRef.from_id(self._make_table(of))
        return self._references[of]

    def _make_table(self, of: str) -> OdxLinkId:
        identity = self.identity("TABLE", of)
        reference = OdxLinkRef.from_id(identity)
        number = Field("number", "u16" if of == IDENTIFIERS else "u8")
        self._tables.append(
            Table(
                odx_id=identity,
                short_name=of,
                key_dop_ref=self._reference(of, number),
                table_rows_raw=[
                    TableRow(
                        odx_id=self.identity("ROW", f"{of}.{name}"),
                        short_name=name,
                        description=described(text),
                        key_raw=str(key),
                        table_ref=reference,
                        structure_ref=OdxLinkRef.from_id(self._structure(f"{of}_{name}", fields)),
                    )
                    for key, name, text, fields in _rows(of)
                ],
            )
        )
        return identity

    def _unique(self, name: str) -> str:
        """Return the name, with a number behind it if it is taken."""
        free, number = name, 2
        while free in self._names:
            free, number = f"{name}_{number}", number + 1
        self._names.add(free)
        return free


def _rows(of: str) -> list[tuple[int, str, str, tuple[Field, ...]]]:
    """Return number, name, text and fields of each record."""
    if of == IDENTIFIERS:
        return [(did.number, did.name, did.text, did.fields) for did in table.IDENTIFIERS]
    assert of == EXTENDED_DATA
    return [
        (number, f"record_{number}", "", layout.fields)
        for number, layout in table.EXTENDED_DATA.items()
    ]


def _size(part: Part) -> int | None:
    """Return the number of bytes of a part; None if it varies."""
    if isinstance(part, Field | Constant | Bytes):
        return part.size
    if isinstance(part, Repeated | Record):
        return None
    return {Code: 3, StatusByte: 1, Number: 2}[type(part)]


def _is_array(field: Field) -> bool:
    return field.count > 1 and field.format != "ascii"


def _kind(field: Field) -> str:
    return f"ascii_{field.count}" if field.format == "ascii" else field.format


def _coding(field: Field) -> tuple[StandardLengthType, DataType]:
    """Return how a simple value is coded, and its physical type."""
    if field.format == "ascii":
        kind = DataType.A_ASCIISTRING
        return StandardLengthType(base_data_type=kind, bit_length=8 * field.count), _TEXT
    kind = _FLOATS.get(field.format) or _NUMBERS[field.format[0]]
    return StandardLengthType(base_data_type=kind, bit_length=8 * field.size), kind


def _limits(field: Field, kind: DataType) -> InternalConstr | None:
    if field.minimum is None or field.maximum is None:
        return None
    ends = [
        Limit(value_raw=f"{end!r}" if field.is_float else str(int(end)), value_type=kind)
        for end in (field.minimum, field.maximum)
    ]
    return InternalConstr(lower_limit=ends[0], upper_limit=ends[1], value_type=kind)
