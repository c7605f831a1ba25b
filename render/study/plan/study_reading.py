"""STUDY.toml read into a `StudyPlan`: all that is wrong with it is reported together, each with its line and key."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from string import Formatter
from typing import Any, NamedTuple, cast

from pydantic import BaseModel

from ....datasets.errors import DatasetError
from ....datasets.known_names import find_name, likely_file, likely_name
from ....datasets.shapes.built_in import shape_name, shape_names
from ....device.errors import LimitsError
from ....device.playing.limits import Limits
from ...errors import PlanError, RenderError, StudyPlanError
from ...intersection.named_inputs import HANDS
from ...objects.mesh.placement import Placement
from ...sampling.presets import PRESETS as SAMPLINGS
from ...sampling.presets import load_sampling
from ...strategies.intersection_strategy import PRESETS as STRATEGIES
from ...strategies.intersection_strategy import load_strategy, strategy_name
from ...sweeps.plan.document import PlanDocument, parse_plan, read_plan
from ...sweeps.plan.line_search import Place
from ...sweeps.plan.values import ChoiceCheck, PlanFault, refuse
from ...user_warnings import warn_user
from ...validation import is_number, value_text
from .study_plan import TEXTS, Factors, PlannedBlock, PlannedStimulus, Question, StudyPlan
from .study_tables import (
    DESIGN_KEYS,
    QUESTION_KEYS,
    RESERVED_BLOCKS,
    TRIAL_QUESTION,
    AskedBlockKeys,
    BlockKeys,
    ChoiceKeys,
    LiveStimulusKeys,
    MagnitudeKeys,
    NumberKeys,
    PreparedStimulusKeys,
    QuestionKeys,
    RepeatedBlockKeys,
    ScaleKeys,
    SentenceCheck,
    StaircaseKeys,
    StimulusKeys,
    StudyKeys,
    TextKeys,
)


class StimulusSources:
    """Looks up what stimuli name; each name once. A name that stands for nothing raises PlanFault.

    Every method takes the text of the plan and returns the name itself, or the absolute path of the file.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute()
        self._found: dict[tuple[str, str], str | PlanFault] = {}

    def find(self, key: str, text: str) -> str:
        """What a key of a plan names: `object`, `shown`, `strategy`, `sampling`, `hand` or `file`."""
        if (key, text) not in self._found:
            try:
                self._found[key, text] = _FINDERS[key](text, self.folder)
            except PlanFault as fault:
                self._found[key, text] = fault
        found = self._found[key, text]
        if isinstance(found, PlanFault):
            refuse(found.sentence)
        return found


def _file(text: str, folder: Path, what: str, known: tuple[str, ...] = ()) -> str:
    """The absolute path of a file; refused if there is none."""
    path = folder / text
    try:
        is_there = path.is_file()
    except OSError:  # such as a name that is too long
        is_there = False
    if not is_there:
        meant = likely_name(text, known) or likely_file(path)
        builtin = f"neither {what} ({', '.join(known)}) nor a file" if known else "no file"
        refuse(f"{text!r:.200} is {builtin} in {folder}{meant}")
    return str(path)


def _object(text: str, folder: Path) -> str:
    module, colon, function = text.rpartition(":")
    if colon and function.isidentifier():  # of a module, which is loaded when the study begins
        return f"{_file(module, folder, 'a module')}:{function}" if module.endswith(".py") else text
    return shape_name(text) or _file(text, folder, "a built-in object", shape_names())


def _strategy(text: str, folder: Path) -> str:
    if found := strategy_name(text):
        return found
    path = _file(text, folder, "a strategy", tuple(STRATEGIES))
    try:
        load_strategy(path)
    except (RenderError, DatasetError) as error:
        refuse(str(error))
    return path


def _sampling(text: str, folder: Path) -> str:
    if found := find_name(text, SAMPLINGS):
        return found
    path = _file(text, folder, "a sampling strategy", tuple(SAMPLINGS))
    try:
        load_sampling(path)
    except (RenderError, DatasetError) as error:
        refuse(str(error))
    return path


def _hand(text: str, folder: Path) -> str:
    return find_name(text, HANDS) or _file(text, folder, "a hand", HANDS)


