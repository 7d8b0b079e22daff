"""Writes the diagnostic table as a PDX file: ODX (ISO 22901-1) in an archive."""

from __future__ import annotations

from pathlib import Path

from odxtools.database import Database
from odxtools.diaglayercontainer import DiagLayerContainer
from odxtools.diaglayers.basevariant import BaseVariant
from odxtools.diaglayers.basevariantraw import BaseVariantRaw
from odxtools.diaglayers.diaglayertype import DiagLayerType
from odxtools.diaglayers.ecuvariant import EcuVariant
from odxtools.diaglayers.ecuvariantraw import EcuVariantRaw
from odxtools.diaglayers.protocol import Protocol
from odxtools.diaglayers.protocolraw import ProtocolRaw
from odxtools.diagservice import DiagService
from odxtools.ecuvariantpattern import EcuVariantPattern
from odxtools.functionalclass import FunctionalClass
from odxtools.matchingparameter import MatchingParameter
from odxtools.nameditemlist import NamedItemList
from odxtools.odxlink import DocType, OdxDocFragment, OdxLinkId, OdxLinkRef
from odxtools.parameters.parameter import Parameter
from odxtools.parameters.valueparameter import ValueParameter
from odxtools.parentref import ParentRef
from odxtools.request import Request
from odxtools.response import Response, ResponseType
from odxtools.transmode import TransMode
from odxtools.writepdxfile import write_pdx_file

from rrins.firmware_py.diagnostics import table
from rrins.firmware_py.diagnostics.responses import NEGATIVE, Code, Service
from rrins.firmware_py.version import VERSION
from rrins.host_tools.descriptions import states
from rrins.host_tools.descriptions.communication import (
    parameter_sets,
    parameter_values,
    protocol_stack,
)
from rrins.host_tools.descriptions.dictionary import Dictionary, described
from rrins.host_tools.diag.exchanges import Constant, Exchange, exchanges
from rrins.host_tools.files import replacing

CONTAINER = "rrins"
"""Short name of the container of all layers."""

COMPUTER = "navigation_computer"
"""Short name of the base variant, which describes the computer."""

VARIANT = f"{COMPUTER}_{VERSION.replace('.', '_')}"
"""Short name of the variant of this version; the CRC of its table tells whether it is that."""

_PROTOCOL = "UDS_on_CAN"
_SERVICE_ID = "service"


