"""Keys of scenarios and faults for annotations; type checkers read the file `.pyi` of this name."""

from typing import Any, TypedDict

from rrins.host_tools.scenario.fault_tables import KINDS
from rrins.host_tools.scenario.keywords import keywords, paths

_FAULT = {key: Any for table in KINDS.values() for key in table.model_fields}

ScenarioKeys = TypedDict("ScenarioKeys", dict.fromkeys([*keywords(), *paths()], Any), total=False)
ScenarioKeys.__doc__ = "Keys of a scenario as keywords of a call."
FaultTable = TypedDict("FaultTable", _FAULT, total=False)
FaultTable.__doc__ = "A fault of a scenario: its kind, when, and the keys of that kind."
