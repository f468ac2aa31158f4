"""Tables of pandas, polars, numpy and dictionaries as columns of numbers, and columns of numbers as such tables.

No library is imported that the caller has not imported before, except to answer one who came with arrays.
"""

import importlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from numbers import Real
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Frame: TypeAlias = Any
"""A data frame of pandas or of polars."""



class HasColumns(Protocol):
    """What the data frames of pandas and polars have in common."""

    @property
    def columns(self) -> Any:
        """The names of the columns."""


Data: TypeAlias = Mapping[str, Any] | NDArray[Any] | HasColumns
"""A table: a data frame, a dictionary of arrays of shape (n,), a structured array, or an array of shape (n, k)."""

LIBRARIES = ("pandas", "polars")
"""What makes data frames, in the order in which they are looked for."""


@dataclass
class Table:
    """Columns of numbers under their names."""

    called: str
    """The name of the argument, for messages."""
    columns: dict[str, Any] = field(default_factory=dict)
    """Arrays of shape (n,); NaN is missing."""
    texts: dict[str, str] = field(default_factory=dict)
    """Columns without a single number, and what is wrong with the first cell."""
    times: set[str] = field(default_factory=set)
    """Columns that were dates or durations, and are seconds now."""
    library: str | None = None
    """What made the frame; None for arrays."""
    index: Any = None
    """The index of a frame of pandas."""

    def check(self, name: str, wanted_by: str) -> None:
        """Raises ValueError unless `name` is a column of numbers."""
        if name in self.texts:
            raise ValueError(self.texts[name])
        if name not in self.columns:
            known = ", ".join(self.columns)
            raise ValueError(f"{wanted_by}: found {quoted(name)}; expected a column of {self.called}: {known}")


def quoted(name: str) -> str:
    """A name as messages have it, those of the compiled part as well."""
    return json.dumps(name, ensure_ascii=False)


def is_table(value: object) -> bool:
    """Whether it is a frame or an array."""
    return library_of(value) is not None or isinstance(value, np.ndarray)


def library_of(value: object) -> str | None:
    """The library whose data frame it is."""
    module = type(value).__module__.partition(".")[0]
    return module if module in LIBRARIES and type(value).__name__ == "DataFrame" else None


def table_of(data: Any, called: str, names: Sequence[str] | None = None) -> Table:
    """The columns of a data frame, of a numpy array or of a dictionary of arrays.

    names: names of the columns of an array of shape (n, k).

    Raises TypeError for anything else, ValueError with column and row for what is no number.
    """
    table = Table(called, library=library_of(data))
    for name, values in _columns(data, table, names):
        if not isinstance(name, str):
            raise ValueError(f"{called}: found the column {name!r}; expected names that are strings")
        if name in table.columns or name in table.texts:
            raise ValueError(f"{called}[{quoted(name)}]: found two columns of this name; expected one")
        _put(table, name, values)
    return table


def _columns(data: Any, table: Table, names: Sequence[str] | None) -> Iterator[tuple[Any, Any]]:
    called = table.called
    if table.library == "pandas":
        table.index = data.index
        yield from _of_index(data)
        yield from ((name, data.iloc[:, k]) for k, name in enumerate(data.columns))
    elif table.library == "polars":
        yield from ((name, data[name]) for name in data.columns)
    elif isinstance(data, Mapping):
        yield from data.items()
    elif isinstance(data, np.ndarray) and data.dtype.names is not None:
        yield from ((name, data[name]) for name in data.dtype.names)
    elif isinstance(data, np.ndarray) and data.ndim == 2:
        if names is None or len(names) != data.shape[1]:
            found = "none" if names is None else f"{len(names)}"
            raise ValueError(f"columns: found {found}; expected the names of the {data.shape[1]} columns of {called}")
        yield from zip(names, data.T, strict=True)
    else:
        expected = "a data frame, a dictionary of arrays, a structured array or an array of shape (n, k)"
        raise TypeError(f"{called}: found {type(data).__name__}; expected {expected}")


def _of_index(data: Frame) -> Iterator[tuple[str, Any]]:
    """The index of a frame as a column, unless it only counts the rows."""
    index = data.index
    if type(index).__name__ == "RangeIndex" or index.nlevels > 1 or index.dtype.kind not in "iufmM":
        return
    name = index.name if index.name is not None else ("time" if index.dtype.kind in "mM" else "index")
    if name not in data.columns:
        yield str(name), index.to_series()


