"""What the page says in words about the shown files and poses: HTML in which all foreign text is escaped."""

from collections.abc import Sequence
from html import escape
from math import degrees

from ...reports.rendering_labels import hand_text, strategy_name_of
from ...sampling.draw_frequency import pose_frequencies
from ...terminal.foreign_text import visible
from ..file_scene import FileScene, Moment

STYLE = "font-size:0.8em;line-height:1.5;padding:0 0.8em"


def safe(text: object) -> str:
    """A foreign text as HTML: characters that change what is shown are written out, and nothing is obeyed."""
    return escape(visible(str(text)))


def failure_html(sentence: str) -> str:
    """What went wrong, in red."""
    return f'<div style="{STYLE};color:#c1121f">{safe(sentence)}</div>'


def facts_html(scenes: Sequence[FileScene], labels: Sequence[str], titles: Sequence[str] = ()) -> str:
    """What each file is of; titles: more words on each."""
    rows = [
        f"<b>{safe(label)}</b>: {safe(scene.object_name)}, {safe(hand_text(scene.file.hand))}, "
        f"strategy {safe(strategy_name_of(scene.strategy))}, {scene.pose_count:,} poses"
        + ("" if scene.is_sealed else f", <b>{scene.done_count:,} of them done</b> (still being written)")
        for scene, label in zip(scenes, labels, strict=True)
    ]
    rows += [safe(title) for title in titles]
    return f'<div style="{STYLE}">{"<br>".join(rows)}</div>'


def moment_html(moments: Sequence[Moment], scenes: Sequence[FileScene], labels: Sequence[str]) -> str:
    """The numbers of the shown poses, a column for each file."""
    columns = [_column(moment, scene) for moment, scene in zip(moments, scenes, strict=True)]
    head = "".join(f"<th>{safe(label)}</th>" for label in labels) if len(labels) > 1 else ""
    rows = [f"<tr><td></td>{head}</tr>"] if head else []
    for name in columns[0]:
        rows.append(f"<tr><td>{name}</td>" + "".join(f"<td><b>{column[name]}</b></td>" for column in columns) + "</tr>")
    return f'<div style="{STYLE}"><table>{"".join(rows)}</table></div>'


def _column(moment: Moment, scene: FileScene) -> dict[str, str]:
    length = moment.length
    frequency = float(pose_frequencies(moment.contours, scene.sampling)[0]) if length > 0 else None
    return {
        "pose": f"{moment.index} of 0..{scene.pose_count - 1}",
        "time": "none" if moment.time is None else f"{moment.time:.3f} s",
        "contours": f"{1e3 * length:.1f} mm" if moment.is_done else "not rendered yet",
        "draw frequency": "-" if frequency is None else f"{frequency:.1f} Hz",
        "tilt to the array": f"{degrees(moment.tilt):.1f}°",
        "height": f"{1e3 * float(moment.hand_pose[2]):.1f} mm",
    }
