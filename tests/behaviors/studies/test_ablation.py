import itertools

import msgspec

from behaviors.recipe import read_recipe
from behaviors.studies.ablation import LITERAL, steps_of


def test_each_change_changes_something_and_the_last_is_the_installed_recipe():
    literal, installed = read_recipe(LITERAL), read_recipe("shoot")
    recipes = [recipe for _, recipe in steps_of(literal, installed)]
    assert recipes[0] == literal
    assert all(one != other for one, other in itertools.pairwise(recipes))
    assert msgspec.structs.replace(recipes[-1], name="shoot", seed=installed.seed) == installed
