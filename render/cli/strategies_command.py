"""`palpate strategies`: what there is to choose from."""

import json
from pathlib import Path

from ..reports.strategy_figure import draw_strategies, strategy_rows
from ..runtime.warp_start import start_warp
from ..stages.registry import ROLES, known_stages
from ..strategies.intersection_strategy import load_strategy
from ..terminal import bars, console
from ..terminal.foreign_text import write_output
from .contour_options import StrategiesCommand


def run_strategies(job: StrategiesCommand, *, as_json: bool) -> None:
    """Show one strategy as JSON, draw some, or list strategies and stages, and draw them if a picture is asked for."""
    out = job.out
    if job.names:
        _run_named(job.names, job, as_json=as_json)
        return
    stages = {role: {name: entry.line for name, entry in known_stages(role).items()} for role in ROLES}
    lists: dict = {"strategies": dict(strategy_rows()), "stages": stages}
    if out is not None:
        start_warp()
        with bars.progress_bar(f"drawing {out}", quiet=as_json):
            draw_strategies(out, None, overwrite=job.overwrite)
        lists["picture"] = str(out)
    if as_json:
        console.show_values(lists, as_json=True, title="strategies")
        return
    console.show_values(lists["strategies"], as_json=False, title="strategies")
    for role in ROLES:
        console.show_values(stages[role], as_json=False, title=f"{role} stages")
    if out is not None:
        console.show_values({"picture": str(out)}, as_json=False, title="picture")


def _run_named(names: list[str], job: StrategiesCommand, *, as_json: bool) -> None:
    """Print one strategy as JSON, or draw several beside their raw intersections."""
    out = job.out
    loaded = {name: load_strategy(name, allow_code=job.allow_code) for name in dict.fromkeys(names)}
    if out is None:
        write_output(json.dumps(loaded[names[0]].described(), indent=None if as_json else 1) + "\n")
        return
    start_warp()
    titles = {Path(name).stem if name.endswith(".json") else name: strategy for name, strategy in loaded.items()}
    shown = titles if len(titles) == len(loaded) else loaded
    with bars.progress_bar(f"drawing {out}", quiet=as_json):
        draw_strategies(out, shown, overwrite=job.overwrite)
    strategies = {name: strategy.described() for name, strategy in shown.items()}
    values = {"picture": str(out), "strategies": strategies if as_json else ", ".join(shown)}
    console.show_values(values, as_json=as_json, title="strategies")
