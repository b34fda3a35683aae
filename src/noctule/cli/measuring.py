"""`noctule experiment loc-...`: measures one seed or many, tells the figures, keeps them."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from noctule.cli.options import out_folder, read_seeds
from noctule.cli.show import as_json

if TYPE_CHECKING:
    from noctule.settings import Settings

RESULTS = "figures.json"


@dataclass(frozen=True, slots=True)
class Measurement:
    """What the command line asks to measure."""

    name: str
    options: Settings
    seed: int
    seeds: str | None
    out: Path | None
    json: bool


def measure_asked(asked: Measurement) -> int:
    """Measure, tell, keep the figures in the folder; 0, as nothing here can fail but by an error."""
    folder = out_folder(asked.out, asked.name)
    if asked.seeds is None:
        with _bar(asked.name, _steps(asked)) as advance:
            figures = {
                "seed": asked.seed,
                **_measured(asked.name, asked.options, asked.seed, advance),
            }
        if asked.out is not None:
            _keep(asked.name, asked.options, asked.seed, folder)
    else:
        from noctule.campaign.measure import measure_seeds

        seeds = read_seeds(asked.seeds)
        with _bar(asked.name, len(seeds)) as advance:
            figures = measure_seeds(partial(measured_quietly, asked.name, asked.options), seeds, note=advance)
    (folder / RESULTS).write_text(as_json(figures) + "\n", encoding="utf-8")
    if asked.json:
        print(as_json(figures))
    else:
        print(figures_text(figures if asked.seeds is None else figures["summary"]))
        if asked.seeds is not None:
            print(f"the mean of {len(figures['runs'])} seeds; each of them, the least and the most:")
        print(f"figures: {folder / RESULTS}")
    return 0


def measured_quietly(name: str, options: Settings, seed: int) -> Mapping[str, Any]:
    """Return the figures of a seed: what the workers run."""
    return _measured(name, options, seed, lambda _: None)


def _measured(name: str, options: Settings, seed: int, advance: Callable[[int], None]) -> Mapping[str, Any]:
    from noctule.experiments.measured import MEASURED

    return MEASURED[name].measure(seed, options, advance)


def _keep(name: str, options: Settings, seed: int, folder: Path) -> None:
    from noctule.experiments.measured import MEASURED

    keep = MEASURED[name].keep
    if keep is not None:
        keep(seed, options, folder)


def _steps(asked: Measurement) -> int:
    from noctule.experiments.measured import MEASURED

    return MEASURED[asked.name].steps(asked.options)


@contextmanager
def _bar(label: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show a bar on standard error, where that is a terminal; the caller tells how far it is."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(label, total=total)
        yield lambda done: bar.update(task, completed=done)


def figures_text(figures: Mapping[str, Any], heading: str = "") -> str:
    """Return a line per number, and a table of the groups that have the same numbers (the methods)."""
    groups = {name: value for name, value in figures.items() if isinstance(value, Mapping)}
    numbers = {name: value for name, value in figures.items() if name not in groups}
    width = max((len(name) for name in numbers), default=0)
    lines = [f"{name:<{width}}  {_number(value)}" for name, value in numbers.items()]
    flat = {name: group for name, group in groups.items() if not _nested(group)}
    for table in _tables(flat):
        lines += ["", *([heading] if heading and table else []), *table]
    for name, group in groups.items():
        if name not in flat:
            below = f"{heading}{name}: " if name != "methods" else heading
            lines.append(figures_text(group, below))
    return "\n".join(lines)


def _nested(group: Mapping[str, Any]) -> bool:
    return any(isinstance(value, Mapping) for value in group.values())


def _tables(groups: Mapping[str, Mapping[str, Any]]) -> list[list[str]]:
    """Return the lines of a table for all groups that have a number in common."""
    together: list[dict[str, Mapping[str, Any]]] = []
    for name, group in groups.items():
        shared = [t for t in together if any(key in other for other in t.values() for key in group)]
        if shared:
            shared[0][name] = group
        else:
            together.append({name: group})
    return [_table(table) for table in together]


def _table(groups: Mapping[str, Mapping[str, Any]]) -> list[str]:
    columns = list(dict.fromkeys(key for group in groups.values() for key in group))
    first = max(len(name) for name in groups)
    lines = [" " * first + "".join(f"  {column:>16}" for column in columns)]
    for name, group in groups.items():
        cells = "".join(f"  {_number(group[key]) if key in group else '':>16}" for key in columns)
        lines.append(f"{name:<{first}}{cells}")
    return lines


def _number(value: Any) -> str:
    if value is None:  # not measured
        return "-"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
