"""The PDX by odxtools, which nobody here wrote: it drives the server, and reads what it answers."""

from __future__ import annotations

import zlib
from typing import Any

import odxtools
import pytest
from click.testing import CliRunner
from odxtools.decodestate import DecodeState

from rrins.firmware_py.core.records.troubles import ALL_RECORDS
from rrins.firmware_py.diagnostics import access, table
from rrins.firmware_py.diagnostics.access import key_of
from rrins.firmware_py.diagnostics.identifiers import IOControl
from rrins.firmware_py.diagnostics.regions import CALIBRATION_ADDRESS
from rrins.firmware_py.diagnostics.responses import NEGATIVE, Code
from rrins.host_tools.cli.main import rrins
from tests.conftest import warnings_as_errors

pytestmark = pytest.mark.slow

_PATIENCE = 2000  # epochs
_POLAR = [[54.7356, 22.5 * k] for k in range(15)]
ALL_SENSORS = {"geometry": "custom", "gyro_axes_deg": [[0.0, 0.0], *_POLAR],
    "accelerometer_axes_deg": [[0.0, 0.0], *_POLAR]}  # fmt: skip


@pytest.fixture(scope="module")
def pdx(tmp_path_factory):
    """Return the database of the file that the command writes; a warning is an error."""
    path = tmp_path_factory.mktemp("pdx") / "rrins.pdx"
    done = CliRunner().invoke(rrins, ["export", str(path)], prog_name="rrins")
    assert done.exit_code == 0, done.output
    with warnings_as_errors():
        return odxtools.load_pdx_file(path)


@pytest.fixture(scope="module")
def ecu(pdx):
    (variant,) = pdx.ecu_variants
    return variant


class Driver:
    """Somebody whose tool knows the computer by the PDX alone."""

    def __init__(self, ecu: Any, bench: Any) -> None:
        self.ecu = ecu
        self.bench = bench
        self.node = bench._execution.firmware.diagnostics
        self.services = {service.short_name: service for service in ecu.services}
        self.codes: set[str] = set()
        """Negative responses so far, by name."""
        self.seen: dict[str, list[bool]] = {}
        """Whether the requests of each service were answered positively."""

    def send(self, request: bytes) -> bytes | None:
        server = self.node.server
        response = server.handle(request, False, self.node.now_ns)
        for _ in range(_PATIENCE):
            if response is not None or not server.is_busy:
                break
            self.bench.step()
            response = server.poll(self.node.now_ns)
        return response

    def ask(self, name: str, **values: Any) -> dict[str, Any] | None:
        """Make a request that the file describes; return the response as it describes it."""
        service = self.services[name]
        request = bytes(service.encode_request(**values))
        assert decoded(service, request) is not None
        response = self.send(request)
        if response is None:
            assert not service.positive_responses, name
            self.seen.setdefault(name, []).append(True)
            return None
        found = decoded(service, response)
        self.seen.setdefault(name, []).append(response[0] != NEGATIVE)
        if response[0] == NEGATIVE:
            self.codes.add(found["negative_response_code"])
        return found

    def refused(self, name: str, request: str) -> None:
        """Make a request that the file would not, and read the refusal by the file."""
        found = decoded(self.services[name], self.send(bytes.fromhex(request)))
        self.codes.add(found["negative_response_code"])

    def prepare(self, name: str) -> None:
        """Enter the state that the file asks for."""
        states = {ref.ref_id for ref in self.services[name].pre_condition_state_refs}
        sessions = [f"STATE.session.{name}" for name in ("default", "programming", "extended")]
        if sessions[self.node.server.session - 1] not in states:
            self.ask("diagnostic_session_control_extended")
            if sessions[2] not in states:
                self.ask("diagnostic_session_control_programming")
        if "STATE.lock.unlocked" in states and not self.node.server.is_unlocked:
            self.unlock()

    def unlock(self) -> None:
        seed = bytes(self.ask("security_access_request_seed")["seed"])
        assert self.ask("security_access_send_key", key=key_of(seed))["service"] == 0x67