_FINDERS = {
    "object": _object,
    "shown": _object,
    "strategy": _strategy,
    "sampling": _sampling,
    "hand": _hand,
    "file": partial(_file, what="a file"),
}


TABLES = ("texts", "limits", "question_before", "question_after", "stimulus", "block")
"""Keys of a plan that have tables."""
CONSENT = "consent"
"""Name under which the data have the answer to the consent."""
BLOCK_TABLES = ("for", "question", "question_after")
"""Keys of a block that are read apart from its model, or before it."""
FAULTS_MOST = 50
"""That are written out: the line of each is searched in the whole text."""
LIFTED = "none"
"""A limit's value that lifts it."""
STAND_INS = {"number": 1, "count": 1, "seconds": 1, "value": 1.5, "low": 1.5, "high": 1.5}
"""Values with which translations are tried, of the types that the run puts in."""
_FORMAT = re.compile(r"[+ ]?0?\d?(\.\d)?[a-z%]?")
Keys = type[BaseModel]


class OtherTables(NamedTuple):
    """The keys of tables of the same kind, for keys that stand in the wrong one."""

    what: str
    keys: Mapping[str, Collection[str]]
    """By name."""


def read_study(path: str | Path) -> StudyPlan:
    """A study's plan, from its file.

    Warns (PalpateWarning) of stimuli that no block uses. Raises StudyPlanError with every fault, a line each.
    """
    path = Path(path)
    try:
        text = read_plan(path)
    except PlanError as error:
        raise StudyPlanError(str(error)) from error
    return _study_of_text(text, path, StimulusSources(path.parent))


def read_stored_study(text: str, path: str | Path) -> StudyPlan:
    """A plan that is kept with a study's data: the files that it names may be gone, and are not looked for.

    path: what errors call it. Raises StudyPlanError as `read_study`.
    """
    return _study_of_text(text, Path(path), None)


def _study_of_text(text: str, path: Path, sources: StimulusSources | None) -> StudyPlan:
    try:
        tables = parse_plan(path, text, []).tables
    except PlanError as error:
        raise StudyPlanError(str(error)) from error
    document = StudyDocument(path, text, tables)
    plan = _StudyReader(document, sources).read()
    if document.noted or plan is None:
        raise StudyPlanError(*document.report())
    return plan


IN_TABLES = OtherTables(
    "tables",
    {
        "[[block]]": {key for model in DESIGN_KEYS.values() for key in model.model_fields},
        "[[stimulus]]": {*LiveStimulusKeys.model_fields, *PreparedStimulusKeys.model_fields},
    },
)
IN_STIMULI = OtherTables("stimuli with", {"object": LiveStimulusKeys.model_fields})
IN_QUESTIONS = OtherTables("kind", {kind: model.model_fields for kind, model in QUESTION_KEYS.items()})
IN_DESIGNS = OtherTables("design", {name: model.model_fields for name, model in DESIGN_KEYS.items()})


class StudyDocument(PlanDocument):
    """A plan's text and tables, and the faults found so far, each once: tables that stand for several repeat them."""

    def __init__(self, path: Path, text: str, tables: dict[str, Any]) -> None:
        super().__init__(path, text, tables)
        self.noted: dict[tuple[Place, str], None] = {}

    def fault(self, place: Place, sentence: str) -> None:
        """Note a fault, whose line is searched when it is reported."""
        self.noted[place, sentence] = None

    def report(self) -> list[str]:
        """The faults, a sentence each, without the last ones of very many."""
        shown = list(self.noted)[:FAULTS_MOST]
        starts = {place: self.where(place) for place, _ in shown}
        lines = [f"{starts[place]}: {sentence}" for place, sentence in shown]
        more = len(self.noted) - len(shown)
        return [*lines, *([f"{self.path}: {more} more faults"] if more else [])]

    def known(self, model: Keys, table: Any, place: Place, others: OtherTables, extra: Sequence[str] = ()) -> Any:
        """A table as an instance of its model, or None; a key that it does not have is reported and left out.

        others: which may have that key; extra: keys of this one that are read elsewhere.
        """
        if not isinstance(table, dict):
            return self.fault(place, f"must be a table, not {value_text(table)}")
        names = [*model.model_fields, *(key for key in extra if key not in model.model_fields)]
        for key in table:
            if key not in names:
                having = [name for name, own in others.keys.items() if key in own]
                meant = f" here: it belongs to {others.what} {', '.join(having)}" if having else likely_name(key, names)
                self.fault((*place, key), f"unknown key{meant}; known: {', '.join(names)}")
        return self.validated(model, {key: table[key] for key in table if key in model.model_fields}, place)


