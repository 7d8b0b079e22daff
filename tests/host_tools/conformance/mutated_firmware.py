"""Our own firmware with a change to one module, called as a user's program is.

python mutated_firmware.py MODULE OLD NEW --setup FILE --interface rrins --channel PATH ...
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

module, old, new, *words = sys.argv[1:]
given = dict(zip(words[::2], words[1::2], strict=True))

spec = importlib.util.find_spec(module)
assert spec is not None
assert spec.origin is not None
source = Path(spec.origin).read_text(encoding="utf-8")
assert source.count(old) == 1, f"{source.count(old)} times in {module}: {old}"
mutated = importlib.util.module_from_spec(spec)
sys.modules[module] = mutated
parent, _, name = module.rpartition(".")
setattr(sys.modules[parent], name, mutated)
exec(compile(source.replace(old, new), spec.origin, "exec"), vars(mutated))

from rrins.host_tools.cli.main import rrins  # noqa: E402 - the module must be there before

scenario = Path(given["--setup"]).parent.with_suffix(".toml")
bus = ("--channel", given["--channel"], "--speed", given["--speed"])
rrins(["firmware", str(scenario), *bus, "--attach-wait", given["--attach-wait"]])
