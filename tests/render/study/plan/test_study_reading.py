"""STUDY.toml: plans as the run takes them, and every fault with its file, line and key."""

import warnings

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from written_plans import BLOCKS, EVERY_DESIGN, HEAD, PAPER, PILOT, STIMULI

from palpate.device.playing.limits import Limits
from palpate.render.errors import PalpateWarning, StudyPlanError
from palpate.render.objects.mesh.placement import Placement
from palpate.render.study.plan.study_plan import TEXTS, PlannedStimulus, Question
from palpate.render.study.plan.study_reading import read_stored_study, read_study


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "circle.h5").write_text("never opened")
    return tmp_path


def read(folder, text):
    path = folder / "study.toml"
    path.write_text(text)
    return read_study(path)


def faults(folder, text):
    """The lines of the error, without the folder."""
    with pytest.raises(StudyPlanError) as caught:
        read(folder, text)
    return [line.removeprefix(f"{folder}/") for line in str(caught.value).split("\n")]


# plans


def test_the_papers_study_is_expanded_as_the_paper_describes_it(folder):
    plan = read(folder, PAPER)
    assert (plan.title, plan.block_order, plan.hand, plan.text) == ("Infill density", "latin", "palm", PAPER)
    assert plan.codes == tuple(f"P{number:02d}" for number in range(1, 19))
    shapes = ("cube", "tube", "dog")
    assert [own.name for own in plan.stimuli] == [f"{shape}-{way}" for shape in shapes for way in ("oc", "cc")]
    assert plan.stimulus("dog-oc") == PlannedStimulus(
        name="dog-oc", duration=7.0, solid="dog", shown="dog-detailed", strategy="oc", sampling="stm",
        placement=Placement(fit=0.13, at=(0.0, 0.0, 0.2)), factors={"object": "dog", "strategy": "oc"},
    )  # fmt: skip
    assert plan.stimulus("tube-cc").shown is None
    assert plan.blocks[1].factors == {"object": "cube", "opacity": 0.7}
    assert [own.name for own in plan.blocks] == [f"{shape}-{opacity}" for shape in shapes for opacity in (1.0, 0.7)]
    for block, opacity in zip(plan.blocks, 3 * (1.0, 0.7), strict=True):
        shape = block.name.partition("-")[0]
        assert (block.design, block.sets) == ("2ifc", ((f"{shape}-oc", f"{shape}-cc"),))
        assert (block.repetitions, block.opacity, block.trial_order) == (5, opacity, "random")
        assert block.questions == (block.question,)
        assert (block.question.options, block.question.has_random_keys) == (("First", "Second"), True)
        assert [own.point_count for own in block.questions_after] == [7, 7]


def test_a_stored_plan_is_read_although_the_files_that_it_names_are_gone(folder):
    text = PAPER.replace('object = "{object}"\n', 'object = "{object}.stl"\n')
    with pytest.raises(StudyPlanError, match=r"cube\.stl"):
        read(folder, text)
    plan = read_stored_study(text, folder / "answers.sqlite")
    assert [own.solid for own in plan.stimuli[:3]] == ["cube.stl", "cube.stl", "tube.stl"]
    assert plan.blocks == read(folder, PAPER).blocks


def test_each_design_is_read_as_the_run_takes_it(folder):
    plan = read(folder, EVERY_DESIGN)
    assert plan.codes == ("A1", "b-7")
    pairs, constant, staircase, magnitude, rating, exploration = plan.blocks
    assert [own.design for own in plan.blocks] == list(BLOCKS)
    assert pairs.sets == (("4 cm", "6 cm"), ("4 cm", "8 cm"))
    assert pairs.question.options == ("First", "Second")
    assert constant.sets == (("6 cm", "4 cm"), ("6 cm", "6 cm"), ("6 cm", "8 cm"))
    assert staircase.sets == (("10 cm",), ("8 cm",), ("6 cm",), ("4 cm",))
    assert (staircase.correct_option, staircase.start_level, staircase.down) == (1, 1, 3)
    assert (staircase.steps, staircase.reversals, staircase.trials_max, staircase.tracks) == ((2, 1), 6, 40, 2)
    assert magnitude.sets == (("4 cm",), ("6 cm",), ("8 cm",), ("10 cm",))
    assert (magnitude.modulus, magnitude.shows_hand) == (("6 cm", 100.0), False)
    assert (magnitude.question.kind, magnitude.question.low, magnitude.question.high) == ("number", 0.0, 1000.0)
    assert [own.name for own in rating.questions] == ["rough", "hard"]
    assert exploration.sets == (("4 cm", "10 cm", "4 cm"),)
    assert exploration.questions[0] == Question(
        name="kind", text="What was it?", kind="choice", options=("a sphere", "a cube", "nothing")
    )
    assert exploration.questions[2].is_optional
    assert plan.stimuli[3].value == 10.0
    assert plan.stimuli[0].placement == Placement(fit=0.08, at=(0.0, 0.0, 0.2))