class _StudyReader:
    """Makes a `StudyPlan` of the tables of one document; sources: look up what it names; None: nothing is looked up."""

    def __init__(self, document: StudyDocument, sources: StimulusSources | None) -> None:
        self.document = document
        self.sources = sources
        self.option_counts: list[tuple[int, str]] = []  # of every choice, with the sentence that says where it is

    def read(self) -> StudyPlan | None:
        """The plan; None if the document has a fault without which there is none."""
        document, tables = self.document, self.document.tables
        plain = {key: value for key, value in tables.items() if key not in TABLES}
        keys = cast("StudyKeys | None", document.known(StudyKeys, plain, (), IN_TABLES, TABLES))
        codes, hand = (), "palm"
        if keys is not None:
            with document.noting("hand"):
                hand = self._found("hand", keys.hand)
            with document.noting():
                codes = _codes(keys)
        texts, limits = self._texts(tables.get("texts", {})), self._limits(tables.get("limits", {}))
        before = self._questions(tables, (), "question_before", {CONSENT: "the consent itself"})
        after = self._questions(tables, (), "question_after", {})
        stimuli, names = self._stimuli()
        blocks = self._blocks(names)
        if keys is None:
            return None
        if len({key.casefold() for key in keys.choice_keys}) < len(keys.choice_keys):
            document.fault(("choice_keys",), "must differ by more than capitals, which the page does not tell apart")
        if " " in keys.choice_keys:
            document.fault(("choice_keys",), "must not have the space bar, with which participants go on")
        for count, where in self.option_counts:
            if keys.choice_keys and count > len(keys.choice_keys):
                document.fault(("choice_keys",), f"must be at least {count} keys, the options of {where}")
        if not document.noted and self.sources is not None:
            self._warn_of_unused(stimuli, blocks)
        return StudyPlan(
            path=document.path,
            text=document.text,
            title=keys.title,
            codes=codes,
            seed=keys.seed,
            stimuli=tuple(own for _, own in stimuli),
            blocks=tuple(blocks),
            block_order=keys.block_order,
            consent=keys.consent,
            data_statement=keys.data_statement,
            welcome=keys.welcome,
            goodbye=keys.goodbye,
            questions_before=before,
            questions_after=after,
            choice_keys=tuple(keys.choice_keys),
            answer_seconds=keys.answer_seconds,
            hand=hand,
            records_poses=keys.records_poses,
            noise_level=keys.noise_level,
            limits=limits,
            texts=texts,
        )

    def _found(self, key: str, text: str) -> str:
        return text if self.sources is None else self.sources.find(key, text)

    def _expanded(self, kind: str) -> Iterator[tuple[Place, dict[str, Any], Factors]]:
        """The tables that those of one kind stand for, each with the place of its own, and its values of `for`."""
        tables, document, count = self.document.tables.get(kind, []), self.document, 0
        if not isinstance(tables, list) or not tables:
            given = f", not {value_text(tables)}" if kind in document.tables else "; there is none"
            return document.fault((kind,), f"must be at least one table [[{kind}]]{given}")
        for k, table in enumerate(tables):
            if not isinstance(table, dict):
                document.fault((kind, k), f"must be a table, not {value_text(table)}")
                continue
            own: Place = (kind, k)
            found = expand_table(table, lambda place, sentence, own=own: document.fault((*own, *place), sentence))
            count += len(found)
            if count > TABLES_MOST:
                return document.fault(own, f"must stand with those before for at most {TABLES_MOST} tables")
            if found:
                yield from ((own, one, factors) for one, factors in zip(found, factor_values(table), strict=True))

    def _stimuli(self) -> tuple[list[tuple[Place, PlannedStimulus]], set[str] | None]:
        """The stimuli that can be used; the names of all, None if a fault leaves some unknown."""
        found, names = [], set[str]()
        for place, table, factors in self._expanded("stimulus"):
            stimulus = self._stimulus(place, table, factors)
            name = table.get("name")
            if isinstance(name, str) and name in names:
                self.document.fault((*place, "name"), f"must be another one: {name!r:.80} is a stimulus already")
            elif stimulus is not None:
                found.append((place, stimulus))
            if isinstance(name, str):
                names.add(name)
        unknown = [place for place, _ in self.document.noted if place[:1] == ("stimulus",)]
        is_complete = not any(place[2:3] in ((), ("name",), ("for",)) for place in unknown)
        return found, names if is_complete else None

    def _stimulus(self, place: Place, table: dict[str, Any], factors: Factors) -> PlannedStimulus | None:
        document = self.document
        if ("object" in table) == ("file" in table):
            what = "both are given" if "file" in table else "neither is given"
            return document.fault(place, f"needs object, which is rendered live, or file, which is played: {what}")
        model = LiveStimulusKeys if "object" in table else PreparedStimulusKeys
        keys = cast("StimulusKeys | None", document.known(model, table, place, IN_STIMULI, ("for",)))
        if keys is None:
            return None
        found: dict[str, str] = {}
        for key in ("object", "shown", "strategy", "sampling", "file"):
            if (text := getattr(keys, key, None)) is not None:
                with document.noting(*place, key):
                    found[key] = self._found(key, text)
        placement = Placement(
            scale=keys.scale,
            up=keys.up,
            fit=keys.fit,
            rotate=cast("tuple[float, float, float]", tuple(keys.rotate)),
            at=None if keys.at is None else cast("tuple[float, float, float]", tuple(keys.at)),
        )
        if "file" in table and keys.shown is None and placement != Placement():
            key = next(key for key in ("scale", "up", "fit", "rotate", "at") if key in table)
            document.fault((*place, key), "places the object that is seen, and there is none: a file needs shown")
        return PlannedStimulus(
            name=keys.name,
            duration=keys.duration,
            file=Path(found["file"]) if "file" in found else None,
            solid=found.get("object"),
            strategy=found.get("strategy", "cc"),
            sampling=found.get("sampling"),
            shown=found.get("shown"),
            placement=placement,
            value=keys.value,
            factors=factors,
        )

    def _blocks(self, stimuli: Collection[str] | None) -> list[PlannedBlock]:
        """The blocks; stimuli: names that they may use; None: any."""
        found, names = [], set[str]()
        for place, table, factors in self._expanded("block"):
            name = table.get("name")
            if isinstance(name, str):
                if name in names:
                    self.document.fault((*place, "name"), f"must be another one: {name!r:.80} is a block already")
                if name in RESERVED_BLOCKS:
                    self.document.fault((*place, "name"), f"must not be {name}: the data call other answers so")
                names.add(name)
            block = self._block(place, table, stimuli)
            if block is not None:
                found.append(replace(block, factors=factors))
        return found

    def _block(self, place: Place, table: dict[str, Any], stimuli: Collection[str] | None) -> PlannedBlock | None:
        document = self.document
        design = table.get("design", "")
        with document.noting(*place, "design"):
            if "design" not in table:
                refuse(f"is missing: one of {', '.join(DESIGN_KEYS)}")
            design = ChoiceCheck(tuple(DESIGN_KEYS))(design)
        model = DESIGN_KEYS.get(design) if isinstance(design, str) else None
        if model is None:
            return None
        asks_tables = "question" not in model.model_fields
        plain = {key: value for key, value in table.items() if not (key == "question" and asks_tables)}
        plain.pop("question_after", None)
        keys = document.known(model, plain, place, IN_DESIGNS, BLOCK_TABLES)
        if keys is not None and stimuli is not None:
            for inner, name in _named_stimuli(keys):
                if name not in stimuli:
                    meant = likely_name(name, stimuli)
                    document.fault((*place, *inner), f"{name!r} is no stimulus of this plan{meant}")
        kinds = ("scale",) if design == "rating" else tuple(QUESTION_KEYS)
        names = {} if asks_tables else {TRIAL_QUESTION: "the question of each trial"}
        questions = self._questions(table, place, "question", names, kinds, least=1) if asks_tables else ()
        after = self._questions(table, place, "question_after", names)
        if keys is None or (asks_tables and not questions):
            return None
        if not asks_tables:
            questions = (_trial_question(keys),)
            if isinstance(keys, AskedBlockKeys):
                self.option_counts.append((len(keys.options), f"block {keys.name!r}"))
        return _planned_block(keys, questions, after)

    def _questions(
        self,
        table: dict[str, Any],
        place: Place,
        key: str,
        names: dict[str, str],
        kinds: tuple[str, ...] = tuple(QUESTION_KEYS),
        *,
        least: int = 0,
    ) -> tuple[Question, ...]:
        """The questions of a list of tables; names: those that are in use already, and by what."""
        document, tables = self.document, table.get(key, [])
        where = f"[[{'.'.join([*(step for step in place if isinstance(step, str)), key])}]]"
        if not isinstance(tables, list) or len(tables) < least:
            what = f"tables {where}" if least == 0 else f"at least one table {where}"
            document.fault((*place, key) if key in table else place, f"must be {what}, not {value_text(tables)}")
            return ()
        found: list[Question] = []
        for k, own in enumerate(tables):
            question = self._question((*place, key, k), own, kinds)
            if question is None:
                continue
            if question.name in names:
                used = names[question.name]
                document.fault((*place, key, k, "name"), f"must be another one: {question.name!r} is {used}")
            names[question.name] = "a question already"
            found.append(question)
            if question.kind == "choice":
                self.option_counts.append((len(question.options), f"question {question.name!r}"))
        return tuple(found)

    def _question(self, place: Place, table: object, kinds: tuple[str, ...]) -> Question | None:
        document, kind = self.document, ""
        if not isinstance(table, dict):
            return document.fault(place, f"must be a table, not {value_text(table)}")
        with document.noting(*place, "kind"):
            if "kind" not in table:
                refuse(f"is missing: one of {', '.join(kinds)}")
            kind = ChoiceCheck(kinds)(table["kind"])
        model = QUESTION_KEYS.get(kind)
        keys = document.known(model, table, place, IN_QUESTIONS) if model else None
        return None if keys is None else _planned_question(keys)

    def _texts(self, table: object) -> dict[str, str]:
        """The translations."""
        if not isinstance(table, dict):
            self.document.fault(("texts",), f"must be a table, not {value_text(table)}")
            return {}
        for key, value in table.items():
            with self.document.noting("texts", key):
                if key not in TEXTS:
                    refuse(f"unknown text{likely_name(key, TEXTS)}; known: {', '.join(TEXTS)}")
                _check_translation(key, SentenceCheck(least=0, most=1000)(value))
        return {key: value for key, value in table.items() if isinstance(value, str)}

    def _limits(self, table: object) -> Limits:
        """The bounds of a playback; those that are refused keep their defaults."""
        if not isinstance(table, dict):
            self.document.fault(("limits",), f"must be a table, not {value_text(table)}")
            return Limits()
        known, given = [own.name for own in fields(Limits)], {}
        for key, value in table.items():
            with self.document.noting("limits", key):
                if key not in known:
                    refuse(f"unknown limit{likely_name(key, known)}; known: {', '.join(known)}")
                try:
                    own = {key: None if value == LIFTED else value}
                    Limits(**own)
                    given |= own
                except LimitsError as error:
                    refuse(str(error).removeprefix(f"{key} ").replace("None", f'"{LIFTED}"'))
        return Limits(**given)

    def _warn_of_unused(self, stimuli: list[tuple[Place, PlannedStimulus]], blocks: list[PlannedBlock]) -> None:
        """Warn of stimuli that nothing plays, once for each table."""
        used = {name for block in blocks for names in block.sets for name in names}
        used |= {block.modulus[0] for block in blocks if block.modulus}
        unused: dict[Place, list[str]] = {}
        for place, stimulus in stimuli:
            if stimulus.name not in used:
                unused.setdefault(place, []).append(stimulus.name)
        for place, names in unused.items():
            more = f" and {len(names) - 5} more" if len(names) > 5 else ""
            warn_user(f"{self.document.where(place)}: no block uses {', '.join(names[:5])}{more}")


