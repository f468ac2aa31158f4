"""What a caller states of a table, put into the case that was guessed for it."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from schuler._tables import Table, quoted

Entry: TypeAlias = Mapping[str, Any]
"""Keys of one `[[sensor]]` or `[[aux]]` of a case."""
Sensors: TypeAlias = Sequence[str] | Mapping[str, Entry]
"""Columns, or what stands in the case for each."""
Nominal: TypeAlias = Mapping[str, Entry | str | ArrayLike]
"""Of a sensor its `[sensor.nominal]`, or the column or the values that the simulation says it reads."""


@dataclass
class Stated:
    """What a caller says of a table; None is left to the guess."""

    sensors: Sensors | None = None
    nominal: Nominal | None = None
    aux: Sensors | None = None
    motion: Entry | str | None = None
    site: Entry | None = None
    duplicates: str | None = None
    more: Entry | None = None

    def check(self, table: Table) -> None:
        """Raises ValueError for names that are no columns of numbers, and for values of another length."""
        for argument, stated in (("sensors", self.sensors), ("aux", self.aux)):
            for name, entry in _entries(stated or [], argument):
                table.check(entry.get("column", name), argument)
        rows = len(next(iter(table.columns.values()), ()))
        for name, nominal in (self.nominal or {}).items():
            if isinstance(nominal, str):
                table.check(nominal, f"nominal[{quoted(name)}]")
            elif not isinstance(nominal, Mapping) and (found := np.shape(nominal)) != (rows,):
                raise ValueError(f"nominal[{quoted(name)}]: found an array of shape {found}; expected ({rows},)")

    def into(self, draft: dict[str, Any], table: Table) -> dict[str, Any]:
        """The drafted case with what was stated.

        Raises ValueError for a nominal of what is no sensor.
        """
        case = deepcopy(draft)
        drafted = {entry["column"]: entry for entry in case.get("sensor", [])}
        causes = {entry["column"]: entry for entry in case.get("aux", [])}
        if self.sensors is not None:
            case["sensor"] = [_sensor(*item, drafted, causes) for item in _entries(self.sensors, "sensors")]
        self._put_nominal(case, table)
        used = {entry["column"] for entry in case["sensor"]} | {entry.get("predicted") for entry in case["sensor"]}
        if self.aux is not None:
            case["aux"] = [_cause(*item, drafted, causes) for item in _entries(self.aux, "aux")]
        else:
            left = [_cause(name, {}, drafted, causes) for name in drafted if name not in used]
            case["aux"] = [entry for entry in causes.values() if entry["column"] not in used] + left
        if self.motion is not None:
            case["motion"] = {"kind": self.motion} if isinstance(self.motion, str) else dict(self.motion)
        if self.site is not None:
            case["site"] = dict(self.site)
        case["recording"].pop("duplicates", None)
        if self.duplicates is not None:
            case["recording"]["duplicates"] = self.duplicates
        case.update(self.more or {})
        return case

    def _put_nominal(self, case: dict[str, Any], table: Table) -> None:
        sensors = {entry["id"]: entry for entry in case["sensor"]}
        for name, nominal in (self.nominal or {}).items():
            if name not in sensors:
                raise ValueError(f"nominal: found {quoted(name)}; expected one of the sensors: {', '.join(sensors)}")
            if isinstance(nominal, Mapping):
                sensors[name]["nominal"] = dict(nominal)
                continue
            if isinstance(nominal, str):
                column = nominal
            else:
                column = f"nominal {name}"
                table.columns[column] = np.asarray(nominal)
            sensors[name]["predicted"] = column


def _entries(stated: Sensors, argument: str) -> list[tuple[str, Entry]]:
    if isinstance(stated, str):
        raise TypeError(f"{argument}: found a string; expected a list of columns or a dictionary")
    if isinstance(stated, Mapping):
        for name, entry in stated.items():
            if not isinstance(entry, Mapping):
                found = f"{argument}[{quoted(name)}]: found {type(entry).__name__}"
                raise TypeError(f"{found}; expected a dictionary of what the case says of it")
        return list(stated.items())
    return [(name, {}) for name in stated]


def _sensor(name: str, stated: Entry, drafted: dict[str, Any], causes: dict[str, Any]) -> dict[str, Any]:
    column = stated.get("column", name)
    guessed = drafted.get(column, {"kind": "other", "unit": causes.get(column, {}).get("unit", "")})
    if stated.get("kind") == "other":
        guessed = {key: value for key, value in guessed.items() if key != "axis"}
    return {**guessed, "column": column, **stated, "id": name}


def _cause(name: str, stated: Entry, drafted: dict[str, Any], causes: dict[str, Any]) -> dict[str, Any]:
    guessed = causes.get(name, {"quantity": "other", "unit": drafted.get(name, {}).get("unit", "")})
    return {**guessed, **stated, "column": name}
