"""Makes the objects of the steps for the targets."""

from __future__ import annotations

from functools import lru_cache

from rrins.compiled.object_code import ObjectCodeError, intermediate_code, optimised
from rrins.host_tools.builds.entries import entries_of
from rrins.host_tools.builds.targets import TARGETS
from rrins.host_tools.builds.variants import Variant
from rrins.host_tools.errors import BuildError

_OF_NUMBA = "NRT_", "Py", "numba"
"""Beginnings of names that only numba's runtime has."""


def object_of(unit: str, variant: Variant, target: str) -> bytes:
    """Return the object file of a unit of the rehearsal.

    Parameters
    ----------
    unit : str
        A key of `entries_of`, such as ``firmware``.
    target : str
        A key of `TARGETS`.

    Raises
    ------
    BuildError
        When there is no machine code.
    """
    try:
        code = optimised(_text(unit, variant), TARGETS[target].processor)
    except ObjectCodeError as error:
        raise BuildError(f"no machine code of the {unit}: {error}") from None
    strange = [name for name in code.undefined() if name.startswith(_OF_NUMBA)]
    if strange:
        raise BuildError(
            f"no machine code of the {unit}: the step calls {strange[0]}: steps allocate nothing"
        )
    return code.emit_object()


@lru_cache(maxsize=2)
def _text(unit: str, variant: Variant) -> str:
    return intermediate_code(entries_of(unit, variant))