def _codes(keys: StudyKeys) -> tuple[str, ...]:
    """The participants' codes."""
    if (keys.participants is None) == (keys.codes is None):
        given = "neither is given" if keys.codes is None else "both are given"
        refuse(f"needs participants, how many there are, or codes, what they are called: {given}")
    if keys.codes is None:
        count = keys.participants or 0
        return tuple(f"P{number:0{max(2, len(str(count)))}d}" for number in range(1, count + 1))
    spellings = Counter(code.casefold() for code in keys.codes)
    for k, code in enumerate(keys.codes):
        if spellings[code.casefold()] > 1:
            refuse(f"{code!r} and another code differ by capital letters only, if at all", ("codes", k))
    return tuple(keys.codes)


def _named_stimuli(keys: BlockKeys) -> Iterator[tuple[Place, str]]:
    """The stimuli that a block names, each with its place in the block's table."""
    for key in ("pairs", "comparisons", "standard", "levels", "stimuli", "sets"):
        listed: Any = getattr(keys, key, None) or ()
        if isinstance(listed, str):
            yield (key,), listed
            continue
        for k, item in enumerate(listed):
            yield from (((key, k), name) for name in ([item] if isinstance(item, str) else item))
    if isinstance(keys, MagnitudeKeys) and keys.modulus:
        yield ("modulus", "stimulus"), keys.modulus[0]


