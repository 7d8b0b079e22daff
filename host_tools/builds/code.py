"""Makes the objects of the steps, in a process of its own.

Code for other processors begins with intermediate code that was never optimised for this one, and
numba decides that when it is imported: ``python -m rrins.host_tools.builds.code`` with NUMBA_OPT=0
reads an order from standard input.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from rrins.compiled.object_code import ObjectCodeError, intermediate_code, optimised
from rrins.host_tools.builds.entries import entries_of
from rrins.host_tools.builds.targets import TARGETS
from rrins.host_tools.builds.variants import Variant
from rrins.host_tools.errors import BuildError

_FAILED = 3


@dataclass(frozen=True)
class Order:
    """Objects that are to be made.

    Attributes
    ----------
    unit : str
        A key of `entries_of`, such as ``firmware``.
    variant : Variant
    objects : dict
        Where the object of each target goes, by the target's name.
    """

    unit: str
    variant: Variant
    objects: dict[str, str]


def make_objects(order: Order) -> None:
    """Make the objects of an order, in another process.

    Raises
    ------
    BuildError
        When they cannot be made.
    """
    environment = {**os.environ, "NUMBA_OPT": "0"}
    environment.pop("NUMBA_DISABLE_JIT", None)
    done = subprocess.run(
        [sys.executable, "-m", __name__],
        input=json.dumps(asdict(order)),
        capture_output=True,
        text=True,
        env=environment,
        check=False,
    )
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"it ended with status {done.returncode}"]
        raise BuildError(f"no machine code of the {order.unit}: {lines[-1]}")


def _make(order: Order) -> None:
    text = intermediate_code(entries_of(order.unit, order.variant))
    for target, path in order.objects.items():
        code = optimised(text, TARGETS[target].processor)
        strange = [name for name in code.undefined() if name.startswith(("NRT_", "Py", "numba"))]
        if strange:
            raise ObjectCodeError(f"the step calls {strange[0]}: steps allocate nothing")
        Path(path).write_bytes(code.emit_object())


def main() -> None:
    """Make what standard input orders."""
    values = json.load(sys.stdin)
    variant = Variant(**values.pop("variant"))
    try:
        _make(Order(variant=variant, **values))
    except ObjectCodeError as error:
        print(error, file=sys.stderr)
        sys.exit(_FAILED)


if __name__ == "__main__":
    main()
