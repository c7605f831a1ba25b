"""`palpate strategies`: what there is to choose from."""

from pathlib import Path

from ..reports.contour_figure import require_picture
from ..reports.strategy_gallery import draw_gallery, strategy_rows
from ..runtime.warp_start import start_warp
from ..stages.registry import ROLES, known_stages
from ..terminal import console


def run_strategies(out: Path | None, overwrite: bool, *, as_json: bool) -> None:
    """List strategies and stages, and draw them if a picture is asked for."""
    stages = {role: {name: entry.line for name, entry in known_stages(role).items()} for role in ROLES}
    lists: dict = {"strategies": dict(strategy_rows()), "stages": stages}
    if out is not None:
        require_picture(out, overwrite=overwrite)
        start_warp()
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
