"""What a dry run makes to know what a sweep costs."""

from palpate.render.sweeps.make import work
from palpate.render.sweeps.make.poses import pose_count
from palpate.render.sweeps.make.task import Outcome
from palpate.render.sweeps.plan.loading import load_plans
from palpate.render.sweeps.plan.recipe import Recipe
from palpate.render.sweeps.run.estimate import estimate
from palpate.render.sweeps.run.missing import Missing

PLAN = """
metrics = ["contours", "noise", "pressure"]
[object]
source = ["cube", "tube", "sphere"]
[motion]
duration = 30.0
explorer = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]
[strategy]
source = ["oc", "cc", "hatch"]
"""


def test_noise_and_pressure_are_sampled_in_few_families_and_every_family_is_loaded(tmp_path, monkeypatch):
    made = []

    def note(task, device, *, worker):
        made.extend((chunk.groups, chunk.recipe) for chunk in task.chunks)
        return Outcome(task.number, worker, seconds=2.0 if "noise" in task.chunks[0].groups else 0.1)

    monkeypatch.setattr(work, "run_task", note)
    (tmp_path / "plan.toml").write_text(PLAN)
    plan = load_plans([tmp_path / "plan.toml"])
    missing = Missing(plan.recipes(), plan.groups, done=lambda keys: {}, pose_count=pose_count)
    found = estimate(plan, missing, tmp_path, devices=["cpu", "cpu"])
    assert (found.recipes, found.families) == (90, 18)  # contours, and noise with pressure, of nine scenes
    scenes = {(Recipe.from_json(text).thing["name"], Recipe.from_json(text).strategy["name"]) for _, text in made}
    assert len(scenes) == 9
    slow = [text for groups, text in made if "noise" in groups]
    assert len(slow) <= 1 + 2 * 9
    assert max(Recipe.from_json(text).motion["duration"] for text in slow) < 2.0  # [s], of 30
    assert sum("noise" in groups for groups, _ in made[:18]) == 1  # the first shows whether noise can be made
