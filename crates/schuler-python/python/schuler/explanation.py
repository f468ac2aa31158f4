"""`explain` and `compare`, and what an explanation can do."""

import html
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

from numpy.typing import ArrayLike

from schuler import _schuler
from schuler._cases import Entry, Nominal, Sensors, Stated
from schuler._tables import Data, Frame, Table, check_times, framed, is_table, table_of
from schuler.answers import Parameter

_Path: TypeAlias = str | PathLike[str]
_Progress: TypeAlias = Callable[[str, float], object]

_VERDICTS = {
    "explained": "The findings explain the mismatch.",
    "partly_explained": "The findings explain a part of the mismatch.",
    "no_mismatch": "Recording and simulation agree.",
    "unexplained": "Recording and simulation differ, and nothing in the catalogue fits.",
}


class Plot:
    """Figures as SVG; a notebook shows them."""

    def __init__(self, figures: Mapping[str, str], png: Callable[[str], bytes]) -> None:
        self.figures = dict(figures)
        """SVG by name."""
        self._png = png

    def _repr_html_(self) -> str:
        return "".join(f"<div>{svg}</div>" for svg in self.figures.values())

    def __repr__(self) -> str:
        return f"<Plot of {', '.join(self.figures) or 'nothing'}>"

    def save(self, path: _Path) -> list[Path]:
        """Writes the figures, as the ending of the path says: .svg or .png. Of several, each has its name behind that of the path."""
        path = Path(path)
        if path.suffix not in (".svg", ".png"):
            raise ValueError(f"path: found the ending {path.suffix!r}; expected .svg or .png")
        written = []
        for name, svg in self.figures.items():
            to = path if len(self.figures) == 1 else path.with_name(f"{path.stem}_{name}{path.suffix}")
            to.write_bytes(svg.encode() if path.suffix == ".svg" else self._png(name))
            written.append(to)
        return written


class Explanation(dict[str, Any]):
    """Why a recording does not look like its simulation.

    As a dictionary it is the document of `schuler explain --json` (types in `schuler.answers`). A copy from another process has the
    document, the text and the data frames; it cannot draw, export or simulate.
    """

    case: dict[str, Any] | str
    """The case: a dictionary of what stands in its file, or the file."""
    said: list[str]
    """What was found and guessed where no case was given, a sentence each."""

    def __init__(self, document: Mapping[str, Any], text: str, case: dict[str, Any] | str, said: Sequence[str]) -> None:
        super().__init__(document)
        self.case = case
        self.said = list(said)
        self._text = text
        self._library: str | None = None
        self._index: Any = None
        self._explained: _schuler.Explained | None = None

    @property
    def findings(self) -> Frame:
        """A data frame with a row a finding: sensor, effect, probability, the value of its first number with sigma and unit, and so on."""
        rows = [_row(finding) for finding in self["findings"]]
        return self._framed({name: [row[name] for row in rows] for name in _row(_NOTHING)})

    @property
    def parameters(self) -> Frame:
        """A data frame with a row a number that was fitted; `finding` counts the findings from 0."""
        rows = [
            {"finding": k, "sensor": finding["sensor"], "effect": finding["effect"], **_number(parameter)}
            for k, finding in enumerate(self["findings"])
            for parameter in finding["parameters"]
        ]
        names = ("finding", "sensor", "effect", *_number(None))
        return self._framed({name: [row[name] for row in rows] for name in names})

    def plot(self, which: str = "explained") -> Plot:
        """Figures: `explained` (residual before and after, a figure a sensor), `whiteness`, `effects` (against their causes), `all`."""
        chosen: dict[str, Callable[[str], bool]] = {
            "explained": lambda name: name.endswith("_explained"),
            "whiteness": lambda name: name.endswith("_whiteness"),
            "effects": lambda name: not name.endswith(("_explained", "_whiteness")),
            "all": lambda name: True,
        }
        if which not in chosen:
            raise ValueError(f"which: found {which!r}; expected one of {', '.join(chosen)}")
        explained = self._here()
        figures = {name: svg for name, svg in explained.figures() if chosen[which](name)}
        return Plot(figures, explained.png)

    def export(self, path: _Path) -> list[Path]:
        """Writes what was found as a model for a simulation, in the form that the ending says: .json, .py, .c or .rs; with the model's
        inputs as a table beside it. Gives the files."""
        return self._here().export(path)

    @property
    def cautions(self) -> list[str]:
        """What the user of an exported model should know: what is noise, what has no formula."""
        return self._here().cautions()

    def simulate(self) -> Frame:
        """The simulation with what was found put back: a data frame of the time and, by column, of each sensor that is simulated.

        Rows and units are those of the recording. A constant that is unknown (`relative`) is not in it.
        """
        (name, time), columns = self._here().simulated()
        return self._framed({name: time, **dict(columns)}, self._index)

    def report(self, path: _Path) -> Path:
        """Writes the page of `schuler explain --report`, which needs nothing beside it."""
        path = Path(path)
        path.write_text(self._here().html(), encoding="utf-8")
        return path

    def _framed(self, columns: Mapping[str, Any], index: Any = None) -> Frame:
        return framed(columns, self._library, index)

    def _here(self) -> _schuler.Explained:
        if self._explained is None:
            raise RuntimeError("this explanation is a copy from another process, which has the document alone; explain here")
        return self._explained

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return f"<Explanation: {self['verdict']}, findings: {len(self['findings'])}>"

    def _repr_html_(self) -> str:
        cells = "".join(_cells(finding) for finding in self["findings"])
        head = "".join(f"<th>{name}</th>" for name in ("", "finding", "value", "probability"))
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{cells}</tbody></table>" if cells else ""
        notes = "".join(f"<p><small>{html.escape(note)}</small></p>" for note in self.get("notes", []))
        return f"<div><p><b>{_VERDICTS[self['verdict']]}</b> {_gain(self['fit'])}</p>{table}{notes}</div>"

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (dict(self), self._text, self.case, self.said, self._library)


