"""Tables and figures of chapter 4, from runs that are put together by hand, or by the controller itself."""

from __future__ import annotations

import csv
import itertools
import json
import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import tomli_w
from click.testing import CliRunner

from analysis.chapter4 import beside_the_dissertation, comparisons, held, levels, periods, report, two_by_two
from analysis.chapter4_compared import between_words, faster, of_medians, ratios
from analysis.chapter4_equal import at_equal_trials, means_of_checks
from analysis.chapter4_figures import marks_of, middle, shares_met
from analysis.chapter4_runs import read_arms
from coevo.complexity import Controller
from coevo.config import ComplexitySettings, check
from coevo.errors import InputError

STEP_S = (0.4, 0.2, 0.1)  # of each level
KEYS = [{"world.physics.step_s": list(STEP_S)}]
CURRICULUM = {
    "keys": KEYS,
    "first": 0,
    "raise_when": {"success": {"at_least": 0.5}},
    "window": 2,
    "patience": 3,
    "on_stall": ["grow", "raise", "stay"],
    "dimension": 1,
    "most_dimensions": 3,
}
TRIALS, LIMIT, STEPS = 10, 6000, 40
BLOCKS = (6, 4, 0, 0, 0, 0, 0, 5, 5, 9, 9)  # after 20 trials k = 2; after 70 it stalls, n = 2; after 90 k = 3; 110: end
RATES = ("success", "collisions", "failures", "timeouts")
COLUMNS = ("trial", "level", "dimension", "trials", "steps", *RATES, "games", *(f"greedy_{name}" for name in RATES))


class Study:
    """A folder of a study whose runs are made by the controller from given successes of each block."""

    def __init__(self, path) -> None:
        self.path, self.rows = path, []

    def add(self, arm, seed, successes, collided=(), **changes):  # noqa: ANN003 - settings of the curriculum
        controller = Controller(check(ComplexitySettings, {**CURRICULUM, **changes}, "mine"))
        blocks, events, seconds = [], [(0, "start", controller.level, controller.dimension, 0, 0.0)], 0.0
        for number, count in enumerate(successes, 1):
            seconds += STEPS * STEP_S[controller.level % len(STEP_S)]
            at = (TRIALS * number, controller.level, controller.dimension, TRIALS, STEPS)
            hits = collided[number - 1] if collided else 0
            blocks.append((*at, count, hits, 0, TRIALS - count - hits, 0, 0, 0, 0, 0))
            event = controller.observe({"success": (count, TRIALS), "collisions": (hits, TRIALS)})
            if event:
                told = (event.kind, event.level, event.dimension)
                events.append((TRIALS * number, *told, STEPS * number, seconds))
            if controller.ended:
                break
        if not controller.ended:
            events.append((blocks[-1][0], "end", controller.level, controller.dimension, STEPS * len(blocks), seconds))
        path = self.path / f"shooter-{arm}-seed{seed}"
        path.mkdir(parents=True)
        recipe = {"trials": LIMIT, "curriculum": {**CURRICULUM, **changes, "trials": TRIALS}}
        (path / "recipe.toml").write_text(tomli_w.dumps(recipe))
        write(path / "observations.csv", COLUMNS, blocks)
        write(path / "levels.csv", ("trial", "event", "level", "dimension", "steps", "seconds"), events)
        self.rows.append(("shooter", seed, arm, path.name, 0.5 + 0.1 * seed, 27))
        write(self.path / "table.csv", ("recipe", "seed", "arm", "run", "success_rate_in_view", "states"), self.rows)
        return controller, blocks[-1][0]

    def add_needing(self, arm, seed, trials):
        """Add a run at full speed that needs so many trials, or too many."""
        blocks = LIMIT // TRIALS if math.isinf(trials) else trials // TRIALS - 1
        self.add(arm, seed, [0] * blocks + [TRIALS] * (not math.isinf(trials)), first=2, dimension=3)


def write(path, header, rows):
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *rows])


@pytest.fixture
def study(tmp_path):
    return Study(tmp_path / "study")