def decoded(service: Any, message: bytes) -> dict[str, Any]:
    """Return what a message means by the file, which explains its every byte."""
    found = service.decode_message(message)
    state = DecodeState(coded_message=message)
    found.coding_object.decode_from_pdu(state)
    assert state.cursor_byte_position == len(message), service.short_name
    return found.param_dict


def example(part: Any) -> Any:
    """Return a value that the description of a parameter allows."""
    if hasattr(part, "fixed_number_of_items"):
        return [example(part.structure)] * part.fixed_number_of_items
    if hasattr(part, "parameters"):
        return {one.short_name: example(one.dop) for one in part.parameters}
    if hasattr(part, "dtcs"):
        return part.dtcs[0].short_name
    scales = part.compu_method.compu_internal_to_phys
    if scales is not None:
        return scales.compu_scales[0].compu_const.value
    if part.internal_constr is not None:
        return part.internal_constr.lower_limit.value
    return {"A_BYTEFIELD": b"\0", "A_UINT32": 1}.get(part.physical_type.base_data_type.value, 0.0)


@pytest.fixture
def driver(ecu, rrins_bench):
    """A driver of a computer with all that it can have, which navigates."""
    bench = rrins_bench(
        "ideal", way="direct", duration_s=3600.0, rimu=ALL_SENSORS,
        altimeter={"noise_m": 0.5}, gnss={"rate_hz": 1}, odometer={"rate_hz": 10},
        firmware={"height_channel": "damped"}, estimator={"enabled": True},
    )  # fmt: skip
    bench.advance(6.0)
    return Driver(ecu, bench)


SPECIAL: dict[str, dict[str, Any]] = {
    "read_memory": {"address": 0, "size": 16},
    "read_identifiers": {"identifiers": [{"identifier": "mode"}, {"identifier": "position"}]},
    "request_download": {"address": CALIBRATION_ADDRESS, "size": 4},
    "request_upload": {"address": CALIBRATION_ADDRESS, "size": 0x4000},
    "clear_trouble_codes": {"group_of_dtc": 0xFFFFFF},
    "report_dtc_snapshot_record_by_dtc_number": {"record_number": ALL_RECORDS},
    "report_dtc_ext_data_record_by_dtc_number": {"record_number": ALL_RECORDS},
}
"""Values that no description of a single value can say."""


def values_for(service: Any) -> dict[str, Any]:
    special = SPECIAL.get(service.short_name, {})
    free = [one for one in service.request.parameters if one.is_settable and one.is_required]
    return special | {
        one.short_name: example(one.dop) for one in free if one.short_name not in special
    }


def test_it_loads_without_a_word(pdx, caplog):
    assert caplog.get_records("setup") == []  # where it was loaded
    assert [layer.short_name for layer in pdx.diag_layers] == [
        "UDS_on_CAN", "navigation_computer", "navigation_computer_0_1_0",
    ]  # fmt: skip


def test_communication(ecu):
    assert ecu.get_can_receive_id() == table.request_id()
    assert ecu.get_can_send_id() == table.response_id()
    assert ecu.get_can_func_req_id() == table.functional_id()
    assert ecu.get_can_baudrate() == 1_000_000
    assert ecu.get_tester_present_time() < access.S3_MS / 1000
    assert ecu.get_comparam("CP_P2Max").get_value() == "50000"
    assert ecu.get_comparam("CP_CanFillerByte").get_value() == str(access.PADDING)


def test_all_that_the_table_has(ecu):
    """Every identifier, control, routine, trouble code and negative response is in the file."""
    names = {service.short_name for service in ecu.services}
    wanted = {f"read_{did.name}" for did in table.IDENTIFIERS}
    wanted |= {f"write_{did.name}" for did in table.IDENTIFIERS if did.write}
    wanted |= {
        f"control_{did.name}_{option.name.lower()}"
        for did in table.IDENTIFIERS if did.control for option in IOControl
    }  # fmt: skip
    for routine in table.ROUTINES:
        wanted |= {f"start_{routine.name}", f"result_of_{routine.name}"}
        wanted |= {f"stop_{routine.name}"} if routine.can_stop else set()
    assert wanted <= names
    dictionary = ecu.diag_data_dictionary_spec
    codes = {one.trouble_code: one for one in dictionary.dtc_dops.trouble_code.dtcs}
    assert codes.keys() == {trouble.number for trouble in table.TROUBLES}
    for trouble in table.TROUBLES:
        found = codes[trouble.number]
        assert found.display_trouble_code == trouble.code
        assert found.text.text == trouble.text
    assert {service.request.parameters[0].coded_value for service in ecu.services} == {
        service.number for service in table.SERVICES
    }
    code = dictionary.data_object_props.negative_response_code
    scales = code.compu_method.compu_internal_to_phys.compu_scales
    assert {scale.compu_const.value for scale in scales} == {code.name for code in Code}