def _restored(
    document: Mapping[str, Any], text: str, case: dict[str, Any] | str, said: list[str], library: str | None
) -> Explanation:
    answer = Explanation(document, text, case, said)
    answer._library = library
    return answer


_NOTHING: dict[str, Any] = {
    "sensor": "", "effect": "", "probability": None, "class": [], "interval_s": [None, None], "parameters": [],
    "evidence": {"gain_nats": None, "p_value": None}, "sentence": "",
}  # fmt: skip


def _number(parameter: Parameter | None) -> dict[str, Any]:
    if parameter is None:
        return {"parameter": None, "value": None, "sigma": None, "unit": None, "text": None}
    value = parameter["value"]
    text = value if isinstance(value, str) else None
    number = None if isinstance(value, str) else value
    return {"parameter": parameter["name"], "value": number, "sigma": parameter["sigma"], "unit": parameter["unit"], "text": text}


def _row(finding: Mapping[str, Any]) -> dict[str, Any]:
    numbers = [parameter for parameter in finding["parameters"] if not isinstance(parameter["value"], str)]
    first = _number(numbers[0] if numbers else None)
    del first["text"]
    members = [f"{member['effect']} of {member['sensor']} ({member['probability']:.2f})" for member in finding["class"]]
    return {
        "sensor": finding["sensor"], "effect": finding["effect"], "probability": finding["probability"], **first,
        "start_s": finding["interval_s"][0], "end_s": finding["interval_s"][1], **finding["evidence"],
        "class": ", ".join(members), "sentence": finding["sentence"],
    }  # fmt: skip


def _cells(finding: Mapping[str, Any]) -> str:
    row = _row(finding)
    value = "" if row["value"] is None else f"{row['value']:.4g}"
    if value and row["sigma"] is not None:
        value += f" ± {row['sigma']:.2g}"
    cells = [row["sensor"], row["sentence"], f"{value} {row['unit'] or ''}" if value else "", f"{row['probability']:.3f}"]
    return "<tr>" + "".join(f"<td style='text-align:left'>{html.escape(cell)}</td>" for cell in cells) + "</tr>"


def _gain(fit: Mapping[str, Any]) -> str:
    """What the findings do for data that was held out, or else for that which was fitted."""
    for name, where in (("held_out", "On data held out"), ("train", "On the data fitted")):
        before, after = (fit[name][when]["rmse"] for when in ("before", "after"))
        if before is not None and after is not None:
            return f"{where} the error is {before:.4g} before and {after:.4g} after, rms of what was not predicted."
    return ""