def test_what_a_run_needed_is_when_the_controller_ended(study):
    rng = np.random.default_rng(3)
    expected = []
    for seed in range(30):
        drawn = rng.integers(0, rng.integers(4, TRIALS + 1), LIMIT // TRIALS, endpoint=True).tolist()
        expected.append(study.add("variable", seed, drawn))
    for run, (controller, trials) in zip(read_arms(study.path)["variable"], expected, strict=True):
        assert run.needed() == ((trials, trials) if controller.ended else (LIMIT, math.inf))
        assert run.needed("net")[0] == run.needed()[0] - 3 * 2 * TRIALS
        assert run.needed("steps")[0] == STEPS * trials // TRIALS
        assert run.needed("hours")[0] == pytest.approx(float(run.events[-1]["seconds"]) / 3600.0)
        for stay, after in itertools.pairwise(run.stays):
            moved = next(event for event in run.events if int(event["trial"]) == stay.ended)
            assert (stay.met == stay.ended) == (moved["event"] == "raised" and stay.last >= 0.5)
            assert math.isnan(stay.met) or after.level == stay.level + 1
    assert {controller.ended for controller, _ in expected} == {True, False}


def test_greedy_rates_count_in_trials_of_their_own(study):
    study.add("variable", 0, [9, 9, 9, 9, 9, 9])
    path = study.path / "shooter-variable-seed0" / "recipe.toml"
    path.write_text(path.read_text().replace("raise_when.success", "raise_when.greedy_success"))
    (run,) = read_arms(study.path)["variable"]
    assert math.isnan(run.met)  # no game was greedy
    for count, met in ((9, False), (10, True)):  # of 20 on each block of 10 trials; half of them is asked for
        blocks = run.blocks.assign(games=20, greedy_success=count)
        blocks.to_csv(study.path / "shooter-variable-seed0" / "observations.csv", index=False)
        assert (read_arms(study.path)["variable"][0].met == 60) == met


def test_steps_with_those_of_the_models_are_more_by_as_many(study):
    study.add_needing("n4", 0, 300)
    study.add_needing("variable", 0, 500)
    path = study.path / "table.csv"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0] + ",model_steps", *(f"{line},{STEPS * 100}" for line in lines[1:])]) + "\n")
    arms = read_arms(study.path)
    assert arms["n4"][0].needed("samples") == (STEPS * (30 + 100), STEPS * (30 + 100))
    header, (row,) = comparisons(arms)["comparisons"]
    assert dict(zip(header, row, strict=True))["with the models'"] == f"{150 / 130:.2f}"


def test_after_as_many_trials_runs_are_told_by_their_checks(study):
    rates = {("n4", 0): [0.1, 0.2, 0.5, 0.8], ("n4", 1): [0.3, 0.2, 0.7, 0.6]}
    rates |= {("full-speed-n4", 0): [0.2, 0.2, 0.4, 0.9], ("full-speed-n4", 1): [0.2, 0.6, 0.6, 0.4]}
    for (arm, seed), found in rates.items():
        study.add_needing(arm, seed, 300)
        rows = [(1500 * (n + 1), rate, 0.0, 1) for n, rate in enumerate(found)]
        write(study.path / f"shooter-{arm}-seed{seed}" / "checks.csv", ("trials", "in-view", "anywhere", "kept"), rows)
    study.add_needing("variable", 0, 300)  # not checked
    study.add_needing("stopped-n4", 0, 300)  # not to the end
    path = study.path / "shooter-stopped-n4-seed0" / "checks.csv"
    write(path, ("trials", "in-view", "anywhere", "kept"), [(1500, 0.9, 0.0, 1)])
    arms = read_arms(study.path)
    header, rows = at_equal_trials(arms)["at-equal-trials"]
    told = [dict(zip(header, row, strict=True)) for row in rows]
    assert [row["arm"] for row in told] == ["n4"] * 4 + ["full-speed-n4"] * 4
    assert [row["trials"] for row in told[:4]] == ["1,500", "3,000", "4,500", "6,000"]
    assert [row["greedy success"][:5] for row in told[:4]] == ["0.200", "0.200", "0.600", "0.700"]
    assert [row["above full-speed-n4"].split()[0] for row in told[:4]] == ["0.000", "-0.200", "0.100", "0.050"]
    assert [row["probability of more"][:4] for row in told[:4]] == ["0.50", "0.25", "0.75", "0.50"]
    means = means_of_checks(arms)
    assert means[means["arm"] == "n4"]["share"].tolist() == pytest.approx([0.2, 0.2, 0.6, 0.7])
    assert at_equal_trials({"variable": arms["variable"]}) == {}


