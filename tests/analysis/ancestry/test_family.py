"""The tables behind the pictures, the pictures, and what is said."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.ancestry import ancestors, family_table, link_table, origin_table, sentences, summary
from analysis.ancestry.charts import ancestry_chart, family_chart, origin_chart
from analysis.ancestry.inheritance import ancestry_of
from analysis.charts import chart_bytes

STEPS = np.array([100, 60, 60, 0, 40, 0, 40])


@pytest.fixture
def found(known, known_functions):
    return ancestry_of(known, "r0", 0, known_functions, node_steps=STEPS)


@pytest.fixture
def small_changes(changed_in_small, known_functions):
    return ancestry_of(changed_in_small, "r0", 0, known_functions, node_steps=np.array([100, 60, 40]))


@pytest.fixture(scope="module")
def families(busy_run):
    last = busy_run.finished - 1
    return [ancestors(busy_run, robot, last, index) for robot in busy_run.evolving.values() for index in range(10)]


# --------------------------------------------------------------------------------------------------------- tables


def test_the_family_of_a_known_tree_has_its_places(found):
    family = family_table(found)
    members = dict(zip(zip(family["generation"], family["index"], strict=True), family["lane"], strict=True))
    root = {(generation, 0): 0 for generation in range(4)}
    # (0, 1) gave to the root line before the mutated line had begun: one lane is enough for both.
    assert members == {**root, (2, 1): 1, (1, 1): 1, (0, 1): 1}
    assert family["share"].to_numpy() == pytest.approx(np.array([1, 3, 4, 3, 4, 3, 7]) / 7)


def test_the_links_of_a_known_tree(found):
    links = link_table(family_table(found))
    columns = ["generation", "index", "index_parent", "came", "is_root"]
    assert sorted(links[columns].to_numpy().tolist()) == [
        [1, 0, 0, 1, True],
        [1, 0, 1, 3, False],
        [2, 0, 0, 4, True],
        [2, 1, 1, 3, False],
        [3, 0, 0, 4, True],
        [3, 0, 1, 3, False],
    ]


def test_nobody_stands_or_passes_where_another_stands(families):
    """A place is one ancestor's, and no line along a lane goes through a point that is not its end."""
    for one in families:
        family = family_table(one)
        assert not family.duplicated(["generation", "lane"]).any()
        assert (family["root_line"] == (family["lane"] == 0)).all()
        assert set(family["lane"]) == set(range(family["lane"].max() + 1))
        kept = one.ancestors["carried"].gt(0) | one.ancestors["root_line"]
        assert len(family) == kept.sum()


def test_links_join_children_to_parents_that_handed_something_down(families):
    for one in families:
        family = family_table(one)
        links, places = link_table(family), family.set_index(["generation", "index"])
        assert (links["generation"] - links["generation_parent"] == 1).all()
        for end in ("", "_parent"):
            at = list(zip(links[f"generation{end}"], links[f"index{end}"], strict=True))
            assert links[f"lane{end}"].tolist() == places.loc[at, "lane"].tolist()
        came = links.groupby(["generation", "index"])["came"].sum()
        inherited = (family["from_1"] + family["from_2"])[family["generation"] > 0]
        assert came.sum() == inherited.sum()
        assert links["is_root"].sum() == one.generation
        assert (links["came"].gt(0) | links["is_root"]).all()


def test_origins_are_counted_with_their_use(found, known, known_functions):
    assert origin_table(found).to_numpy().tolist() == [
        [0, "creation", "in use", 3],
        [0, "creation", "never used", 1],
        [1, "mutation", "in use", 2],
        [1, "mutation", "never used", 1],
    ]
    unknown = origin_table(ancestry_of(known, "r0", 0, known_functions))
    assert unknown.to_numpy().tolist() == [[0, "creation", "not counted", 4], [1, "mutation", "not counted", 3]]


# --------------------------------------------------------------------------------------------------------- charts


@pytest.mark.parametrize("generation", [0, 1, 3])
def test_pictures_can_be_made_of_any_generation(generation, known, known_functions):
    one = ancestry_of(known[: generation + 1], "r0", 0, known_functions)
    for chart in (family_chart(one), origin_chart(one), ancestry_chart(one)):
        picture = chart_bytes(chart, ".svg").decode()
        assert f"individual 0 of generation {generation}" in picture