def _trial_question(keys: BlockKeys) -> Question:
    """The one question of each trial."""
    if isinstance(keys, AskedBlockKeys):
        return Question(
            name=TRIAL_QUESTION,
            text=keys.question,
            kind="choice",
            options=tuple(keys.options),
            has_random_keys=keys.random_keys,
        )
    asked = cast("MagnitudeKeys", keys)
    return Question(name=TRIAL_QUESTION, text=asked.question, kind="number", low=asked.low, high=asked.high)


def _planned_block(keys: BlockKeys, questions: tuple[Question, ...], after: tuple[Question, ...]) -> PlannedBlock:
    """A block as the study's other parts take it."""
    own: dict[str, Any] = {}
    if isinstance(keys, RepeatedBlockKeys):
        own["repetitions"] = keys.repetitions
    if isinstance(keys, MagnitudeKeys):
        own["modulus"] = keys.modulus
    if isinstance(keys, StaircaseKeys):
        own |= {
            "correct_option": None if keys.correct is None else keys.options.index(keys.correct),
            "start_level": keys.start,
            "down": keys.down,
            "steps": tuple(keys.steps),
            "reversals": keys.reversals,
            "trials_max": keys.trials_max,
            "tracks": keys.tracks,
        }
    return PlannedBlock(
        name=keys.name,
        design=keys.design,
        question=questions[0],
        questions=questions,
        instruction=keys.instruction,
        sets=tuple(keys.trial_sets),
        trial_order=keys.trial_order,
        practice=keys.practice,
        opacity=keys.opacity,
        shows_hand=keys.hand,
        gap=keys.gap,
        rest=keys.rest,
        questions_after=after,
        **own,
    )


