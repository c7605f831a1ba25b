"""How `palpate bench` shows its figures to people."""

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from ..terminal.foreign_text import plain
from .curves import Curve
from .first_use import FirstUse
from .rows import Row
from .turns import PeerRow


def show_rows(rows: Sequence[Row], console: Console) -> None:
    """Ours, with the floor and the fastest peer; then the peers; then where our time goes."""
    measured = ("poses", "hit", "vertices", "polylines", "us a pose", "poses/s", "x peer", "x floor")
    table = _table("palpate", ("object", "triangles", "", *measured))
    for row in rows:
        peer = f"{row.peer_ratio:.3g} {row.peer}" if row.peer else "-"
        cells = (row.object, f"{row.triangles:,}", row.strategy.upper(), f"{row.poses:,}", f"{100 * row.hit:.1f} %")
        figures = (row.vertices_per_pose, row.polylines_per_pose, row.us, row.poses_per_second)
        _add(table, *cells, *(_short(figure) for figure in figures), peer, _short(row.floor_ratio))
    console.print(table)
    if any(row.peers for row in rows):
        console.print(_peer_table(rows))
        for line in _remarks(rows):
            console.print(plain(line))
    stages = _table("share of the time", ("object", "", "stages"))
    for row in rows:
        shares = ", ".join(f"{stage} {100 * share:.0f} %" for stage, share in row.stages.items())
        _add(stages, row.object, row.strategy.upper(), shares)
    console.print(stages)
    for row in rows:
        if row.peak_bytes is not None:
            share = row.peak_bytes / max(row.result_bytes, 1)
            memory = f"{row.peak_bytes / 1e6:.1f} MB at the peak, {share:.3g} x results"
            console.print(plain(f"{row.object} {row.strategy.upper()}: {memory}"))


def show_curve(curve: Curve, console: Console) -> None:
    """Points and slopes."""
    table = _table(
        f"{curve.name}: cost against {curve.against}",
        ("triangles", "poses", "segments a pose", "us a pose", "ns a segment", "seconds"),
    )
    for point in curve.points:
        figures = (point.segments_per_pose, point.us, point.ns_per_segment, point.seconds)
        _add(table, f"{point.triangles:,}", f"{point.poses:,}", *(_short(figure) for figure in figures))
    console.print(table)
    for name, slope, theory in (
        ("all points", curve.slope, curve.slope_theory),
        ("upper half", curve.slope_large, curve.slope_large_theory),
    ):
        if slope is not None and theory is not None:
            console.print(plain(f"slope of {name}: {slope:.3f}; theory: {theory:.3f}"))
    if curve.left_out:
        console.print(plain(f"left out, would take too long: {'; '.join(curve.left_out)}"))


def show_first_use(first: FirstUse, console: Console) -> None:
    """Three figures."""
    text = (
        f"first use: palpate render cube, 1,000 poses: cold {first.cold:.2f} s, warm {first.warm:.2f} s; "
        f"palpate --help: {first.help:.2f} s"
    )
    console.print(plain(text))


def _peer_table(rows: Sequence[Row]) -> Table:
    here = {peer.name for row in rows for peer in row.peers if peer.state != "absent"}
    names = [peer.name for peer in rows[0].peers if peer.name in here]
    table = _table("peers, us a pose (x ours)", ("object", "", *names))
    for row in rows:
        found = {peer.name: peer for peer in row.peers}
        _add(table, row.object, row.strategy.upper(), *(_cell(found[name]) for name in names))
    return table


def _cell(peer: PeerRow) -> str:
    if peer.us is None or peer.ratio is None:
        return peer.state
    return f"{_short(peer.us)} ({_short(peer.ratio)})" + ("" if peer.state == "timed" else " once")


def _remarks(rows: Sequence[Row]) -> list[str]:
    """What is to be known of peers, each thing once."""
    notes: dict[str, None] = {}
    for row in rows:
        for peer in row.peers:
            of_all = peer.state in ("absent", "declined", "timed")
            place = "" if of_all else f", {row.object} {row.strategy.upper()}"
            if peer.note:
                notes[f"{peer.name}{place}: {peer.note}"] = None
    return list(notes)


def _table(title: str, columns: Sequence[str]) -> Table:
    table = Table(title=plain(title), title_justify="left", box=None, padding=(0, 2, 0, 0))
    for place, column in enumerate(columns):
        text = column in ("object", "", "stages")
        table.add_column(plain(column), justify="left" if text or place == 0 else "right", no_wrap=column != "stages")
    return table


def _add(table: Table, *cells: str) -> None:
    table.add_row(*map(plain, cells))


def _short(value: float) -> str:
    """Three figures, without exponents."""
    if value >= 1000:
        return f"{value:,.0f}"
    return f"{value:.3g}"