def test_a_picture_has_a_point_for_each_ancestor_and_a_line_for_each_link(families):
    for one in families[::7]:
        picture = chart_bytes(family_chart(one), ".svg").decode()
        family = family_table(one)
        assert picture.count('aria-roledescription="circle"') == len(family)
        assert picture.count('aria-roledescription="rule mark"') == len(link_table(family))


# ---------------------------------------------------------------------------------------------------------- words


def test_a_summary_of_a_known_ancestry(found):
    told = summary(found)
    assert told["origins"] == [
        {"generation": 0, "operator": "creation", "nodes": 4, "in_use": 3, "use": pytest.approx(220 / 300)},
        {"generation": 1, "operator": "mutation", "nodes": 3, "in_use": 2, "use": pytest.approx(80 / 300)},
    ]
    assert told["operators"] == {"crossover": 2, "mutation": 1}
    assert told["last_change"] == {
        "generation": 3,
        "operator": "crossover",
        "from_parent_1": 4,
        "from_parent_2": 3,
        "new": 0,
    }
    assert [member["carried"] for member in told["root_line"]] == [1, 4, 4, 7]
    assert (told["nodes"], told["in_use"], told["depth"], told["fitness"]) == (7, 5, 2, 2.0)
    assert (told["ancestors"], told["contributing"]) == (6, 6)


def test_what_is_said_of_a_known_ancestry(found):
    line = "Its root line went through 2 crossovers and 1 mutation, from fitness 9.000 to 2.000"
    assert sentences(summary(found)) == [
        "r0's best of generation 3 has 7 nodes: 4 from generation 0 and 3 from mutations (3 in generation 1).",
        "5 nodes were in use: 3 from generation 0 and 2 from mutations (2 in generation 1).",
        "It came about by crossover in generation 3: 4 nodes of its first parent and 3 of the second.",
        f"{line} (best 2.000, in generation 3).",
        "It has 6 ancestors; of 6 of them something is left.",
    ]


def test_nodes_that_a_crossover_child_got_by_small_changes_are_told_and_drawn(small_changes):
    """The tree of generation 1 has one node of each parent, and one that neither had."""
    told = sentences(summary(small_changes))
    assert told[0] == (
        "r0's best of generation 1 has 3 nodes: 2 from generation 0 and 1 from small changes after crossovers"
        " (1 in generation 1)."
    )
    assert told[2] == (
        "It came about by crossover in generation 1: 1 node of its first parent, 1 of the second and 1 new by small"
        " changes."
    )
    drawn = origin_chart(small_changes).to_dict()["layer"][0]
    assert set(drawn["encoding"]["color"]["scale"]["domain"]) == {
        "creation, in use",
        "crossover, in use",
    }


def test_all_that_arose_later_is_told_where_nothing_is_left_of_the_first(found):
    told = summary(found)
    origins = [{"generation": 2, "operator": "crossover", "nodes": 7, "in_use": 5, "use": 1.0}]
    said = sentences({**told, "origins": origins})
    assert (
        said[0] == "r0's best of generation 3 has 7 nodes: 7 from small changes after crossovers (7 in generation 2)."
    )


def test_every_node_of_a_tree_has_a_colour_in_the_picture(families):
    """A kind that is not in the domain of the colours is not drawn."""
    for one in families:
        table, drawn = origin_table(one), origin_chart(one).to_dict()["layer"][0]
        assert set(drawn["encoding"]["color"]["scale"]["domain"]) == {
            kind.removesuffix(", not counted") for kind in table["operator"] + ", " + table["use"]
        }


@pytest.mark.parametrize(
    ("generation", "index", "expected"),
    [
        (0, 0, "It was created in generation 0."),
        (1, 1, "It came about by mutation in generation 1, which put 3 new nodes to 4 inherited."),
        (1, 2, "It was created in generation 0, and was copied as it is since: nothing in generation 1 is new."),
        (2, 2, "It was created in generation 0, and was copied as it is since: nothing in generation 2 is new."),
    ],
)
def test_what_is_said_of_the_last_step(generation, index, expected, known, known_functions):
    found = summary(ancestry_of(known[: generation + 1], "r0", index, known_functions))
    assert expected in sentences(found)
    assert sentences(found, 2)[0].startswith(f"r0's rank 2 of generation {generation} has ")