def test_units_and_limits(ecu):
    (bridge,) = [p for p in ecu.services.write_bridge.request.parameters if p.is_settable]
    assert bridge.dop.unit.display_name == "s"
    assert bridge.dop.internal_constr.upper_limit.value == 10.0
    assert ecu.services.read_velocity.positive_responses[0].parameters[2].dop.unit.display_name == (
        "m/s"
    )


AXIS = {"axis": "INNER", "angle_deg": 10.0}
FIRST: tuple[tuple[str, dict[str, Any]], ...] = (
    ("stop_rotation", {}), ("start_rotation", {}), ("result_of_rotation", {}),
    ("start_standby", {}), ("result_of_standby", {}),
    ("start_go_to_axis_angle", AXIS), ("result_of_go_to_axis_angle", {}),
    ("stop_go_to_axis_angle", {}),
    ("start_calibration", {"duration_s": 10, "store": 0}), ("result_of_calibration", {}),
    ("stop_calibration", {}),
    ("start_table_calibration", {}), ("result_of_table_calibration", {}),
    ("stop_table_calibration", {}),
    ("start_alignment", {}), ("result_of_alignment", {}), ("stop_alignment", {}),
    ("request_upload", {}), ("transfer_data", {"block_sequence_counter": 1, "data": b""}),
)  # fmt: skip
"""Requests that must follow each other; all others come in any order."""
NO_REFUSED_SENSOR = {"stop_readmit_sensor"}  # it fails at once: no sensor is left out
LAST = ("session", "reset")


def test_every_service_and_identifier_through_the_file(driver):
    """Drive the server by what the file says; the answers mean what the table says."""
    for name, values in FIRST:
        driver.prepare(name)
        driver.ask(name, **(values_for(driver.services[name]) | values))
        driver.bench.step(200)
    assert {name for name, answers in driver.seen.items() if not all(answers)} == set()
    for name in driver.services:
        if name in driver.seen or any(f"{word}_control" in name for word in LAST) or "ecu" in name:
            continue
        driver.prepare(name)
        values = values_for(driver.services[name])
        if name.startswith("write_"):
            values = values_of(driver.ask(name.replace("write_", "read_")))
        driver.ask(name, **values)
    for trouble in table.TROUBLES:
        for name in SPECIAL:
            if name.startswith("report_dtc"):
                found = driver.ask(name, dtc=trouble.name, record_number=ALL_RECORDS)
                assert found["dtc"].trouble_code == trouble.number
    download(driver)
    for name in driver.services:
        if name not in driver.seen:
            driver.prepare(name)
            driver.ask(name)
            driver.node.restart()
    assert driver.seen.keys() == driver.services.keys()
    refused = {name for name, answers in driver.seen.items() if not any(answers)}
    assert refused == NO_REFUSED_SENSOR


def values_of(response: dict[str, Any]) -> dict[str, Any]:
    return {key: response[key] for key in response if key not in ("service", "identifier")}


def download(driver: Driver) -> None:
    """Push the calibration file that the computer gives."""
    file = driver.node._computer.calibration_file()
    driver.ask("diagnostic_session_control_default")
    driver.prepare("request_download")
    driver.ask("request_download", address=CALIBRATION_ADDRESS, size=len(file))
    for counter, start in enumerate(range(0, len(file), 1024), 1):
        block = file[start : start + 1024]
        assert driver.ask("transfer_data", block_sequence_counter=counter, data=block)
    crc = zlib.crc32(file)
    assert driver.ask("request_transfer_exit", crc32=crc.to_bytes(4, "big"))["crc32"] == crc


