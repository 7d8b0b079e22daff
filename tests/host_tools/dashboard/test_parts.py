"""The parts behind the page, without a browser."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import struct

import numpy as np
import pytest

from rrins.dbc.codec import load as load_codec
from rrins.dbc.frame import frame_array
from rrins.host_tools.dashboard import events, quantities
from rrins.host_tools.dashboard.browsers import MOST_NOTICES, MOST_ROWS, Browser
from rrins.host_tools.dashboard.errors import DashboardError
from rrins.host_tools.dashboard.events import EventLog
from rrins.host_tools.dashboard.fault_forms import fault_forms
from rrins.host_tools.dashboard.feed import as_json
from rrins.host_tools.dashboard.guarding import Guard
from rrins.host_tools.dashboard.guides import guide, guide_names
from rrins.host_tools.dashboard.history import History
from rrins.host_tools.dashboard.now import Since, kind_of
from rrins.host_tools.dashboard.packing import packed_history, packed_row
from rrins.host_tools.dashboard.page_files import page_files
from rrins.host_tools.dashboard.page_orders import parse_order
from rrins.host_tools.dashboard.patience import AT_ONCE, FewLines
from rrins.host_tools.dashboard.quantities import NAMES, Quantities, SchemeAngles
from rrins.host_tools.dashboard.truth import Truth
from rrins.host_tools.dashboard.view import scheme_angles
from rrins.host_tools.monitor.watch import Watch
from rrins.host_tools.scenario.fault_tables import KINDS
from rrins.host_tools.scenario.scenario import Scenario, fault_of, load

# ---- history


def test_a_history_keeps_the_last_minute_in_full_and_all_of_the_run():
    history = History(1)
    for k in range(60_000):  # 6000 s at 10 Hz
        history.add(k * 0.1, np.array([float(k)]))
    times, rows = history.rows()
    assert len(times) < 4000
    assert np.all(np.diff(times) > 0)
    assert times[0] == 0.0
    assert np.diff(times[times > 5940]) == pytest.approx(0.1)
    assert np.diff(times).max() < 6000 / 1000
    assert rows[:, 0] == pytest.approx(times * 10, abs=0.01)


def test_a_time_before_the_latest_begins_a_new_history():
    history = History(1)
    for time_s in (10.0, 11.0, 3.0, 4.0):
        history.add(time_s, np.zeros(1))
    assert history.rows()[0].tolist() == [3.0, 4.0]


# ---- messages


def test_a_row_and_a_history_are_packed_as_their_table_says():
    row = np.array([1.5, math.nan, -2.0])
    packed = packed_row(7, 12.25, row)
    assert struct.unpack_from("<BxHIdf", packed) == (1, 3, 7, 12.25, 1.5)
    assert len(packed) == 16 + 12
    times, rows = np.array([1.0, 2.0]), np.array([[1, 2, 3], [4, 5, 6]], dtype=np.float32)
    packed = packed_history(times, rows)
    assert struct.unpack("<BxHI2d6f", packed) == (2, 3, 2, 1.0, 2.0, 1, 4, 2, 5, 3, 6)


def test_what_is_no_number_is_null():
    told = json.loads(as_json("state", {"a": math.nan, "b": [math.inf, 1.0], "c": {"d": None}}))
    assert told == {"kind": "state", "a": None, "b": [None, 1.0], "c": {"d": None}}


# ---- quantities


def sampled(**values):
    found = np.full(len(quantities.SAMPLED), math.nan)
    for name, value in values.items():
        found[list(quantities.SAMPLED).index(name)] = value
    return found


NAV = {"velocity_east": 0.0, "velocity_north": 0.0, "velocity_up": 0.0, "height_m": 40.0}


def test_errors_are_those_of_the_epoch_of_the_output():
    scenario = load("drive_rotating")
    truth = Truth(scenario)
    epoch = scenario.navigation_epoch + 100 * scenario.rate_hz
    place = truth.at(epoch)
    assert np.linalg.norm(place.velocity_n) > 0
    row = Quantities(truth, None).row(
        sampled(
            sync_epoch=epoch + 3,
            latitude_epoch=epoch % 4096,
            longitude_epoch=epoch % 4096,
            latitude_deg=math.degrees(place.latitude) + 1e-4,
            longitude_deg=math.degrees(place.longitude),
            velocity_east=place.velocity_n[0],
            velocity_north=place.velocity_n[1] + 0.25,
            velocity_up=0.0,
            height_m=place.height + 2,
        ),
        12.0,
        0.5,
    )
    found = dict(zip(NAMES, row, strict=True))
    assert found["error_north_m"] == pytest.approx(11.1, abs=0.1)  # of a degree: 111 km
    assert found["error_east_m"] == pytest.approx(0, abs=1e-6)
    assert found["error_north_mps"] == pytest.approx(0.25)
    assert found["error_up_m"] == pytest.approx(2)
    assert (found["bus_load_percent"], found["lateness_ms"]) == (12.0, 0.5)


def test_halves_of_an_output_of_two_epochs_make_no_error():
    values = NAV | {"latitude_deg": 40.0, "longitude_deg": 116.0, "sync_epoch": 500}
    row = Quantities(Truth(load("ideal")), None).row(
        sampled(latitude_epoch=490, longitude_epoch=480, **values), 0.0, 0.0
    )
    assert np.isnan(row[list(NAMES).index("error_east_m")])


def test_without_a_scenario_places_count_from_the_first_one():
    seen = Quantities(None, None)
    for epoch, latitude in ((10, 40.0), (20, 40.001)):
        row = seen.row(
            sampled(
                latitude_epoch=epoch,
                longitude_epoch=epoch,
                sync_epoch=epoch,
                latitude_deg=latitude,
                longitude_deg=116.0,
                **NAV,
            ),
            0.0,
            0.0,
        )
    found = dict(zip(NAMES, row, strict=True))
    assert found["north_m"] == pytest.approx(111.0, abs=0.5)
    assert math.isnan(found["error_north_m"])


def test_the_scheme_wants_the_angles_that_its_turns_sum_up_to():
    angles = scheme_angles(load("rimu_rotating"))
    assert angles.held_deg[:4].tolist() == [[180, 0], [180, -180], [360, -180], [360, 0]]
    assert angles.cycle_deg.tolist() == [0, 0]
    one_way = SchemeAngles(np.array([[90.0, 0.0]]), np.array([90.0, 0.0]))
    assert one_way.at(1, 3).tolist() == [360, 0]
    assert np.isnan(one_way.at(0, 0)).all()
    assert np.isnan(one_way.at(math.nan, 0)).all()


# ---- events


def followed(log, time_s, **changes):
    values = getattr(log, "shown", np.full(len(events.SIGNALS), math.nan)).copy()
    for name, value in changes.items():
        values[list(events.SIGNALS).index(name.replace("__", "."))] = value
    log.shown = values
    times_s = getattr(log, "times_s", np.zeros(len(values))).copy()
    times_s[[list(events.SIGNALS).index(name.replace("__", ".")) for name in changes]] = time_s
    log.times_s = times_s
    return [event.text for event in log.follow(values, times_s)]


def test_a_fault_that_is_found_and_repaired_in_words():
    log = EventLog()
    kind = "GYRO_REDUNDANCY__"
    sound = {f"{kind}{name}": 0 for name in ("alarm", "excluded", "repairing", "isolated", "how")}
    assert followed(log, 1.0, FIRMWARE_STATUS__mode=5) == ["navigation with rotation"]
    assert followed(log, 2.0, **sound, **{f"{kind}parity_ratio": 0.3}) == []
    told = followed(log, 3.0, **{f"{kind}alarm": 1, f"{kind}parity_ratio": 1.25})
    assert told == ["the gyros disagree: parity 1.25 × its threshold"]
    told = followed(
        log,
        4.0,
        **{f"{kind}alarm": 0, f"{kind}excluded": 4, f"{kind}isolated": 3, f"{kind}how": 1},
    )
    assert told == ["gyro 3 left out, found by comparison with the others"]
    assert followed(log, 5.0, **{f"{kind}repairing": 1}) == [
        "the navigation is being repaired from before the fault"
    ]
    assert followed(log, 6.0, **{f"{kind}repairing": 0}) == ["the navigation is repaired"]
    assert followed(log, 7.0, **{f"{kind}excluded": 0}) == ["gyro 3 is back in use"]
    assert followed(log, 8.0) == []
    stopped = ["the rotation has stopped: navigation goes on without"]
    assert followed(log, 8.5, FIRMWARE_STATUS__mode=4) == stopped
    assert log.events[-1].weight == "warning"
    assert followed(log, 9.0, FIRMWARE_STATUS__mode=6, FIRMWARE_STATUS__fault=2) == [
        "mode FAULT: SENSORS_LOST"
    ]


def test_a_calibration_that_has_drifted_in_words():
    log = EventLog()
    drift = "ACCELEROMETER_REDUNDANCY__drift"
    assert followed(log, 1.0, **{drift: 0}) == []
    told = ["accelerometer calibration drifted: from 10 to 20 ppm, if it is one accelerometer"]
    assert followed(log, 2.0, **{drift: 2}) == told
    assert log.events[-1].weight == "warning"
    assert followed(log, 3.0, **{drift: 3}) == []  # once, however the estimate goes on
    told = ["accelerometer calibration: no drift is reported any more"]
    assert followed(log, 4.0, **{drift: 0}) == told


def test_events_stand_at_the_time_of_their_effect():
    """However late one looks, and whenever the answer to an order comes."""
    log = EventLog()
    order = ["HARDWARE_FAULT_STATUS.active_faults", "GYRO_REDUNDANCY.excluded"]
    rows = [list(events.SIGNALS).index(name) for name in order]
    values, since_s = np.full((2, len(events.SIGNALS)), math.nan)
    values[rows], since_s[rows] = 0, 1.0
    assert log.follow(values, since_s) == []
    values[rows], since_s[rows] = [1, 0b100], [265.0, 266.0]
    log.follow(values, since_s)
    log.add(265.0, "gyro_bias of gyro 3", "order")
    log.add(321.0, "the end")
    found = [(event.time_s, event.text.split(",")[0]) for event in log.events]
    assert found == [
        (265.0, "1 fault of the hardware active"), (265.0, "gyro_bias of gyro 3"),
        (266.0, "gyro 3 left out"), (321.0, "the end"),
    ]  # fmt: skip
    assert (log.count, log.late) == (4, 1)


def test_a_long_log_forgets_its_beginning():
    log = EventLog()
    for k in range(events.MOST + 10):
        log.add(float(k), "again")
    assert len(log.events) == events.MOST
    assert log.count == events.MOST + 10
    assert log.events[0].time_s == 10.0


# ---- orders and forms


def test_there_is_a_form_for_each_fault_that_inject_takes():
    forms = fault_forms()
    assert list(forms) == list(KINDS)
    assert {form["group"] for form in forms.values()} == {
        "gyros", "accelerometers", "turntable", "aiding", "on the wire",
    }  # fmt: skip
    for kind, form in forms.items():
        keys = {"kind": kind}
        for field in form["fields"]:
            if field["is_needed"]:
                keys[field["key"]] = field["choices"][0]
            elif field["default"] is not None and field["key"] != "duty":
                keys[field["key"]] = field["default"]
        assert fault_of(keys).kind == kind


def test_a_form_has_the_keys_of_its_kind_only():
    forms = fault_forms()
    keys = {kind: [field["key"] for field in form["fields"]] for kind, form in forms.items()}
    assert keys["gyro_bias"] == ["sensor", "bias_dph", "for_s", "period_s", "duty"]
    assert keys["axis_stall"] == ["axis", "for_s", "period_s", "duty"]
    assert keys["corrupt"] == ["message", "node", "probability", "bit", "for_s"]
    assert "jump_m" in keys["gnss_jump"]
    assert "jump_m" not in keys["gnss_lost"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not an order"),
        ("[]", "not an order"),
        ("{}", "id: Field required"),
        ('{"id": 1, "order": "explode"}', "order: "),
        ('{"id": 1, "order": "stop", "shell": "rm"}', "shell: Extra inputs"),
        ('{"id": -1, "order": "stop"}', "id: "),
        ('{"id": 1, "order": "inject"}', "inject: needs fault"),
        ('{"id": 1, "order": "seek"}', "seek: needs time_s"),
        ('{"id": 1, "order": "speed", "speed": NaN}', "speed: "),
        ('{"id": 1, "order": "speed", "speed": 1e300}', "speed: "),
        ("x" * 5000, "5000 characters"),
    ],
)
def test_what_is_no_order_is_refused_in_one_line(text, says):
    with pytest.raises(DashboardError, match=r"^[^\n]+$") as caught:
        parse_order(text)
    assert says in str(caught.value)


# ---- browsers


def test_a_slow_browser_gets_the_newest_rows():
    async def slow():
        browser = Browser(may_control=False)
        for k in range(100):
            browser.put_row(bytes([k]))
            browser.put_latest("state", f"state {k}")
        browser.put("an event")
        got = [await browser.next_message() for _ in range(2 + MOST_ROWS)]
        assert got == ["an event", "state 99", *(bytes([k]) for k in range(100 - MOST_ROWS, 100))]
        assert browser.dropped == 100 - MOST_ROWS
        for _ in range(MOST_NOTICES + 1):
            browser.put("an event")
        assert browser.is_stuck

    asyncio.run(slow())


# ---- guarding


def test_pages_of_others_are_refused():
    guard = Guard.of("127.0.0.1")
    assert guard.refuses_host("127.0.0.1:8350") is None
    assert guard.refuses_host("localhost:8350") is None
    assert guard.refuses_host("[::1]:8350") is None
    assert guard.refuses_host("evil.example:8350") == "Host 'evil.example:8350'"
    for host in (
        None,
        "",
        "[::1]evil:80",
        "[::1]:80:80",
        "localhost:80@evil",
        "[::1",
        "127.0.0.1:x",
    ):
        assert guard.refuses_host(host) is not None
    assert guard.refuses_origin("http://127.0.0.1:8350", "127.0.0.1:8350") is None
    for origin in (None, "null", "http://evil.example", "http://127.0.0.1:1", "file://"):
        assert guard.refuses_origin(origin, "127.0.0.1:8350") is not None
    assert guard.may_control(None)


def test_elsewhere_orders_need_the_token():
    guard = Guard.of("0.0.0.0")
    assert guard.token is not None
    assert len(guard.token) >= 20
    assert guard.refuses_host("192.168.1.7:8350") is None
    assert guard.refuses_host("[::1]evil:80") is not None
    assert guard.refuses_host("evil.example:8350") is not None
    assert not guard.may_control(None)
    assert not guard.may_control("")
    assert not guard.may_control("wröng")
    assert guard.may_control(guard.token)
    assert Guard.of("0.0.0.0").token != guard.token


def test_refusals_are_printed_in_a_burst_then_one_a_second():
    now = [0.0]
    few = FewLines(lambda: now[0])

    def printed():
        record = logging.makeLogRecord({"msg": "%s refused", "args": ("one",)})
        return record.getMessage() if few.filter(record) else None

    assert [printed() for _ in range(AT_ONCE + 30)].count(None) == 30
    now[0] = 1.5
    assert printed() == "one refused (30 more lines are not shown)"
    assert printed() is None
    now[0] = 100.0
    assert printed() == "one refused (1 more lines are not shown)"
    assert printed() == "one refused"


# ---- what is wrong now


NOW = [  # in the words of the monitor
    ("mode FAULT: SENSORS_LOST", "bad"),
    ("the inner axis did not follow its command", "bad"),
    ("the outer encoder contradicts the gyros: the gyros' angle is used", "bad"),
    ("the gyros disagree: one of them fails, and it is not known which", "bad"),
    ("gyro 3 is left out, found by comparison with the others", "warning"),
    ("no redundancy is left among the gyros", "bad"),
    ("SENSOR_3 has been silent for 2.3 s", "bad"),
    ("SYNC: 3 lost recently", "warning"),
    ("injected into the hardware by rrins: 1 fault", "note"),
]


@pytest.mark.parametrize(("text", "severity"), NOW)
def test_a_trouble_has_a_severity_and_a_section_of_a_guide_that_there_is(text, severity):
    found, page = kind_of(text)
    assert found == severity
    name, _, section = page.partition("#")
    assert name in guide_names()
    assert not section or f'id="{section}"'.encode() in guide(name)


def test_a_trouble_began_when_its_signal_changed_however_late_it_is_looked_at():
    since, left_out = Since(), "gyro 3 is left out, found by comparison with encoders"
    changed_s = {"GYRO_REDUNDANCY.excluded": 188.0, "GYRO_REDUNDANCY.alarm": 170.0}
    since.follow(187.0, [], changed_s)
    since.follow(191.0, [left_out, "SENSOR_3 reports GYRO_ABSENT"], changed_s)
    since.follow(195.0, [left_out], changed_s | {"GYRO_REDUNDANCY.excluded": 194.0})
    begun = {one["text"]: one["since_s"] for one in since.told(195.0, [left_out])}
    assert begun == {left_out: 188.0}
    assert since.told(191.0, ["SENSOR_3 reports GYRO_ABSENT"])[0]["since_s"] == 191.0


def test_a_trouble_has_been_there_since_it_began_however_its_numbers_change():
    since = Since()
    since.follow(1.0, [])
    since.follow(2.0, ["SENSOR_3 has been silent for 310 ms", "SYNC: 3 lost recently"])
    since.follow(3.0, ["SENSOR_3 has been silent for 1.3 s"])
    since.follow(4.0, ["SENSOR_3 has been silent for 2.3 s", "SENSOR_4 has been silent for 1.3 s"])
    told = since.told(4.0, ["SYNC: 8 lost recently", "SENSOR_3 has been silent for 2.4 s"])
    assert [(one["text"][:8], one["since_s"]) for one in told] == [
        ("SENSOR_3", 2.0),
        ("SYNC: 8 ", 2.0),
    ]
    since.is_whole = True  # a recording: wherever it is played
    assert since.told(2.5, ["SENSOR_4 has been silent for 1.3 s"])[0]["since_s"] is None
    since.follow(9.0, ["SYNC: 1 lost recently"])
    assert since.told(9.0, ["SYNC: 1 lost recently"])[0]["since_s"] == 2.0


def test_without_redundancy_the_parity_is_a_gap_and_estimates_are_kept_for_each_gyro():
    seen = Quantities(None, None)
    row = seen.row(sampled(gyro_parity=0.0, gyro_redundant=0.0, estimated_gyro=2.0), 0.0, 0.0)
    assert np.isnan(row[NAMES.index("gyro_parity")])
    row = seen.row(
        sampled(
            gyro_parity=0.4,
            gyro_redundant=1.0,
            estimated_gyro=1.0,
            estimated_bias_dph=0.5,
            estimated_sigma_dph=0.1,
        ),
        0.0,
        0.0,
    )
    assert row[NAMES.index("gyro_parity")] == 0.4
    assert row[NAMES.index("gyro_bias_1_dph")] == 0.5
    assert row[NAMES.index("sigma_gyro_bias_1_dph")] == 0.1
    seen.forget()
    row = seen.row(sampled(), 0.0, 0.0)
    assert np.isnan(row[NAMES.index("gyro_bias_1_dph")])


def test_the_page_is_whole_and_light():
    files = page_files()
    for name in ("/", "/main.js", "/style.css", "/carried/three.module.min.js"):
        assert name in files
    assert not any("LICENSE" in name for name in files)  # in the package, not on the page
    once = {name: file for name, file in files.items() if name != "/"}
    assert sum(len(file.content) for file in once.values()) < 1_000_000
    assert sum(len(file.packed) for file in once.values()) < 300_000
    ours = [f for name, f in once.items() if "carried" not in name and name != "/icon.svg"]
    assert not any(b"http://" in file.content or b"https://" in file.content for file in ours)


# ---- the watch, as the dashboard reads it


def test_values_of_signals_are_the_latest_and_none_before_the_first():
    codec = load_codec()
    rows = quantities.rows_of({"epoch": ("SYNC", "epoch"), "mode": ("FIRMWARE_STATUS", "mode")})
    watch = Watch()
    assert np.isnan(watch.latest(rows).values).all()
    scenario = Scenario(duration_s=1)
    from rrins.host_tools.hardware.loop import Hardware
    from rrins.host_tools.runs.set_up.settings import hardware_settings

    hardware = Hardware(hardware_settings(scenario))
    inbox = frame_array(0)
    for epoch in range(3):
        frames, count = hardware.open_epoch(epoch, inbox, 0)
        watch.add_frames(frames, count, epoch * scenario.period_ns)
    latest = watch.latest(rows)
    assert latest.values[0] == 2
    assert np.isnan(latest.values[1])
    assert latest.now_ns == 2 * scenario.period_ns
    assert latest.busy_ns > 0
    assert codec.signal_index("SYNC", "epoch") == rows[0]
    memory = watch.memory()
    frames, count = hardware.open_epoch(3, inbox, 0)
    times = np.full(count, 3 * scenario.period_ns)
    watch.add_timed_frames(frames[:count], times)
    assert watch.latest(rows).values[0] == 3
    watch.restore(memory)
    assert watch.latest(rows).values[0] == 2
