"""Rehearse a redundant rotational inertial navigation system before its hardware exists.

::

    import rrins

    run = rrins.simulate("rimu_rotating", duration_s=6000, gyro_bias_dph=[0.1, 0.11, 0.12, 0.13])
    run.errors.position_n.sel(axis="east").plot()
    run.summary

What the command line does, these do as well: `load_scenario`, `simulate` and `rehearse` run a
scenario; `record`, `replay` and `open_log` handle logs of the bus; `open_diagnostics` and
`open_faults` talk to a rehearsal under way, `open_dashboard` shows one in a browser;
`analyse_scheme`, `compare_schemes`, `search_schemes` and `observe_scheme` look at rotation schemes,
`load_motion` and `check_motion` at motion, `reproduce` at the paper; `write_increments` and
`import_recording` exchange increments with other navigators and vehicles; `Campaign` runs a
scenario thousands of times, `analyse_covariance` needs no run; `study_redundancy` says which faults
are found, `calibrate` finds the constants of a unit, `conform` checks somebody's firmware, `bench`
this machine. Tests get the fixtures `rrins_bench`, `rrins_bus`, `rrins_firmware` and
`rrins_hardware` from the pytest plugin.

Units stand at the end of a name (``_deg``, ``_dph``, ``_ug``, ``_s``); frames are those of
`docs/conventions.md`. Importing this package is quick: whatever is heavy (numba, xarray, pandas,
matplotlib) comes with the first call that needs it. xarray and pandas belong to the extra `data`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rrins.benchmarks import bench as bench
    from rrins.calibration import UnitCalibration as UnitCalibration
    from rrins.calibration import calibrate as calibrate
    from rrins.campaign import Campaign as Campaign
    from rrins.conformance import Conformance as Conformance
    from rrins.conformance import conform as conform
    from rrins.covariance import CovarianceAnalysis as CovarianceAnalysis
    from rrins.covariance import analyse_covariance as analyse_covariance
    from rrins.dashboard import open_dashboard as open_dashboard
    from rrins.host_tools.errors import RehearsalError as RehearsalError
    from rrins.host_tools.errors import ScenarioError as ScenarioError
    from rrins.host_tools.scenario.scenario import Scenario as Scenario
    from rrins.live import open_diagnostics as open_diagnostics
    from rrins.live import open_faults as open_faults
    from rrins.live import record as record
    from rrins.log import BusLog as BusLog
    from rrins.log import open_log as open_log
    from rrins.log import replay as replay
    from rrins.motion import check_motion as check_motion
    from rrins.motion import load_motion as load_motion
    from rrins.paper import reproduce as reproduce
    from rrins.redundancy import RedundancyStudy as RedundancyStudy
    from rrins.redundancy import study_redundancy as study_redundancy
    from rrins.run import Run as Run
    from rrins.run import rehearse as rehearse
    from rrins.run import simulate as simulate
    from rrins.scenarios import load_scenario as load_scenario
    from rrins.scenarios import scenario_names as scenario_names
    from rrins.schemes import SchemeAnalysis as SchemeAnalysis
    from rrins.schemes import SchemeObservability as SchemeObservability
    from rrins.schemes import analyse_scheme as analyse_scheme
    from rrins.schemes import compare_schemes as compare_schemes
    from rrins.schemes import observe_scheme as observe_scheme
    from rrins.schemes import search_schemes as search_schemes
    from rrins.vehicle import import_recording as import_recording
    from rrins.vehicle import write_increments as write_increments

    __version__: str

_HOMES: Final = {
    "RehearsalError": "rrins.host_tools.errors",
    "ScenarioError": "rrins.host_tools.errors",
    "Scenario": "rrins.host_tools.scenario.scenario",
    "load_scenario": "rrins.scenarios",
    "scenario_names": "rrins.scenarios",
    "Run": "rrins.run",
    "simulate": "rrins.run",
    "rehearse": "rrins.run",
    "BusLog": "rrins.log",
    "open_log": "rrins.log",
    "replay": "rrins.log",
    "record": "rrins.live",
    "open_diagnostics": "rrins.live",
    "open_faults": "rrins.live",
    "SchemeAnalysis": "rrins.schemes",
    "analyse_scheme": "rrins.schemes",
    "search_schemes": "rrins.schemes",
    "load_motion": "rrins.motion",
    "write_increments": "rrins.vehicle",
    "import_recording": "rrins.vehicle",
    "reproduce": "rrins.paper",
    "Campaign": "rrins.campaign",
    "CovarianceAnalysis": "rrins.covariance",
    "analyse_covariance": "rrins.covariance",
    "RedundancyStudy": "rrins.redundancy",
    "study_redundancy": "rrins.redundancy",
    "UnitCalibration": "rrins.calibration",
    "calibrate": "rrins.calibration",
    "Conformance": "rrins.conformance",
    "conform": "rrins.conformance",
    "bench": "rrins.benchmarks",
    "open_dashboard": "rrins.dashboard",
    "compare_schemes": "rrins.schemes",
    "observe_scheme": "rrins.schemes",
    "SchemeObservability": "rrins.schemes",
    "check_motion": "rrins.motion",
}

__all__ = [
    "BusLog",
    "Campaign",
    "Conformance",
    "CovarianceAnalysis",
    "RedundancyStudy",
    "RehearsalError",
    "Run",
    "Scenario",
    "ScenarioError",
    "SchemeAnalysis",
    "SchemeObservability",
    "UnitCalibration",
    "__version__",
    "analyse_covariance",
    "analyse_scheme",
    "bench",
    "calibrate",
    "check_motion",
    "compare_schemes",
    "conform",
    "import_recording",
    "load_motion",
    "load_scenario",
    "observe_scheme",
    "open_dashboard",
    "open_diagnostics",
    "open_faults",
    "open_log",
    "record",
    "rehearse",
    "replay",
    "reproduce",
    "scenario_names",
    "search_schemes",
    "simulate",
    "study_redundancy",
    "write_increments",
]


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("rrins")
    if name not in _HOMES:
        raise AttributeError(f"module 'rrins' has no attribute {name!r}")
    value: object = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