def test_values_are_those_of_the_table(driver):
    """What the file makes of a response is what the table does."""
    for did in table.IDENTIFIERS:
        data = driver.send(b"\x22" + did.number.to_bytes(2, "big"))
        own = did.layout.named(did.decode(data[3:]))
        theirs = values_of(decoded(driver.services[f"read_{did.name}"], data))
        for field in did.fields:
            assert plain(theirs[field.name]) == pytest.approx(
                wanted(field, own[field.name]), nan_ok=True
            ), did.name


def plain(value: Any) -> Any:
    """Return a value of odxtools as the table has it."""
    if isinstance(value, dict) and value.keys() == {"high", "low"}:
        return (value["high"] << 32) + value["low"]
    if isinstance(value, list):
        return [one["value"] for one in value]
    return value.rstrip(" \0") if isinstance(value, str) else value


def wanted(field: Any, value: Any) -> Any:
    if isinstance(value, tuple):
        return [field.named(one) for one in value]
    return value


class Slow:
    """A memory that takes a second to write."""

    def __init__(self, node: Any) -> None:
        self._node = node

    def submit(self, store: Any, image: Any) -> Any:
        until_ns = self._node.now_ns + 1_000_000_000
        node = self._node

        class Job:
            failed = False
            done = property(lambda self: node.now_ns >= until_ns)

        return Job()

    def close(self) -> None: ...


def test_every_negative_response_through_the_file(driver):
    """Each negative response of the table is got from the server, and named by the file."""
    ask = driver.ask
    ask("read_memory", address=0, size=1)
    driver.refused("read_mode", "22010200")  # too short: no pair of bytes
    driver.refused("report_supported_dtc", "190b")
    driver.refused("read_mode", "22ffff")
    driver.refused("diagnostic_session_control_programming", "1002")
    driver.prepare("read_memory")
    ask("read_memory", address=0, size=4095)
    ask("write_bridge", bridge_s=0.5)
    ask("result_of_self_test")
    wrong = b"\1" * access.KEY_SIZE
    for _ in range(access.ATTEMPTS):
        ask("security_access_request_seed")
        ask("security_access_send_key", key=wrong)
    ask("security_access_request_seed")
    driver.bench.advance(access.ATTEMPT_DELAY_MS / 1000)
    driver.prepare("start_self_test")
    ask("start_self_test")
    driver.prepare("request_download")
    for size, counter, crc in ((1, 2, 0), (1, 1, 0), (4, 1, 0)):
        ask("request_download", address=CALIBRATION_ADDRESS, size=size)
        ask("transfer_data", block_sequence_counter=counter, data=b"\0\0\0\0")
        ask("request_transfer_exit", crc32=crc.to_bytes(4, "big"))
        ask("diagnostic_session_control_default")
        driver.prepare("request_download")
    driver.node.parameters._store = object()  # the writer does not look at it
    driver.node.writer = Slow(driver.node)
    ask("write_bridge", bridge_s=0.5)
    ask("read_mode")  # meanwhile
    driver.bench.advance(1.5)
    driver.node.server.poll(driver.node.now_ns)
    driver.prepare("start_self_test")
    ask("ecu_reset_soft_reset")
    ask("read_mode")  # the reset is due
    assert driver.codes == {code.name for code in Code}


def test_a_freeze_frame_holds_the_values_of_its_moment(driver):
    driver.bench.inject("gyro_absent", sensor=2)
    driver.bench.advance(2.0)
    name = "report_dtc_snapshot_record_by_dtc_number"
    found = driver.ask(name, dtc="gyro_2_absent", record_number=ALL_RECORDS)
    first, last = found["freeze_frames"]
    assert (first["record_number"], last["record_number"]) == (1, 2)
    values = dict(one["record"] for one in first["values"])
    assert 1200 <= plain(values["epoch"]["epoch"]) < 1300  # the fault came at 6 s
    assert values["mode"] == {"mode": "NAVIGATION_ROTATING", "fault": "NONE"}
    assert values["position"]["latitude_deg"] == pytest.approx(40.3554, abs=1e-4)
    assert len(values["attitude"]) == 3
