"""Names of renderings for legends: the strategy's; hand and file only where those are the same."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from ...datasets.contour_file.reader import ContourFile
from ..strategies.intersection_strategy import PRESETS
from ..terminal.foreign_text import visible

ADDED = "joined"  # by `render` to hands of several patches, whatever the strategy's name
NAME_MOST = 40  # characters


def labels_of(files: Sequence[ContourFile]) -> list[str]:
    """A label for each file: strategy, then options of its stages, hand and file as far as needed to distinguish them.

    >>> from palpate.render import ContourFile, render, static_pose
    >>> path = render("cube", "palm", static_pose([0, 0, 0.2]), "hatch").save("cube.h5", overwrite=True)
    >>> with ContourFile(path) as file:
    ...     labels_of([file])
    ['hatch']
    """
    labels = [strategy_name_of(file.strategy) for file in files]
    for texts_of in (_options_texts, _hand_texts, _path_texts):
        for label in [label for label, count in Counter(labels).items() if count > 1]:
            rows = [k for k, own in enumerate(labels) if own == label]
            texts = texts_of([files[k] for k in rows])
            if len(set(texts)) > 1:
                for k, text in zip(rows, texts, strict=True):
                    labels[k] = f"{label}, {text}" if text else label
    return [short_text(label) for label in labels]


def _options_texts(files: Sequence[ContourFile]) -> list[str]:
    """The options of the stages of each file's strategy that not all of them have."""
    options = [[item for _, given in _stages(file.strategy) for item in given.items()] for file in files]
    return [
        ", ".join(
            f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in own
            if not all((name, value) in others for others in options)
        )
        for own in options
    ]


def _hand_texts(files: Sequence[ContourFile]) -> list[str]:
    return [hand_text(file.hand) for file in files]


def _path_texts(files: Sequence[ContourFile]) -> list[str]:
    stems = [file.path.stem for file in files]
    return stems if len(set(stems)) == len(stems) else [str(file.path) for file in files]


def short_text(text: str, most: int = NAME_MOST) -> str:
    """A name on one line, made visible, without its middle where it is longer than `most` characters."""
    line = visible(" ".join(text.split()))
    return line if len(line) <= most else f"{line[: most // 2]}…{line[len(line) - (most - 1) // 2 :]}"


def strategy_name_of(described: dict[str, Any]) -> str:
    """The preset that a file's strategy is, or its stages joined by +; options are not looked at but a preset's own."""
    stages = _stages(described)
    fitting = {}
    for name, make in PRESETS.items():
        own = _stages(make().described())
        names, options = [name for name, _ in own], [options for _, options in own]
        if names == [name for name, _ in stages] and all(
            mine.items() <= given.items() for mine, (_, given) in zip(options, stages, strict=True)
        ):
            fitting[name] = sum(map(len, options))
    if fitting:
        return max(fitting, key=lambda name: fitting[name])
    return " + ".join(name for name, _ in stages if name not in ("section", "outside", ADDED)) or "section"


def hand_text(described: dict[str, Any]) -> str:
    """A file's hand in a few words.

    >>> hand_text({"kind": "palm", "width": 0.085, "length": 0.1})
    'palm 85 x 100 mm'
    """
    kind = described.get("kind")
    if kind == "palm":
        return f"palm {1e3 * described['width']:.3g} x {1e3 * described['length']:.3g} mm"
    if kind == "planes":
        return f"planes ({len(described.get('patches', ()))})"
    return short_text(str(described.get("name") or kind))


def _stages(described: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Names and options of all stages of a strategy, raw intersection first, as `Stage.described` gives them."""
    listed = [described.get("raw", "section"), *described.get("prune", ()), *described.get("transform", ())]
    stages = [value if isinstance(value, dict) else {"stage": value} for value in listed]
    named = [(str(stage.get("stage")), {key: stage[key] for key in stage if key != "stage"}) for stage in stages]
    return [(name, options) for name, options in named if name != ADDED]