def _planned_question(keys: QuestionKeys) -> Question:
    """A question as the study's other parts take it."""
    own: dict[str, Any] = {}
    if isinstance(keys, ChoiceKeys):
        own = {"options": tuple(keys.options), "has_random_keys": keys.random_keys}
    if isinstance(keys, ScaleKeys):
        own = {"point_count": keys.points, "low_text": keys.low_text, "high_text": keys.high_text}
    if isinstance(keys, NumberKeys):
        own = {"low": keys.low, "high": keys.high, "is_optional": keys.optional}
    if isinstance(keys, TextKeys):
        own = {"is_optional": keys.optional}
    return Question(name=keys.name, text=keys.text, kind=keys.kind, **own)


def _check_translation(key: str, text: str) -> None:
    """Refuse a translation that cannot be filled in with the values of the text that it replaces."""
    known = {name for _, name, _, _ in Formatter().parse(TEXTS[key]) if name}
    form = ", ".join(f"{{{name}}}" for name in sorted(known)) or "none"
    try:
        pieces = list(Formatter().parse(text))
    except ValueError as error:
        refuse(f"has a brace that does not fit ({error}): write {{{{ for a brace")
    for _, name, spec, conversion in pieces:
        if name is None:
            continue
        if name not in known:
            meant = likely_name(name, known)
            refuse(f"contains {{{name:.40}}}, which it has no value for{meant}; known: {form}")
        if conversion or not _FORMAT.fullmatch(spec or ""):
            refuse(f"contains {{{name}}} with a form that is not allowed; {{{name}}} alone is")
    try:
        text.format(**STAND_INS)
    except ValueError as error:
        refuse(f"cannot be filled in ({error})")


