"""A rehearsal that a program drives epoch by epoch: for notebooks, simulators, learning."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Unpack

from rrins.host_tools.testing.bench import Bench
from rrins.run import Source
from rrins.scenarios import load_scenario

if TYPE_CHECKING:
    from rrins.host_tools.scenario.typed_keys import ScenarioKeys


def bench(
    scenario: Source = "rimu_rotating",
    *,
    way: Literal["direct", "lockstep", "realtime"] = "direct",
    program: str | None = None,
    memory: str | Path | None = None,
    patience_s: float = 60.0,
    **changes: Unpack[ScenarioKeys],
) -> Bench:
    """Return a rehearsal at power-on, whose time passes only when it is told to.

    Use it in a ``with`` statement, or close it. ``bench.step()`` lets an epoch pass; what it sees
    and does is that of the fixture `rrins_bench`: ``bench.truth``, ``bench.navigation``,
    ``bench.messages(...)``, ``bench.inject(...)``, ``bench.power_cycle(...)``, ``bench.bus``.

    Parameters
    ----------
    scenario : str, Path, mapping or Scenario
        As in `load_scenario`.
    way : {"direct", "lockstep", "realtime"}
        Both sides in this process; the firmware as a process; both as processes in real time.
    program : str, optional
        Your own navigation computer: a program, or its command line. It always is a process.
    memory : str or Path, optional
        File of the firmware's parameter memory.
    patience_s : float
        Longest silence of a process, in wall clock time; 0 waits forever.
    **changes
        Keys of the scenario, as in `load_scenario`.

    Raises
    ------
    BenchError
        If a process cannot be started.
    ScenarioError
        If the scenario is invalid.
    """
    return Bench(
        load_scenario(scenario, **changes),
        way=way,
        patience_s=patience_s,
        program=program,
        memory=None if memory is None else Path(memory),
    )