def write_pdx(path: Path) -> None:
    """Write the diagnostic table as a PDX file.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    base = database()
    with replacing(path) as part:
        write_pdx_file(str(part), base)


def database() -> Database:
    """Return the diagnostic table as a database of odxtools."""
    found = Database()
    found.short_name = CONTAINER
    found._diag_layer_containers = NamedItemList([_Layers().container()])
    found._comparam_subsets = parameter_sets()
    found._comparam_specs = NamedItemList([protocol_stack()])
    found.refresh()
    return found


class _Layers:
    """The layers of diagnosis: protocol, computer, and its variant of this version."""

    def __init__(self) -> None:
        self._place = (OdxDocFragment(CONTAINER, DocType.CONTAINER),)
        self._dictionary = Dictionary(self._place)
        self._requests: list[Request] = []
        self._positive: list[Response] = []
        self._services: list[DiagService] = []

    def _identity(self, kind: str, name: str) -> OdxLinkId:
        return OdxLinkId(f"{kind}.{name}", self._place)

    def container(self) -> DiagLayerContainer:
        """Return all layers."""
        protocol = self._protocol()
        computer = self._computer(protocol)
        return DiagLayerContainer(
            odx_id=self._identity("CONTAINER", CONTAINER),
            short_name=CONTAINER,
            description=described(f"The navigation computer of the RRINS rehearsal, {VERSION}."),
            protocols=NamedItemList([protocol]),
            base_variants=NamedItemList([computer]),
            ecu_variants=NamedItemList([self._variant(computer)]),
        )

    def _protocol(self) -> Protocol:
        stack = protocol_stack()
        return Protocol(
            diag_layer_raw=ProtocolRaw(
                variant_type=DiagLayerType.PROTOCOL,
                odx_id=self._identity("PROTOCOL", _PROTOCOL),
                short_name=_PROTOCOL,
                comparam_spec_ref=OdxLinkRef.from_id(stack.odx_id),
                prot_stack_snref=stack.prot_stacks[0].short_name,
                comparam_refs=parameter_values(),
            )
        )

    def _computer(self, protocol: Protocol) -> BaseVariant:
        code = self._dictionary.negative_response_code({int(code): code.name for code in Code})
        negative = {one.number: self._negative(one, code) for one in table.SERVICES}
        for exchange in exchanges():
            self._add(exchange, negative[exchange.service.number])
        return BaseVariant(
            diag_layer_raw=BaseVariantRaw(
                variant_type=DiagLayerType.BASE_VARIANT,
                odx_id=self._identity("COMPUTER", COMPUTER),
                short_name=COMPUTER,
                description=described("The navigation computer. Its table: docs/diagnostics.md."),
                functional_classes=NamedItemList([self._class(one) for one in table.SERVICES]),
                diag_data_dictionary_spec=self._dictionary.specification(),
                diag_comms_raw=[*self._services],
                requests=NamedItemList(self._requests),
                positive_responses=NamedItemList(self._positive),
                negative_responses=NamedItemList(negative.values()),
                state_charts=states.charts(self._place),
                parent_refs=[ParentRef(layer_ref=OdxLinkRef.from_id(protocol.odx_id))],
            )
        )

    def _variant(self, computer: BaseVariant) -> EcuVariant:
        version = table.identifier("table_version")
        (crc,) = version.fields
        pattern = MatchingParameter(
            expected_value=str(table.crc32()),
            diag_comm_snref=f"read_{version.name}",
            out_param_if_snref=crc.name,
        )
        return EcuVariant(
            diag_layer_raw=EcuVariantRaw(
                variant_type=DiagLayerType.ECU_VARIANT,
                odx_id=self._identity("VARIANT", VARIANT),
                short_name=VARIANT,
                ecu_variant_patterns=[EcuVariantPattern(matching_parameters=[pattern])],
                parent_refs=[ParentRef(layer_ref=OdxLinkRef.from_id(computer.odx_id))],
            )
        )

    def _class(self, service: Service) -> FunctionalClass:
        return FunctionalClass(
            odx_id=self._identity("CLASS", service.name),
            short_name=service.name,
            description=described(service.text),
        )

    def _negative(self, service: Service, code: OdxLinkRef) -> Response:
        name = f"negative_{service.name}"
        own = (Constant(_SERVICE_ID, NEGATIVE), Constant("of", service.number))
        parameters: list[Parameter] = [*self._dictionary.parameters(name, own)]
        parameters.append(
            ValueParameter(short_name="negative_response_code", byte_position=2, dop_ref=code)
        )
        return Response(
            odx_id=self._identity("NEGATIVE", name),
            short_name=name,
            response_type=ResponseType.NEGATIVE,
            parameters=NamedItemList(parameters),
        )

    def _add(self, exchange: Exchange, negative: Response) -> None:
        """Add a service, with its request and positive response."""
        name, service = exchange.name, exchange.service
        parts = (Constant(_SERVICE_ID, service.number), *exchange.request)
        request = Request(
            odx_id=self._identity("REQUEST", name),
            short_name=f"{name}_request",
            parameters=self._dictionary.parameters(f"{name}_request", parts),
        )
        self._requests.append(request)
        answers = []
        if exchange.response is not None:
            parts = (Constant(_SERVICE_ID, service.positive), *exchange.response)
            response = Response(
                odx_id=self._identity("POSITIVE", name),
                short_name=f"{name}_response",
                response_type=ResponseType.POSITIVE,
                parameters=self._dictionary.parameters(f"{name}_response", parts),
            )
            self._positive.append(response)
            answers.append(OdxLinkRef.from_id(response.odx_id))
        self._services.append(
            DiagService(
                odx_id=self._identity("SERVICE", name),
                short_name=name,
                description=described(exchange.text),
                functional_class_refs=[OdxLinkRef.from_id(self._identity("CLASS", service.name))],
                request_ref=OdxLinkRef.from_id(request.odx_id),
                pos_response_refs=answers,
                neg_response_refs=[OdxLinkRef.from_id(negative.odx_id)],
                pre_condition_state_refs=states.conditions(self._place, exchange),
                state_transition_refs=states.transitions(self._place, exchange),
                transmission_mode_raw=None if answers else TransMode.SEND_OR_RECEIVE,
            )
        )