def test_a_prepared_file_is_beside_the_plan_and_may_show_an_object(folder):
    text = (
        PILOT
        + '[[stimulus]]\nname = "circle"\nfile = "circle.h5"\nshown = "cube"\nfit = 0.1\nduration = 2\nvalue = 70\n'
    )
    with pytest.warns(
        PalpateWarning, match=rf"study\.toml:{PILOT.count(chr(10)) + 1}: stimulus: no block uses circle$"
    ):
        stimulus = read(folder, text).stimulus("circle")
    assert stimulus == PlannedStimulus(
        name="circle",
        duration=2.0,
        file=folder / "circle.h5",
        shown="cube",
        placement=Placement(fit=0.1),
        value=70.0,
    )


def test_limits_and_translations_are_taken(folder):
    tables = (
        '[limits]\nduty_max = 0.25\non_time_max = "none"\n'
        '[texts]\nprogress = "{count:g} {number:03d} {{}}"\nagree = ""\n'
    )
    plan = read(folder, PAPER + tables)
    assert plan.limits == Limits(duty_max=0.25, on_time_max=None)
    assert plan.sentence("progress", number=3, count=10) == "10 003 {}"
    assert (plan.sentence("agree"), plan.sentence("decline")) == ("", TEXTS["decline"])


@pytest.mark.parametrize("key", TEXTS)
def test_each_sentence_can_stand_as_its_own_translation(folder, key):
    assert read(folder, f"{PAPER}[texts]\n{key} = '{TEXTS[key]}'\n").texts == {key: TEXTS[key]}


# faults