def explain(
    data: Data | _Path,
    recording: Data | _Path | None = None,
    *,
    sensors: Sensors | None = None,
    nominal: Nominal | None = None,
    aux: Sensors | None = None,
    motion: Entry | str | None = None,
    site: Entry | None = None,
    time: str | None = None,
    step_s: float | None = None,
    duplicates: str | None = None,
    columns: Sequence[str] | None = None,
    more: Entry | None = None,
    probability: float = 0.95,
    hold_out: bool = True,
    progress: _Progress | None = None,
) -> Explanation:
    """Explain why a recording does not look like its simulation.

    data: the recording, as a data frame of pandas or polars, a dictionary of arrays of shape (n,) by column, a structured array, or an
    array of shape (n, k) with `columns`, the names of its columns. NaN is missing; dates are seconds. What is not stated is guessed, and said
    in `.said`:

    - sensors: columns, or by name what a case says of each: `{"gyro_x": {"kind": "fog", "unit": "deg/h", "axis": [1, 0, 0]}}`;
    - nominal: by sensor what the simulation believes of its noise and constants, `{"gyro_x": {"white": 0.02}}`; or what it says that the
      sensor reads: a column, or an array of shape (n,);
    - aux: recorded quantities on which effects may depend, as `sensors`; without it all other columns;
    - motion, site: those tables of a case; of the motion its kind alone will do;
    - time: column of the time; step_s: without one, the step of the rows in seconds;
    - duplicates: "drop" or "average" rows that come twice or late;
    - more: other tables of a case, `{"effect": [...]}`.

    Instead of data: the path of a case file, or a dictionary of what would stand there, and as `recording` the path of a table instead of
    the case's, or any of the above, in the units that the case says.

    probability: posterior probability from which on a finding is told, 0 to 1. hold_out: whether the description is judged on
    blocks held out. progress: called with the phase and the part of it that is done, 0 to 1; what it raises ends the work.

    Raises ValueError with column and row, or field, and what was expected; KeyboardInterrupt within a moment of Ctrl-C.
    """
    stated = Stated(sensors, nominal, aux, motion, site, duplicates, more)
    table = None
    said: list[str] = []
    case: Any = data
    if _is_data(data):
        if recording is not None:
            raise TypeError("recording: found beside data; expected it with a case alone")
        table = table_of(data, "data", columns)
        stated.check(table)
        draft, said = _schuler.propose(table.columns, (time, step_s))
        case = _checked(draft, table, stated, ', or duplicates="drop"')
        said += _left_out(table)
    else:
        options = {"time": time, "step_s": step_s, "columns": columns, **vars(stated)}
        if found := [name for name, value in options.items() if value is not None]:
            raise TypeError(f"{found[0]}: found with a case; expected data, or this in the case")
        if is_table(recording) or isinstance(recording, Mapping):
            table = table_of(recording, "recording")
    beside: Any = recording if table is None else table.columns
    explained = _schuler.explain(case, beside, probability=probability, hold_out=hold_out, progress=progress)
    return _answer(explained, case, said, table)


def compare(
    sim: Data,
    real: Data,
    *,
    map: Mapping[str, str] | None = None,
    sensors: Sensors | None = None,
    nominal: Mapping[str, Entry] | None = None,
    motion: Entry | str | None = None,
    site: Entry | None = None,
    sim_time: str | None = None,
    real_time: str | None = None,
    sim_step_s: float | None = None,
    real_step_s: float | None = None,
    columns: Sequence[str] | None = None,
    more: Entry | None = None,
    probability: float = 0.95,
    hold_out: bool = True,
    progress: _Progress | None = None,
) -> Explanation:
    """Compare a simulator's output with a recording and explain the difference.

    sim, real: tables as `explain` takes them, each with its own rows and times. Columns belong together whose names do, units and what says which table it
    is apart; map: pairs of other names, `{simulated: recorded}`. Units, steps and clocks are guessed and said in `.said`; `sensors` (by
    recorded column), `nominal`, `motion`, `site` and `more` state them as for `explain`. sim_time, real_time: columns of the time; sim_step_s, real_step_s: without one,
    the step in seconds. columns: names of the columns of arrays of shape (n, k).

    Raises as `explain` does.
    """
    simulated, recorded = table_of(sim, "sim", columns), table_of(real, "real", columns)
    stated = Stated(sensors, nominal, None, motion, site, None, more)
    stated.check(recorded)
    pairs = list((map or {}).items())
    for simulated_name, recorded_name in pairs:
        simulated.check(simulated_name, "map")
        recorded.check(recorded_name, "map")
    draft, said = _schuler.propose_pair(
        simulated.columns, recorded.columns, pairs, (sim_time, sim_step_s), (real_time, real_step_s)
    )
    _check_times(draft["simulation"], simulated, "")
    case = _checked(draft, recorded, stated, "")
    explained = _schuler.explain(
        case, recorded.columns, simulated.columns, probability=probability, hold_out=hold_out, progress=progress
    )
    return _answer(explained, case, said + _left_out(simulated) + _left_out(recorded), recorded)


def _is_data(data: Any) -> bool:
    """Whether it is a table, and no case."""
    if isinstance(data, Mapping):
        return "format" not in data and not isinstance(data.get("recording"), Mapping)
    return is_table(data)


def _checked(draft: dict[str, Any], table: Table, stated: Stated, remedy: str) -> dict[str, Any]:
    case = stated.into(draft, table)
    if stated.duplicates is None:
        _check_times(case["recording"], table, remedy)
    return case


def _check_times(source: dict[str, Any], table: Table, remedy: str) -> None:
    name = source.get("time")
    if name is None:
        return
    check_times(table, name, remedy)
    if name in table.times:
        source["time_unit"] = "s"


def _left_out(table: Table) -> list[str]:
    if not table.texts:
        return []
    return [f"left out of {table.called}: {', '.join(table.texts)} (no numbers)"]


def _answer(explained: _schuler.Explained, case: Any, said: list[str], table: Table | None) -> Explanation:
    kept = dict(case) if isinstance(case, Mapping) else str(case)
    answer = Explanation(explained.document(), explained.text(), kept, said)
    answer._explained = explained
    if table is not None:
        answer._library, answer._index = table.library, table.index
    return answer
