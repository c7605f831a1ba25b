"""The paper's study and its pilot as plans: the numbers that the paper states, and the command that writes them."""

from command_line import FAILED, MISUSED, answer, refused, run

from palpate.device import array_model
from palpate.render.study.plan.block_designs import rng_of, trials_of
from palpate.render.study.plan.study_judgement import judge_study
from palpate.render.study.plan.study_plan import EXAMPLES, example_text
from palpate.render.study.plan.study_reading import read_study


def plan_of(name, folder):
    path = folder / f"{name}.toml"
    path.write_text(example_text(name))
    return read_study(path)


def test_the_study_has_the_papers_numbers_and_no_fault(tmp_path):
    plan = plan_of("paper", tmp_path)
    found = judge_study(plan, array_model("emulator"))
    assert (found.faults, found.notes, found.is_balanced) == ((), (), True)
    assert (len(found.participants), len(found.blocks), found.trials_least, found.intervals_most) == (18, 6, 60, 120)
    assert {(own.trials_least, own.practice) for own in found.blocks} == {(10, 0)}
    for number, block in enumerate(plan.blocks):
        orders = [own.stimuli for own in trials_of(block, rng_of(plan, 0, number))]
        assert sorted(orders.count(own) for own in set(orders)) == [5, 5]
        assert {tuple(sorted(own)) for own in orders} == {tuple(sorted(block.sets[0]))}
        assert block.sets[0][1].endswith("-cc")  # the second one of a pair is what p counts
    firsts = [own.blocks[0] for own in found.participants]
    assert {firsts.count(name) for name in firsts} == {3}
    assert {own.seconds for own in found.stimuli} == {7.0}
    assert found.seconds < 40 * 60  # what the consent says
    assert plan.noise_level > 0


def test_the_pilot_has_the_papers_order_and_no_fault(tmp_path):
    plan = plan_of("pilot", tmp_path)
    found = judge_study(plan, array_model("emulator"))
    assert (found.faults, found.notes, len(found.participants), found.trials_least) == ((), (), 6, 5)
    for number in range(6):
        trials = list(trials_of(plan.blocks[0], rng_of(plan, number, 0)))
        assert [own.stimuli[0].partition("-")[0] for own in trials] == ["tube", "sphere", "dog", "cube", "rock"]
        assert {len(own.questions) for own in trials} == {3}
    assert {own.seconds for own in found.stimuli} == {20.0}
    assert found.seconds < 20 * 60


def test_each_example_says_what_the_paper_does_not():
    for name in EXAMPLES:
        text = example_text(name)
        assert "not stated" in text.lower()
        assert all(own in text for own in ("5.1.2", "4.2"))


def test_the_command_writes_a_plan_and_never_over_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert answer("study", "example", "Paper") == {"plan": "paper.toml"}
    assert (tmp_path / "paper.toml").read_text() == example_text("paper")
    (tmp_path / "pilot.toml").write_text("mine")
    refused(FAILED, "pilot.toml exists: move it away, or call this command in", "study", "example", "pilot")
    assert (tmp_path / "pilot.toml").read_text() == "mine"
    refused(MISUSED, "example must be one of paper, pilot, not 'papr'", "study", "example", "papr")
    assert "palpate study example" in run("study", "--help").output


def test_a_folder_that_takes_no_file_is_a_clear_error(tmp_path, monkeypatch):
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    refused(MISUSED, "pilot.toml cannot be written here: No such file or directory", "study", "example", "pilot")