TITLE, LAST = 'title = "All"', "optional = true"
"""Lines of the plan that others follow in the cases below."""
FAULTS = [
    # keys beside the tables
    (TITLE, "", "study.toml: title: is missing"),
    (TITLE, "title = 3", "study.toml:1: title: must be a text, not 3"),
    (TITLE, 'title = ""', "study.toml:1: title: must have 1..200 characters, not 0"),
    (TITLE, f"{TITLE}\nsede = 1", "study.toml:2: sede: unknown key (did you mean 'seed'?); known: title, "),
    (TITLE, f"{TITLE}\npairs = 1", "study.toml:2: pairs: unknown key here: it belongs to tables [[block]]; known: "),
    (TITLE, f"{TITLE}\nseed = -1", "study.toml:2: seed: must lie in 0..1e+09, not -1"),
    (TITLE, f'{TITLE}\nblock_order = "square"', "study.toml:2: block_order: must be one of latin, random, fixed, not "),
    (TITLE, f"{TITLE}\nrecords_poses = 1", "study.toml:2: records_poses: must be true or false, not 1"),
    (TITLE, f"{TITLE}\nnoise_level = 1.5", "study.toml:2: noise_level: must lie in 0..1, not 1.5"),
    (
        TITLE,
        f'{TITLE}\nhand = "plam"',
        "study.toml:2: hand: 'plam' is neither a hand (palm, planes, skin) nor a file in ",
    ),
    (TITLE, f"{TITLE}\ntexts = 3", "study.toml:2: texts: must be a table, not 3"),
    (
        TITLE,
        f"{TITLE}\nquestion_before = 3",
        "study.toml:2: question_before: must be tables [[question_before]], not 3",
    ),
    # participants
    (
        "codes =",
        "participants = 2\ncodes =",
        "study.toml: needs participants, how many there are, or codes, what they ",
    ),
    (
        "codes =",
        "#",
        "study.toml: needs participants, how many there are, or codes, what they are called: neither is given",
    ),
    ("codes =", "codes = [] #", "study.toml:2: codes: must be a list of 1..999 different codes, not []"),
    ('"b-7"', '"B 7"', "study.toml:2: codes: must be a code of at most 16 letters, digits, - and _, not 'B 7'"),
    ('"b-7"', '"A1"', "study.toml:2: codes: 'A1' stands twice in the list"),
    ('"b-7"', '"a1"', "study.toml:2: codes: 'A1' and another code differ by capital letters only, if at all"),
    # keys of choices
    (
        TITLE,
        f"{TITLE}\nchoice_keys = [1, 2, 3]",
        "study.toml:2: choice_keys: must be a key: one character, or one of Arrow",
    ),
    (
        TITLE,
        f'{TITLE}\nchoice_keys = ["a", "b"]',
        "study.toml:2: choice_keys: must be at least 3 keys, the options of question 'kind'",
    ),
    # stimuli
    (
        'object = "sphere"',
        "",
        "study.toml:3: stimulus: needs object, which is rendered live, or file, which is played: n",
    ),
    (
        'object = "sphere"',
        'shown = "cube"\nfile = "circel.h5"',
        "study.toml:7: stimulus.file: 'circel.h5' is no file in ",
    ),
    (
        'object = "sphere"',
        'file = "circle.h5"',
        "study.toml:7: stimulus.fit: places the object that is seen, and there ",
    ),
    ("duration = 2.0", "duration = 0", "study.toml:9: stimulus.duration: must lie in 0.001..3600 s, not 0"),
    (
        '"{size} cm"',
        '"{size}{siz}"',
        "study.toml:5: stimulus.name: {siz} is no key of this table's `for` (did you mean 's",
    ),
    ("size = [4, ", "x = [1], size = [4, ", "study.toml:4: stimulus.for.x: is not used: no other value of the table "),
    ('"{size} cm"', '"cm"', "study.toml:5: stimulus.name: must be another one: 'cm' is a stimulus already"),
    # blocks
    ('"pairs"', '"before"', "study.toml:12: block.name: must not be before: the data call other answers so"),
    (
        '"pairs"',
        '"{shape}"',
        "study.toml:12: block.name: must be a name of at most 64 letters, digits, blanks and -_.+%, w",
    ),
    (
        'design = "2ifc"',
        "",
        "study.toml:11: block.design: is missing: one of 2ifc, constant, staircase, magnitude, rat",
    ),
    ("pairs =", "practice = 0.5\npairs =", "study.toml:14: block.practice: must be a whole number in 0..1000, not 0.5"),
    ("pairs =", "gap = -1\npairs =", "study.toml:14: block.gap: must lie in 0..60 s, not -1"),
    (
        '["4 cm", "6 cm"]',
        '["4 cm", "5 cm"]',
        "study.toml:14: block.pairs: '5 cm' is no stimulus of this plan (did you ",
    ),
    (
        '["4 cm", "6 cm"]',
        '["4 cm", "4 cm"]',
        "study.toml:14: block.pairs: must be two different stimuli, not ['4 cm', ",
    ),
    (
        '["4 cm", "6 cm"]',
        '["8 cm", "4 cm"]',
        "study.toml:14: block.pairs: ['4 cm', '8 cm'] stands twice: each pair is ",
    ),
    (
        'standard = "6 cm"',
        "",
        "study.toml:16: block.options: is missing: without standard, a trial has one interval: opt",
    ),
    (
        "repetitions = 10",
        "options = ['a', 'b', 'c']",
        "study.toml:22: block.options: must be 2 with standard, one for each",
    ),
    ("start = 1", 'standard = "4 cm"', "study.toml:26: block.levels: must not contain the standard, '4 cm': no answer"),
    ('"8 cm", "6 cm", "4 cm"]', '"8 cm"]\nstandard = "4 cm"', "study.toml:30: block.correct: goes without standard: "),
    ('stimulus = "6 cm"', 'stimuli = "6 cm"', "study.toml:40: block.modulus: must be { stimulus = "),
    ("number = 100", 'number = "100"', "study.toml:40: block.modulus.number: must be a number in "),
    ("high = 1000", "high = 0", "study.toml:42: block.high: must be above low, 0, not 0"),
    # questions
    # translations and limits
    (
        LAST,
        f"{LAST}\n[texts]\ncontinu = ''",
        "study.toml:77: texts.continu: unknown text (did you mean 'continue'?); know",
    ),
    (
        LAST,
        f"{LAST}\n[texts]\nblock = '{{numbr}}'",
        "study.toml:77: texts.block: contains {numbr}, which it has no value ",
    ),
    (
        LAST,
        f"{LAST}\n[texts]\nblock = '{{number'",
        "study.toml:77: texts.block: has a brace that does not fit (expected ",
    ),
    (
        LAST,
        f"{LAST}\n[texts]\nblock = '{{}}'",
        "study.toml:77: texts.block: contains {}, which it has no value for; known",
    ),
    (
        LAST,
        f"{LAST}\n[texts]\nblock = '{{count.real}}'",
        "study.toml:77: texts.block: contains {count.real}, which it has",
    ),
    (
        LAST,
        f"{LAST}\n[texts]\nblock = '{{count!r}}'",
        "study.toml:77: texts.block: contains {count} with a form that is n",
    ),
    (
        LAST,
        f"{LAST}\n[texts]\nblock = '{{count:q}}'",
        "study.toml:77: texts.block: cannot be filled in (Unknown format co",
    ),
    (
        LAST,
        f"{LAST}\n[limits]\nduty_max = 2",
        "study.toml:77: limits.duty_max: is 2, but it must be above 0, at most 1, o",
    ),
    (
        LAST,
        f"{LAST}\n[limits]\npause_min = 'none'",
        'study.toml:77: limits.pause_min: is "none", but it must be a time ab',
    ),
    (
        LAST,
        f"{LAST}\n[limits]\nduty = 2",
        "study.toml:77: limits.duty: unknown limit (did you mean 'duty_max'?); known: on",
    ),
]


