"""What `palpate study analyse` does: writes the report, tables and pictures of a study's data, or shows its power."""

import re
import time
from dataclasses import asdict
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ....datasets.storage.durable import write_file
from ...errors import RenderError, StrategyError, StudyError
from ...reports.report_pages import ReportSection, html_page, markdown_page
from ...terminal import bars, console
from ...terminal.foreign_text import print_message, show_table, write_output
from ..plan.study_reading import read_study
from .answer_reading import read_answers
from .power import WANTED, find_power, power_question
from .report_sections import is_found, report_sections, test_text
from .result_columns import answer_columns, fit_columns, measure_columns, outcome_columns, write_table
from .study_analysis import StudyAnalysis, analyse_answers

REPORTS = ("report.html", "report.md")
TABLES = ("answers.csv", "measures.csv", "tests.csv", "fits.csv")
PLAN_SUFFIX = ".toml"
POWER_OPTIONS = ("measure", "mean", "mean_other", "factor", "spread", "opposite", "noise")


def analyse_study(options: dict[str, Any], *, as_json: bool) -> int:
    """Write the analysis of a study, or show its power; returns the exit code."""
    if find_spec("statsmodels") is None:
        raise StudyError('statsmodels is missing: pip install "palpate[study]"')
    path: Path = options["study"]
    if options["power"]:
        return _show_power(path, options, as_json=as_json)
    given = [name for name in POWER_OPTIONS if options[name] is not None]
    if given:
        raise StrategyError(f"--{given[0].replace('_', '-')} is of --power")
    data = options["data"] or (path.with_suffix(".data") if path.suffix == PLAN_SUFFIX else path)
    if path.suffix == PLAN_SUFFIX and not data.exists():
        reason = "nobody has taken part yet, or --data names another folder" if path.exists() else f"nor is {path}"
        raise StudyError(f"{data} is not there: {reason}")
    output: Path = options["output"] or (data if data.is_dir() else data.parent) / "analysis"
    table = read_answers(data)
    if not table.codes:
        raise StudyError(f"{data} has no answers yet: nobody has taken part")
    if path.suffix == PLAN_SUFFIX and path.exists() and path.read_text("utf-8", "replace") != table.plan.text:
        console.warn(f"{path} is not the plan that is kept with the data, {table.plan.title!r}, which is used")
    names = (*REPORTS, *TABLES)
    there = [output / name for name in names if (output / name).exists()]
    if there and not options["overwrite"]:
        raise StrategyError(f"{there[0]}: exists; --overwrite replaces it")
    with bars.progress_bar(str(data), quiet=as_json):
        analysis = analyse_answers(table)
        sections = report_sections(analysis)
    paths = _write(output, analysis, sections, str(data))
    for fault in analysis.faults:
        console.warn(fault)
    facts = {**_facts(analysis), **paths}
    if as_json:
        write_output(console.json_line(facts))
    else:  # names of measures and factors stay as the plan and the tables have them
        show_table("study analyse", [(name, str(value)) for name, value in facts.items()])
    return console.DONE


def _facts(analysis: StudyAnalysis) -> dict[str, Any]:
    """What a person reads in the terminal: who took part, and what the main tests say."""
    facts: dict[str, Any] = {"participants": len(analysis.table.codes), "answers": len(analysis.table.answers)}
    for tests in analysis.tests:
        if tests.chance_by_ranks is not None:
            facts[f"{tests.measure.name} - {tests.measure.chance:g}"] = test_text(tests.chance_by_ranks)
        for own in tests.factors:
            for test in own.by_ranks:
                if is_found(test):
                    facts[f"{tests.measure.name} by {own.factor}: {test.compares}"] = test_text(test)
    return facts


def _write(folder: Path, analysis: StudyAnalysis, sections: list[ReportSection], source: str) -> dict[str, str]:
    """Write everything; returns the paths that a person opens."""
    table = analysis.table
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"{folder}: cannot be made ({error.strerror or error})") from error
    title = f"{table.plan.title}: analysis"
    introduction = (
        f"Made by palpate {version('palpate')} from {source} on {time.strftime('%Y-%m-%d')}. Sentences say what tests "
        "found in which a participant is one observation; all p are two-sided, and below 0.05, corrected where there "
        "are several, a difference is called found. ± is the standard deviation between participants. A difference is "
        "the pseudo-median in tests by ranks, the mean in t-tests; its 95 % interval, which is not "
        "corrected, stands in brackets."
    )
    footer = f"Tests by SciPy {version('scipy')} and statsmodels {version('statsmodels')}."
    files = {
        REPORTS[0]: html_page(title, introduction, sections, footer).encode(),
        REPORTS[1]: markdown_page(title, introduction, sections, footer, wraps=False).encode(),
    }
    for section in sections:
        files |= {picture.file: picture.content for picture in section.pictures if picture.file}
    earlier = _pictures_of(folder / REPORTS[1])
    for name, content in files.items():
        try:
            write_file(folder / name, content)
        except OSError as error:
            raise RenderError(f"{folder / name}: cannot be written ({error.strerror or error})") from error
    tables = (answer_columns(table), measure_columns(analysis), outcome_columns(analysis), fit_columns(analysis))
    written = []
    for name, columns in zip(TABLES, tables, strict=True):
        if columns:
            write_table(folder / name, columns)
            written.append(name)
    for name in (*earlier, *TABLES):
        if name not in files and name not in written:  # of an earlier analysis, which this one replaces
            (folder / name).unlink(missing_ok=True)
    return {"report": str(folder / REPORTS[0]), "tables": ", ".join(written)}


def _pictures_of(report: Path) -> list[str]:
    """Names of the pictures that an earlier report shows from beside it."""
    try:
        return re.findall(r"\]\(([\w.+-]+\.svg)\)", report.read_text("utf-8", "replace"))
    except OSError:
        return []


def _show_power(path: Path, options: dict[str, Any], *, as_json: bool) -> int:
    """Simulate the plan's study with an effect, and show how many participants find it."""
    if path.suffix != PLAN_SUFFIX:
        raise StrategyError(f"--power is computed from a plan, STUDY.toml, not {path}")
    plan = read_study(path)
    question = power_question(plan, options)
    with bars.progress_bar(str(path), quiet=as_json):
        found = find_power(question)
    needed = next((own.participants for own in found if own.power >= WANTED), None)
    facts: dict[str, Any] = {
        "sought": question.sought,
        **question.assumed,
        "needed": f"more than {found[-1].participants}" if needed is None else needed,
        "power wanted": WANTED,
    }
    if as_json:
        write_output(console.json_line({**facts, "powers": [asdict(own) for own in found]}))
        return console.DONE
    rows = [
        (f"{own.participants}{' (planned)' * (own.participants == question.planned)}", f"{own.power:.2f}",
         f"{own.low:.2f} to {own.high:.2f}")
        for own in found
    ]  # fmt: skip
    show_table("power", rows, ("participants", "power", "95 % interval"))
    console.show_values(facts, as_json=False, title="study analyse --power")
    if question.measure.factors and needed is not None:
        print_message(f"palpate study {path} --dry-run says which numbers of participants balance its blocks")
    return console.DONE