def _put(table: Table, name: str, values: Any) -> None:
    where = f"{table.called}[{quoted(name)}]"
    dtype = getattr(values, "dtype", None)
    if getattr(dtype, "tz", None) is not None:
        values = np.asarray(values, dtype="M8[ns]")
    elif hasattr(values, "to_numpy"):
        nullable = getattr(dtype, "na_value", None) is not None and getattr(dtype, "kind", "O") in "biuf"
        values = values.to_numpy(dtype=float, na_value=np.nan) if nullable else values.to_numpy()
    if isinstance(values, list | tuple) and not any(isinstance(value, list | tuple) for value in values[:1]):
        values = np.asanyarray(values, dtype=None if _plain(values) else object)
    kind = values.dtype.kind if isinstance(values, np.ndarray) else None
    if kind in ("M", "m"):
        table.columns[name] = _seconds(values)
        table.times.add(name)
    elif kind in ("O", "U", "S", "T") and values.ndim == 1:
        numbers, wrong = _numbers(values, where)
        if wrong is None:
            table.columns[name] = numbers
        elif np.isfinite(numbers).any():
            raise ValueError(wrong)
        else:
            table.texts[name] = wrong
    else:
        # What is wrong with other arrays is said where they are read.
        table.columns[name] = values


def _plain(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float | np.number) for value in values)


def _seconds(stamps: NDArray[Any]) -> NDArray[np.float64]:
    """Dates as seconds since 1970, durations as seconds."""
    counts = stamps.astype(f"{stamps.dtype.kind}8[ns]").astype(np.int64)
    return np.where(np.isnat(stamps), np.nan, counts / 1e9)


def _numbers(cells: NDArray[Any], where: str) -> tuple[NDArray[np.float64], str | None]:
    """The numbers among cells of any type, and what is wrong with the first that is none."""
    numbers = np.full(len(cells), np.nan)
    wrong = None
    for row, cell in enumerate(cells):
        if isinstance(cell, Real | Decimal):
            numbers[row] = float(cell)
        elif not _is_missing(cell) and wrong is None:
            wrong = f"{where}[{row}]: found {_short(cell)}; expected a number"
    return numbers, wrong


def _is_missing(cell: Any) -> bool:
    return cell is None or type(cell).__name__ in ("NAType", "NaTType")


def _short(cell: Any) -> str:
    text = repr(cell)
    return text if len(text) <= 40 else text[:39] + "…"


def check_times(table: Table, name: str, remedy: str) -> None:
    """Raises ValueError with the first row whose time is missing or before that of the row before."""
    times = np.asarray(table.columns[name])
    if times.ndim != 1 or times.dtype.kind not in "iuf":
        return
    where = f"{table.called}[{quoted(name)}]"
    missing = np.flatnonzero(~np.isfinite(times))
    if missing.size:
        raise ValueError(f"{where}[{missing[0]}]: found no time; expected one in every row")
    back = np.flatnonzero(times[1:] < times[:-1])
    if back.size:
        row = int(back[0]) + 1
        found = f"found {times[row]} after {times[row - 1]}"
        raise ValueError(f"{where}[{row}]: {found}; expected times that increase from row to row{remedy}")


def framed(columns: Mapping[str, Any], library: str | None, index: Any = None) -> Frame:
    """Columns as a frame of a library; without one of the first that is installed.

    Raises ImportError where there is none.
    """
    for name in LIBRARIES if library is None else (library,):
        try:
            module = importlib.import_module(name)
        except ImportError:
            continue
        if name == "polars":
            return module.DataFrame({key: _polars(value) for key, value in columns.items()}, strict=False)
        length = len(next(iter(columns.values()), ()))
        fits = index is not None and len(index) == length
        return module.DataFrame(dict(columns), index=index if fits else None)
    raise ImportError("a data frame needs pandas or polars: pip install pandas")


def _polars(values: Any) -> Any:
    """NaN of a list is a number that is not there."""
    if not isinstance(values, list):
        return values
    return [None if isinstance(value, float) and math.isnan(value) else value for value in values]