@pytest.mark.parametrize(("old", "new", "fault"), FAULTS, ids=[fault for _, _, fault in FAULTS])
def test_a_fault_is_reported_once_with_its_line_and_key(folder, old, new, fault):
    assert old in EVERY_DESIGN
    found = faults(folder, EVERY_DESIGN.replace(old, new, 1))
    assert len(found) == 1, found
    assert found[0].startswith(fault)


def test_all_faults_are_reported_together_and_those_of_one_line_once(folder):
    text = EVERY_DESIGN.replace("seed", "sede").replace('"sphere"', '"spere"').replace("start = 1", "start = 9")
    found = faults(folder, text.replace('"A1"', '""').replace("repetitions = 10", "repetitions = 0"))
    assert [line.partition(": must")[0].partition(": '")[0] for line in found] == [
        "study.toml:2: codes",
        "study.toml:6: stimulus.object",  # of four stimuli
        "study.toml:22: block.repetitions",
        "study.toml:30: block.start",
    ]


@pytest.mark.parametrize(
    ("asked", "fault"),
    [
        ("", "study.toml:11: block: must be at least one table [[block.question]], not []"),
        ("question = '?'\n", "study.toml:15: block.question: must be at least one table [[block.question]], not '?'"),
        ("question_after = 3\n[[block.question]]\nname = 'a'\ntext = 'b'\nkind = 'scale'\n",
         "study.toml:15: block.question_after: must be tables [[block.question_after]], not 3"),
    ],
)  # fmt: skip
def test_questions_are_tables(folder, asked, fault):
    block = '[[block]]\nname = "rating"\ndesign = "rating"\nstimuli = ["4 cm"]\n'
    assert faults(folder, HEAD + STIMULI + block + asked) == [fault]


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (b"a = [", "study.toml:1: not TOML: "),
        (b"title = 1\ntitle = 2", "study.toml:2: not TOML: "),
        (b"\xff", "study.toml: cannot be read"),
        (b"", "study.toml: title: is missing"),
        (b"[[stimulus]]\nx.y.z = 1\n[block]\n", "study.toml: title: is missing"),
    ],
)
def test_a_file_that_is_no_plan_is_refused(folder, text, fault):
    path = folder / "study.toml"
    path.write_bytes(text)
    with pytest.raises(StudyPlanError) as caught:
        read_study(str(path))
    assert str(caught.value).startswith(f"{folder}/{fault}")


def test_a_missing_plan_is_refused_with_the_likely_one(folder):
    (folder / "study.toml").write_text(PAPER)
    with pytest.raises(StudyPlanError, match=r"studi\.toml: cannot be read \(No such file.*did you mean 'study\.toml'"):
        read_study(folder / "studi.toml")


# damaged plans

VALUES = [
    "3",
    "-1",
    "nan",
    '""',
    '"{size}"',
    "[]",
    "[[]]",
    "{}",
    "true",
    '["4 cm"]',
    "[{}]",
    "1979-05-27",
    '"\\u0000"',
    "[1]",
]


@st.composite
def damaged_plans(draw):
    """Plans with lines that are gone, repeated, moved or of another value."""
    lines = draw(st.sampled_from([EVERY_DESIGN, PAPER, PILOT])).splitlines()
    for _ in range(draw(st.integers(1, 3))):
        k = draw(st.integers(0, len(lines) - 1))
        key = lines[k].partition(" =")[0]
        other = st.sampled_from([f"{key} = {value}" for value in VALUES])
        lines[k : k + 1] = draw(
            st.one_of(
                other.map(lambda line: [line]),
                st.sampled_from([[], [lines[k], lines[k]], [lines[k], draw(st.sampled_from(lines))], ["[block]"]]),
                st.text(max_size=5).map(lambda text, k=k: [text + lines[k]]),
            )
        )
    return "\n".join(lines)


def outcome(folder, text):
    """Beginnings of the faults' lines; none for a plan that is taken."""
    path = folder / "study.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PalpateWarning)
        try:
            return [] if read_study(path).blocks else ["a plan without blocks"]
        except StudyPlanError as error:
            return [line.partition(":")[0] for line in str(error).splitlines()]


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damaged_plans())
def test_a_damaged_plan_gives_a_plan_or_faults(folder, text):
    assert set(outcome(folder, text)) <= {f"{folder}/study.toml"}


@pytest.mark.exhaustive
@settings(max_examples=1000, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(damaged_plans())
def test_many_damaged_plans_give_a_plan_or_faults(folder, text):
    assert set(outcome(folder, text)) <= {f"{folder}/study.toml"}