# ---- Tables of STUDY.toml that stand for several: `for = { object = ["cube", "tube"] }` and `{object}` in other values


TABLES_MOST = 1000
"""That all tables of one kind stand for."""
NUMBER_MOST = 1e12
"""Of the values of `for`; a nan is none of them."""
_PLACEHOLDER = re.compile(r"\{\{|\}\}|\{([A-Za-z_]\w*)\}")
_KEY = re.compile(r"[A-Za-z_]\w*")
Note = Callable[[Place, str], None]
"""Notes a fault: its place within the table, and the sentence."""


def expand_table(table: dict[str, Any], note: Note) -> list[dict[str, Any]]:
    """The tables that a table stands for, one for each combination of the values of its `for`, the last key fastest.

    A text that is exactly `{key}` becomes the value itself, so that a number stays one; within a longer text the value
    is put in, and `{{` and `}}` are braces. A table without `for` stands for itself, and its braces stay. Returns none,
    with the fault noted, for a `for` that cannot be used and for placeholders that it does not know.
    """
    if "for" not in table:
        return [table]
    choices = table["for"]
    if not _can_be_used(choices, note):
        return []
    rest = {key: value for key, value in table.items() if key != "for"}
    filler = _Filler(note)
    filled = [filler.fill(rest, values, ()) for values in factor_values(table)]
    for key in choices:
        if key not in filler.used:
            note(("for", key), f"is not used: no other value of the table contains {{{key}}}")
    return filled if filler.is_fine else []


def factor_values(table: dict[str, Any]) -> list[dict[str, Any]]:
    """The values of `for`, by key, of each of the tables that `expand_table` gives; one without any for no `for`."""
    choices = table.get("for", {})
    return [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]


def _can_be_used(choices: object, note: Note) -> bool:
    """Whether `for` is a table of keys with lists of different values; faults are noted."""
    if not isinstance(choices, dict) or not choices:
        note(("for",), f'must be a table of lists, such as {{ object = ["cube", "tube"] }}, not {value_text(choices)}')
        return False
    fine, count = True, 1
    for key, values in choices.items():
        what = None
        if not _KEY.fullmatch(key):
            what = f"must be called by letters, digits and _, not {value_text(key)}"
        elif not isinstance(values, list) or not values:
            what = f"must be a list of at least one value, not {value_text(values)}"
        elif not all(isinstance(value, str) or (is_number(value) and abs(value) <= NUMBER_MOST) for value in values):
            what = f"must be a list of texts, or of numbers in +-{NUMBER_MOST:g}, not {value_text(values)}"
        elif len(set(map(str, values))) < len(values):
            what = f"must be a list of different values, not {value_text(values)}"
        else:
            count *= len(values)
        if what:
            note(("for", key), what)
            fine = False
    if fine and count > TABLES_MOST:
        note(("for",), f"must stand for at most {TABLES_MOST} combinations, not more")
        return False
    return fine


class _Filler:
    """Puts values into the texts of a table, and remembers which were used."""

    def __init__(self, note: Note) -> None:
        self.note = note
        self.used: set[str] = set()
        self.is_fine = True

    def fill(self, value: Any, values: dict[str, Any], place: Place) -> Any:
        """A copy of a value with all placeholders filled in; keys stay as they are."""
        if isinstance(value, dict):
            return {key: self.fill(own, values, (*place, key)) for key, own in value.items()}
        if isinstance(value, list):
            return [self.fill(own, values, (*place, k)) for k, own in enumerate(value)]
        if not isinstance(value, str):
            return value
        alone = _PLACEHOLDER.fullmatch(value)
        if alone and alone[1] in values:
            self.used.add(alone[1])
            return values[alone[1]]

        def put(found: re.Match[str]) -> str:
            key = found[1]
            if key is None:
                return found[0][0]  # a brace that was written twice
            if key not in values:
                meant, self.is_fine = likely_name(key, values), False
                self.note(place, f"{found[0]} is no key of this table's `for`{meant}; known: {', '.join(values)}")
                return found[0]
            self.used.add(key)
            return str(values[key])

        return _PLACEHOLDER.sub(put, value)
