"""What is missing, against a count by hand of every row that recipes want."""

import itertools

import pytest
from sweep_stand_ins import Memory, StandIn, count_poses, rows_wanted

from palpate.render.sweeps.make.unit import CHUNK_POSES
from palpate.render.sweeps.run.missing import Missing

GROUPS = ("contours", "frequency", "sampling")
RECIPES = [
    StandIn(thing, motion, sampling, poses=poses)
    for thing, motion, sampling, poses in itertools.product(
        ("cube", "tube"), ("1", "2"), ("stm", "slow"), (1000, CHUNK_POSES * 2 + 7)
    )
]


def all_rows(recipes, groups=GROUPS):
    return {row for recipe in recipes for group in groups for row in rows_wanted(recipe, group)}


def given_rows(missing):
    return [
        (result.key[0], result.key[1], chunk.chunk.number)
        for chunks in missing.places()
        for chunk in chunks
        for result in chunk.results
    ]


def missing_of(recipes, memory, shard=(0, 1), groups=GROUPS):
    return Missing(recipes, groups, done=memory.done, pose_count=count_poses, shard=shard)


@pytest.mark.parametrize("every", [1, 2, 3, 5])
def test_each_row_that_is_missing_is_given_once(every):
    memory = Memory()
    memory.rows = dict.fromkeys(sorted(all_rows(RECIPES))[::every], 1) if every > 1 else {}
    rows = given_rows(missing_of(RECIPES, memory))
    assert len(rows) == len(set(rows))
    assert set(rows) == all_rows(RECIPES) - set(memory.rows)


def test_counts_are_those_of_a_count_by_hand():
    counts = missing_of(RECIPES, Memory()).counts
    assert (counts.recipes, counts.done, counts.failed) == (16, 0, 0)
    assert counts.poses == counts.poses_incomplete == sum(recipe.poses for recipe in RECIPES)
    renderings = {recipe.key("contours"): recipe.poses for recipe in RECIPES}
    assert (counts.renderings, counts.poses_once) == (len(renderings), sum(renderings.values()))


def test_chunks_of_one_place_come_together_family_by_family():
    places = list(missing_of(RECIPES, Memory()).places())
    assert all(len({chunk.place for chunk in chunks}) == 1 for chunks in places)
    families = [chunks[0].family for chunks in places]
    assert len([family for family, _ in itertools.groupby(families)]) == len(set(families)) == 4


def test_shards_share_all_rows_and_none_twice():
    every = [given_rows(missing_of(RECIPES, Memory(), (k, 3))) for k in range(3)]
    assert sorted(row for rows in every for row in rows) == sorted(all_rows(RECIPES))
    assert all(every)


def test_a_recipe_of_other_shards_is_neither_done_nor_failed():
    missing = missing_of(RECIPES, Memory(), (0, 3))
    for chunks in missing.places():
        for chunk in chunks:
            missing.settle(chunk)
    counts = missing.counts
    assert counts.done + counts.left == counts.recipes
    assert counts.left > 0


def test_a_result_that_cannot_be_made_fails_every_recipe_that_needs_it_under_its_own_name():
    recipes = [StandIn(array=array, poses=10) for array in ("emulator", "pat16")]  # they share contours
    missing = missing_of(recipes, Memory(), groups=("contours",))
    ((chunk,),) = missing.places()
    missing.give_up(chunk, "no")
    assert [(own.name, own.sentence) for own in missing.failures] == [(recipe.title, "no") for recipe in recipes]
    assert missing.counts.failed == 2


def test_a_result_that_is_there_although_its_unit_failed_is_no_failure():
    memory, recipe = Memory(), StandIn(poses=10)
    missing = missing_of([recipe], memory, groups=("contours",))
    ((chunk,),) = missing.places()
    memory.rows = dict.fromkeys(all_rows([recipe], ("contours",)), 1)
    missing.give_up(chunk, "no")
    assert (missing.failures, missing.counts.done) == ([], 1)


def test_the_last_chunk_has_what_is_left():
    recipe = StandIn(poses=CHUNK_POSES * 2 + 7)
    places = list(missing_of([recipe], Memory(), groups=("contours",)).places())
    assert [chunks[0].pose_count for chunks in places] == [CHUNK_POSES, CHUNK_POSES, 7]
