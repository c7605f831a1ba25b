"""`palpate strategies`: what there is to choose from."""

import json
from pathlib import Path

from ..errors import StrategyError
from ..reports.contour_figure import require_picture
from ..reports.strategy_gallery import draw_gallery, strategy_rows
from ..runtime.warp_start import start_warp
from ..stages.registry import ROLES, known_stages
from ..strategies.intersection_strategy import load_strategy
from ..terminal import bars, console
from ..terminal.foreign_text import write_output


def run_strategies(name: str | None, out: Path | None, overwrite: bool, *, as_json: bool) -> None:
    """Show one strategy as JSON, or list strategies and stages, and draw them if a picture is asked for."""
    if name is not None:
        if out is not None:
            raise StrategyError(f"a picture shows all strategies, not {name} alone: leave out one of the two")
        write_output(json.dumps(load_strategy(name).described(), indent=None if as_json else 1) + "\n")
        return
    stages = {role: {name: entry.line for name, entry in known_stages(role).items()} for role in ROLES}
    lists: dict = {"strategies": dict(strategy_rows()), "stages": stages}
    if out is not None:
        require_picture(out, overwrite=overwrite)
        start_warp()
        with bars.loading_bar(f"drawing {out}", quiet=as_json):
            draw_gallery(out, overwrite=overwrite)
        lists["picture"] = str(out)
    if as_json:
        console.show_values(lists, as_json=True, title="strategies")
        return
    console.show_values(lists["strategies"], as_json=False, title="strategies")
    for role in ROLES:
        console.show_values(stages[role], as_json=False, title=f"{role} stages")
    if out is not None:
        console.show_values({"picture": str(out)}, as_json=False, title="picture")