def test_levels_and_axes_are_told_where_they_were(study):
    for seed in range(2):
        study.add("variable", seed, BLOCKS)
    arms = read_arms(study.path)
    table = [dict(zip(levels(arms)["levels"][0], row, strict=True)) for row in levels(arms)["levels"][1]]
    assert [(row["k"], row["came"], row["met"], row["after trials"], row["trials there"]) for row in table] == [
        ("1", "2", "2", "0", "20"),
        ("2", "2", "2", "20", "70"),
        ("3", "2", "2", "90", "20"),
    ]
    assert [row["success at first"][:5] for row in table] == ["0.500", "0.000", "0.900"]
    assert periods(arms)["weak-critical-periods"][1] == [["variable", "1 to 2", "2 of 2", "2: 2", "70"]]
    marks = marks_of(arms["variable"][0])
    assert marks.to_numpy().tolist() == [[20, "2", "level"], [70, "n = 2", "axis"], [90, "3", "level"]]


DEFENDER = {
    "keys": [{"mover.speed": [k / 10 for k in range(11)]}],
    "raise_when": {"success": {"at_least": 0.5}, "collisions": {"at_most": 0.1}},
    "window": 1,
}


def test_the_defender_is_told_with_collisions_and_its_levels_count_from_zero(study):
    # A block a level; at k = 4 two, the first of which has too many collisions, and at k = 10 too.
    hits = [0, 1, 0, 0, 4, 1, 0, 0, 0, 0, 0, 6, 1]
    study.add("n4", 0, [5, 6, 7, 8, 6, 5, 9, 9, 9, 9, 9, 2, 8], hits, **DEFENDER)
    study.add("n4", 1, [5, 5, 5, 5, 3, 2, 2], [0, 0, 0, 0, 5, 4, 3], **DEFENDER)
    arms = read_arms(study.path)
    assert arms["n4"][0].met == 130
    assert math.isnan(arms["n4"][1].met)
    header, rows = levels(arms)["levels"]
    told = [dict(zip(header, row, strict=True)) for row in rows]
    assert [row["k"] for row in told] == [str(k) for k in range(11)]
    assert [(row["came"], row["met"]) for row in told[3:6]] == [("2", "2"), ("2", "1"), ("1", "1")]
    assert told[10]["collisions at last"] == "0.100"
    header, (row,) = held(arms)["held"]
    told = dict(zip(header, row, strict=True))
    assert (told["k: runs"], told["trials until then"]) == ("3: 1, 10: 1", "85")  # after 40 and 130
    header, rows = beside_the_dissertation(arms)["success-and-collisions"]
    four, ten = (dict(zip(header, row, strict=True)) for row in rows)
    assert (four["k"], four["came"], four["success"][:5], four["collisions"][:5]) == ("4", "2", "0.350", "0.200")
    assert (four["more collisions"], four["dissertation"]) == ("1 of 2", "0.385 and 0.147")
    assert (ten["k"], ten["came"], ten["success"], ten["collisions"]) == ("10", "1", "0.800", "0.100")
    assert marks_of(arms["n4"][0])["name"].tolist() == [str(k) for k in range(1, 11)]
    said = CliRunner().invoke(report, [str(study.path)], catch_exceptions=False)
    assert said.exit_code == 0
    words = (study.path / "report" / "figure-4-8-n4.svg").read_text()
    assert "collisions" in words
    assert "success" in words


def test_of_the_shooter_nothing_is_told_about_collisions(study):
    study.add("n4", 0, BLOCKS)
    arms = read_arms(study.path)
    assert beside_the_dissertation(arms) == held(arms) == {}
    assert "collisions at last" not in levels(arms)["levels"][0]


def test_the_2_x_2_finds_the_factors_that_it_was_made_of(study):
    wide = np.array([100, 200, 300, 400])  # of a seed: it cancels out
    for seed, times in enumerate(wide):
        for has_levels, grows in itertools.product((0, 1), (0, 1)):
            arm = ("" if has_levels else "full-speed-") + ("variable" if grows else "n4")
            study.add_needing(arm, seed, int(times * 2**has_levels * 3**grows * (2.5 if has_levels and grows else 1)))
    rows = {row[0]: row for row in two_by_two(read_arms(study.path))["two-by-two"][1]}
    factors = {"levels": 2 * 2.5**0.5, "growing axes": 3 * 2.5**0.5, "both, beyond the two": 2.5}
    for effect, factor in factors.items():
        assert rows[effect][2:5] == ["4", f"{factor:.2f}", f"{factor:.2f} [{factor:.2f}, {factor:.2f}]"]


