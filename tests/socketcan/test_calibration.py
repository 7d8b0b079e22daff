"""A calibration over the kernel's vcan0: in use after a power cycle, kept when the next one fails.

Runs where vcan0 is; with RRINS_REQUIRE_SOCKETCAN set, its lack is a failure.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading

import can
import numpy as np
import pytest
from click.testing import CliRunner

from rrins.dbc.codec import load
from rrins.firmware_py.diagnostics import calibration_image
from rrins.firmware_py.diagnostics.parameters import CALIBRATED, GYRO_CALIBRATIONS
from rrins.host_tools.bus.address import Address
from rrins.host_tools.calibration.unit import drawn_unit
from rrins.host_tools.cli.main import rrins
from rrins.host_tools.injection.client import FaultClient
from rrins.host_tools.scenario.scenario import fault_of

pytestmark = pytest.mark.soak

START_S = 300
VCAN0 = ("--interface", "socketcan", "--channel", "vcan0")
BUS = (*VCAN0, "--timeout", "20")  # a machine may be slow
AXIS = {"rate_limit_dps": 60, "acceleration_limit_dps2": 300}
SCHEME = (  # the best of 24 s, by `rrins scheme search --for calibration`
    ("inner", -270), ("outer", 270), ("outer", -360), ("inner", 270), ("inner", 0), ("outer", 90),
)  # fmt: skip
RATE_DPS, STAND_S = 60, 0.5


class SwitchedOn:
    """A unit on vcan0 that waits in STANDBY, at half speed for slow machines; off at the end."""

    def __init__(self, scenario, parameters, said):
        self._said = said
        words = (str(scenario), *VCAN0, "--speed", "0.5")
        sides = {"hardware": (), "firmware": ("--parameters", str(parameters))}
        with can.Bus("vcan0", interface="socketcan") as listener:
            status = load().frame_id("FIRMWARE_STATUS")
            listener.set_filters([{"can_id": status, "can_mask": 0x7FF}])
            self.sides = [
                subprocess.Popen(
                    [sys.executable, "-m", "rrins", side, *words, *more],
                    stdout=said,
                    stderr=said,
                )
                for side, more in sides.items()
            ]
            heard = listener.recv(START_S)
        if heard is None:
            self._switch_off()
            raise AssertionError(self._words())

    def _words(self):
        self._said.seek(0)
        return self._said.read().decode()

    def _switch_off(self):
        for side in self.sides:
            side.terminate()
            side.wait(60)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        ran = [side.poll() for side in self.sides]
        self._switch_off()
        assert ran == [None, None], self._words()


def run(*words):
    return CliRunner().invoke(rrins, [*map(str, words), *BUS])


def stored(path):
    """Return the parameters that the unit holds."""
    pulled = run("diag", "calibration", "pull", path)
    assert pulled.exit_code == 0, pulled.stderr
    return calibration_image.decode(path.read_bytes())


def break_gyro_2_when_the_table_turns():
    """Inject a fault 3 s after an axis has begun to move."""
    codec = load()
    moving = codec.database.get_message_by_name("AXIS_INNER_STATUS")
    with can.Bus("vcan0", interface="socketcan") as listener:
        listener.set_filters([{"can_id": moving.frame_id, "can_mask": 0x7FF}])
        moved = 0
        while moved < 3 * 50:
            message = listener.recv(START_S)
            assert message is not None
            moved += moving.decode(message.data)["state"] == "MOVING"
    with FaultClient(Address("socketcan", "vcan0"), patience_s=30) as client:
        client.inject(fault_of({"kind": "gyro_absent", "sensor": 2}))


@pytest.mark.timeout(900)
def test_it_is_pushed_lasts_and_outlives_one_that_fails(tmp_path):
    scenario = drawn_unit(3).varied(
        rate_hz=50, navigate_at_s=3600, turntable__inner=AXIS, turntable__outer=AXIS
    )
    unit, scheme = tmp_path / "unit.toml", tmp_path / "brisk.toml"
    unit.write_text(scenario.toml(), encoding="utf-8")
    turns = [f'[[turns]]\naxis = "{axis}"\nangle_deg = {angle}\n' for axis, angle in SCHEME]
    pace = f"turn_rate_dps = {RATE_DPS}\nstand_s = {STAND_S}\n"
    scheme.write_text(pace + "".join(turns), encoding="utf-8")
    parameters = tmp_path / "parameters.bin"
    calibrate = ("calibrate", unit, "--scheme", scheme, "--json", "--out", tmp_path / "out")
    with (tmp_path / "said.txt").open("w+b") as said:
        with SwitchedOn(unit, parameters, said):
            before = stored(tmp_path / "before.rrca")
            done = run(*calibrate, "--push")
            assert done.exit_code == 0, done.stderr
        with SwitchedOn(unit, parameters, said):
            pushed = stored(tmp_path / "pushed.rrca")
            fault = threading.Thread(target=break_gyro_2_when_the_table_turns)
            fault.start()
            failed = run(*calibrate, "--push", "--anew")
            fault.join()
            assert failed.exit_code == 12, failed.stderr
            assert "gyro 2 failed" in failed.stderr.splitlines()[-1]
            assert stored(tmp_path / "kept.rrca") == pushed
    assert not before[CALIBRATED.number]["date_utc_s"]
    assert pushed[CALIBRATED.number]["date_utc_s"]
    found = json.loads(done.stdout)
    for sensor, did in enumerate(GYRO_CALIBRATIONS[:4]):
        value = found["gyros"]["bias_dph"]["value"][sensor]
        assert pushed[did.number]["bias_dph"] == pytest.approx(value, rel=1e-5)
    assert found["verified"].startswith("stored in the unit; a second run of")
    # Its turns and its rests, by the unit's clock, whatever the machine's is.
    turning_s = sum(abs(angle) for _, angle in SCHEME) / RATE_DPS + STAND_S * len(SCHEME)
    assert turning_s - 0.5 < found["duration_s"] < turning_s + 5
    for kind in ("gyros", "accelerometers"):
        for key, value in found[kind].items():
            if not key.startswith("residual"):
                error = np.subtract(value["value"], getattr(getattr(scenario, kind), key))
                assert (np.abs(error) < 6 * np.array(value["sigma"])).all(), (kind, key)
