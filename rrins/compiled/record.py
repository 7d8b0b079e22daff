"""Records: memory of fixed size, declared once as a class.

A class derived from `Record` declares each field's type for checkers and editors, its storage in
numpy and its documentation:

    class Clock(Record):
        \"\"\"The loop's own clock, disciplined by SYNC.\"\"\"

        synchronised: Bool
        period_q16: I8  #: period in own clock, ns * 2**16
        velocity_n: Annotated[Floats, 3]  #: m/s
        axis: Annotated[Records[Axis], 2]

``Clock.dtype`` is the numpy dtype. The class itself has no instances: at run time a record is a
`numpy.record` of that dtype, alone or in an array (`Records`), and compiled code reads its fields
at fixed offsets. So ``state.clock.synchronised`` costs nothing and is still type-checked.
"""

from __future__ import annotations

import functools
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from mmap import mmap
from types import CodeType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    NamedTuple,
    Self,
    TypeVar,
    cast,
    get_args,
    get_origin,
    overload,
)

import numpy as np
from numpy.typing import NDArray

Bool = Annotated[bool, "?"]
U1 = Annotated[int, "u1"]
U2 = Annotated[int, "<u2"]
U4 = Annotated[int, "<u4"]
U8 = Annotated[np.uint64, "<u8"]
I2 = Annotated[int, "<i2"]
I8 = Annotated[int, "<i8"]
F8 = Annotated[float, "<f8"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Shorts = NDArray[np.int16]
Words = NDArray[np.uint64]

_ARRAYS: dict[object, str] = {
    Floats: "<f8",
    Integers: "<i8",
    Bytes: "u1",
    Shorts: "<i2",
    Words: "<u8",
}
"""The numpy type in which each of these array types is stored."""

Whole = int | np.integer[Any]
"""An integer, of Python or of numpy."""

R = TypeVar("R", bound="Record")


class Record:
    """Base of all records; a subclass has annotated fields only.

    Attributes
    ----------
    dtype : numpy dtype
        Packed, in the order of the annotations, of type `numpy.record`.

    Raises
    ------
    TypeError
        When a class is defined with a field that does not have a fixed size.
    """

    dtype: ClassVar[np.dtype[np.void]]

    def __init_subclass__(cls) -> None:
        cls.dtype = _packed(member.field() for member in cls.members())

    @classmethod
    def members(cls) -> tuple[Member, ...]:
        """Return what the class declares, in the order of memory."""
        module = vars(sys.modules[cls.__module__])
        return tuple(
            _member(cls, name, eval(_code_of(hint), module) if isinstance(hint, str) else hint)
            for name, hint in cls.__annotations__.items()
        )

    @classmethod
    def texts(cls) -> dict[str, str]:
        """Return what the source says of the fields: the comments behind or above them."""
        found: dict[str, str] = {}
        above = ""
        for line in inspect.getsource(cls).splitlines():
            if line.startswith("    #: "):
                above = f"{above} {line[7:]}".strip()
                continue
            field = _DECLARED.match(line)
            if field is not None:
                found[field["name"]] = field["text"] or above
            above = ""
        return found

    @classmethod
    def sized(cls, short: Callable[[type[Record], Member], bool]) -> np.dtype[np.void]:
        """Return the dtype of a variant in which some arrays have room for one element only.

        Parameters
        ----------
        short : callable
            Says of a member of a class, at whatever depth, whether it is such an array.
        """
        fields: list[_Field] = []
        for member in cls.members():
            name, kind, shape = member.field()
            if isinstance(member.kind, type) and member.kind.__annotations__:
                kind = member.kind.sized(short)
            if shape and short(cls, member):
                shape = (1,) * len(shape)
            fields.append((name, kind, shape))
        return _packed(fields)

    @classmethod
    def zeros(cls, count: int = 1) -> Records[Self]:
        """Return an array of blank records."""
        return cast("Records[Self]", np.zeros(count, dtype=cls.dtype))

    @classmethod
    def array(cls, rows: Sequence[tuple[object, ...]]) -> Records[Self]:
        """Return an array of records with the given values, one tuple per record."""
        return cast("Records[Self]", np.array(rows, dtype=cls.dtype))

    @classmethod
    def from_bytes(cls, image: bytes | bytearray | mmap) -> Records[Self]:
        """Return the records with the given bytes; they share the memory of what can be written.

        Raises
        ------
        ValueError
            When the bytes are not a whole number of records.
        """
        return cast("Records[Self]", np.frombuffer(image, dtype=cls.dtype))

    @classmethod
    def joined(cls, pieces: Sequence[Records[Self]]) -> Records[Self]:
        """Return the concatenated records of several arrays."""
        return cast("Records[Self]", np.concatenate(pieces))

    @classmethod
    def contiguous(cls, records: Records[Self]) -> Records[Self]:
        """Return the same records without gaps in memory, copied only if necessary."""
        return cast("Records[Self]", np.ascontiguousarray(records))

    if TYPE_CHECKING:

        def __getitem__(self, field: str) -> Any: ...
        def __setitem__(self, field: str, value: object) -> None: ...
        def tobytes(self) -> bytes:
            """Return the record's bytes."""


if TYPE_CHECKING:
    _Choice = NDArray[np.bool_] | NDArray[np.integer[Any]] | list[int]

    class Records(np.ndarray[tuple[int, ...], np.dtype[np.void]], Generic[R]):
        """An array of records: an index selects a record, a name that field of all records."""

        @overload  # type: ignore[override]  # numpy takes more keys
        def __getitem__(self, key: Whole | tuple[int, int], /) -> R: ...
        @overload
        def __getitem__(self, key: str, /) -> NDArray[Any]: ...
        @overload
        def __getitem__(self, key: slice | tuple[int, slice] | _Choice, /) -> Records[R]: ...
        def __getitem__(self, key: object, /) -> object: ...
        def __iter__(self) -> Iterator[R]: ...
        def copy(self) -> Records[R]:  # type: ignore[override]  # no order
            """Return a copy."""

else:

    class Records(Generic[R]):
        """An array of records: an index selects a record, a name that field of all records."""


@functools.cache
def _code_of(annotation: str) -> CodeType:
    """Return the code of an annotation: a thousand fields share a few dozen."""
    return compile(annotation, "<annotation>", "eval")


_DECLARED = re.compile(r" {4}(?P<name>\w+): [^#]*(?:#: (?P<text>.*))?")
_Field = tuple[str, str | np.dtype[Any], tuple[int, ...]]


class Member(NamedTuple):
    """A field of a record, as its class declares it."""

    name: str
    kind: str | type[Record]  #: numpy's code of a number, or the class of records
    shape: tuple[int, ...]  #: of an array; empty: a single one

    def field(self) -> _Field:
        """Return it for numpy's dtype."""
        return self.name, self.kind if isinstance(self.kind, str) else self.kind.dtype, self.shape


def _packed(fields: Iterable[_Field]) -> np.dtype[np.void]:
    return np.dtype((np.record, list(fields)), align=False)


def _member(cls: type[Record], name: str, hint: object) -> Member:
    shape: tuple[int, ...] = ()
    if get_origin(hint) is Annotated:
        hint, extra = get_args(hint)
        if isinstance(extra, str):
            return Member(name, extra, ())
        shape = extra if isinstance(extra, tuple) else (extra,)
    if get_origin(hint) is Records:
        (hint,) = get_args(hint)
    if hint in _ARRAYS:
        return Member(name, _ARRAYS[hint], shape)
    if isinstance(hint, type) and issubclass(hint, Record):
        return Member(name, hint, shape)
    raise TypeError(f"{cls.__name__}.{name}: {hint!r} does not have a fixed size")
