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
scenario thousands of times, `analyse_covariance` needs no run, `allocate` inverts it;
`study_redundancy` says which faults are found, `fmeda` what becomes of failures, `study_integrity`
whether errors stay within their bounds, `calibrate` finds the constants of a unit, `conform` checks
somebody's firmware, `benchmark` this machine. `bench` is a rehearsal that a program drives epoch by
epoch. Tests get the fixtures `rrins_bench`, `rrins_bus`, `rrins_firmware` and `rrins_hardware` from
the pytest plugin.

Units stand at the end of a name (``_deg``, ``_dph``, ``_ug``, ``_s``); frames are those of
`docs/conventions.md`. Importing this package is quick: whatever is heavy (numba, xarray, pandas,
matplotlib) comes with the first call that needs it. xarray and pandas belong to the extra `data`.
"""

from importlib import import_module as _import_module

# By the loader: pathlib would take longer to import than all else here.
_STUB = __spec__.loader.get_data(f"{__file__}i").decode()
_HOMES = dict(
    reversed(line.split()[1:4:2]) for line in _STUB.splitlines() if line.startswith("from ")
)
"""Module of each name, from the stub that type checkers and editors read."""

__all__ = sorted([*_HOMES, "__version__"])


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("rrins")
    if name not in _HOMES:
        raise AttributeError(f"module 'rrins' has no attribute {name!r}")
    value: object = getattr(_import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