def test_arms_are_compared_within_seeds_and_those_that_one_lacks_are_left_out(study):
    first, second = [800, 1200, 500], [400, 300, 500, 700]
    for seed, trials in enumerate(first):
        study.add_needing("variable", seed, trials)
    for seed, trials in reversed(list(enumerate(second))):
        study.add_needing("n4", seed, trials)
    header, (row, *others) = comparisons(read_arms(study.path))["comparisons"]
    assert not others
    told = dict(zip(header, row, strict=True))
    logs = np.log([2.0, 4.0, 1.0])
    half = 4.302653 * logs.std(ddof=1) / math.sqrt(3)  # Student's t with two degrees of freedom
    expected = np.exp([logs.mean(), logs.mean() - half, logs.mean() + half])
    assert told["arms"] == "variable / n4"
    assert (told["sets"], told["trials"]) == ("3", "2.00")
    assert told["geometric mean"] == "{:.2f} [{:.2f}, {:.2f}]".format(*expected)


def test_whatever_endless_runs_would_have_needed_is_within_what_is_said(study):
    first = [300, math.inf, 700, math.inf, 900, 1100, 500, 400]
    second = [300, 900, math.inf, math.inf, 200, 500, 600, 700]
    for arm, needed in (("variable", first), ("n4", second)):
        for seed, trials in enumerate(needed):
            study.add_needing(arm, seed, trials)
    arms = read_arms(study.path)
    found = ratios({"variable": 1.0, "n4": -1.0}, arms, "trials")
    least, most, low, high = of_medians(found)
    rng = np.random.default_rng(1)
    medians, ends = [], []
    for _ in range(500):
        x, y = (
            np.array([LIMIT * 10 ** rng.uniform(0, 6) if math.isinf(one) else one for one in needed])
            for needed in (first, second)
        )
        ratio = np.sort(x / y)
        medians.append(np.median(ratio))
        ends.append((ratio[0], ratio[-1]))  # for eight values the first and the last
    assert least <= min(medians) <= max(medians) <= most
    assert low <= min(end for end, _ in ends)
    assert high >= max(end for _, end in ends)
    assert between_words((least, most, low, high)) == f"{least:.2f} to {most:.2f}"
    pairs = [
        0.5 if x == y or (math.isinf(x) and math.isinf(y)) else float(x < y) for x in first for y in second
    ]  # endless ones are equal
    assert faster(arms["variable"], arms["n4"])[0] == pytest.approx(np.mean(pairs))


def test_medians_of_what_never_ended_are_open_upwards():
    assert between_words(of_medians(np.array([[600.0, math.inf]] * 6)), 0) == "> 600 [600, ...]"
    assert between_words(of_medians(np.array([[200.0, 200.0], [600.0, math.inf]])), 0) == "> 400"
    assert between_words(of_medians(np.array([[0.0, math.inf]])), 2) == "?"
    assert between_words(of_medians(np.array([[0.0, 2.0]])), 2) == "< 2.00"


def test_the_command_writes_tables_and_figures_of_a_study_under_way(study):
    for seed, trials in enumerate((300, 500, 400, math.inf)):
        study.add_needing("n4", seed, trials)
    study.add("variable", 0, BLOCKS)
    said = CliRunner().invoke(report, [str(study.path), "--json"], catch_exceptions=False)
    tables = json.loads(said.stdout)["tables"]
    assert [(row["arm"], row["sets"], row["met"], row["trials"]) for row in tables["in-all"]] == [
        ("n4", "4", "3", "450"),
        ("variable", "1", "1", "110"),
    ]
    assert [row["success rate in view"] for row in tables["at-the-end"]][1] == "0.500"
    for name in ("figure-4-5-n4.svg", "figure-4-6-variable.svg", "shares-met.svg"):
        ET.parse(study.path / "report" / name)  # noqa: S314 - our own file
    arms = read_arms(study.path)
    assert middle(arms["n4"]).seed == 2
    stairs = shares_met(arms)
    assert stairs[stairs["arm"] == "n4"]["share"].tolist() == [0, 0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75]
    assert stairs[stairs["arm"] == "n4"]["trial"].tolist() == [0, 300, 300, 400, 400, 500, 500, LIMIT]


def test_a_folder_without_such_runs_is_refused(study):
    with pytest.raises(InputError, match="holds no finished run of a study; run 'coevo study' first"):
        read_arms(study.path)
    study.add("n4", 0, [9] * 6)
    path = study.path / "shooter-n4-seed0"
    (path / "levels.csv").unlink()
    with pytest.raises(InputError, match="is damaged"):
        read_arms(study.path)
    (path / "recipe.toml").write_text("trials = 4\n")
    with pytest.raises(InputError, match=r"its recipe has no \[curriculum\]"):
        read_arms(study.path)
