"""Learning in a study: the folder and the numbers of ``coevo learn``, however often it was stopped."""

from __future__ import annotations

import json

import pandas as pd
import pytest
import tomli_w

from behaviors.studies.learning import SkillRuns
from coevo.errors import InputError
from coevo.skill import load_skill
from coevo.soundness import check_skill
from coevo.study import cores
from coevo.study.plan import read_plan
from coevo.study.task import LeftError, do

STUDY = """
kind = "study"
recipes = ["search", "quick.toml"]
seeds = [1]

[set]
trials = 500
"experience.windows" = 300
"learning.check_games" = 20

[vary]
time_limit_steps = [200, 300]
"""
QUICK = 'kind = "skill"\nname = "quick"\ntask = "search"\n[[objects]]\nkind = "ball"\norder = 2\nhistory_length = 2\n'


@pytest.fixture
def study_file(tmp_path):
    (tmp_path / "quick.toml").write_text(QUICK)
    path = tmp_path / "learn.toml"
    path.write_text(STUDY)
    return path


def test_recipes_of_skills_are_read_by_name_and_as_files(study_file):
    plan = read_plan(str(study_file))
    assert [run.name for run in plan.runs] == [
        f"{recipe}-time_limit_steps{steps}-seed1" for recipe in ("search", "quick") for steps in (200, 300)
    ]
    assert {run.condition.kind for run in plan.runs} == {"skill"}
    assert [run.settings.time_limit_steps for run in plan.runs] == [200, 300, 200, 300]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("trials = 500", "trails = 500", "unknown setting 'trails'. Did you mean 'trials'?"),
        ('"search"', '"serch"', "no recipe 'serch'. Did you mean 'search'?"),
        ("trials = 500", 'trials = 500\nmover = { kind = "skill", skill = "shot" }', "no installed skill 'shot'"),
    ],
)
def test_wrong_learnings_are_refused_before_anything_is_made(old, new, said, study_file, coevo, tmp_path):
    study_file.write_text(STUDY.replace(old, new))
    found = coevo("study", study_file, "--out", tmp_path / "out")
    assert found.code == 2
    assert said in found.err
    assert not (tmp_path / "out").exists()


def test_a_row_is_the_card_of_coevo_learn_and_a_stopped_learning_ends_alike(study_file, coevo, tmp_path, monkeypatch):
    monkeypatch.setattr(cores, "on_cores", lambda tasks, _: map(do, tasks))
    study_file.write_text(STUDY.replace('"search", ', "").replace("[200, 300]", "[300]"))
    assert coevo("study", study_file, "--out", tmp_path / "out", "--quiet").code == 0
    table = pd.read_csv(tmp_path / "out" / "table.csv")
    folder = tmp_path / "out" / "quick-time_limit_steps300-seed1"
    said = coevo("learn", folder / "recipe.toml", "--out", tmp_path / "alone", "--json", "--quiet")
    card = json.loads(said.out)
    row = table.iloc[0]
    assert row["recipe"] == "quick"
    assert row["success_rate_in_view"] == card["measured"]["in-view"]["success_rate"]
    assert row["collision_rate_in_view"] == card["measured"]["in-view"]["collision_rate"]
    assert row["states"] == card["states"] == 3**2 + 2
    for name in ("skill.npz", "recipe.toml", "card.json"):
        assert (tmp_path / "alone" / name).read_bytes() == (folder / name).read_bytes()

    settings, kind, stopped = read_plan(str(study_file)).runs[0].settings, SkillRuns(), tmp_path / "stopped"

    def unwanted():
        raise LeftError

    with pytest.raises(LeftError):
        kind.run(settings, stopped, (), unwanted)
    assert [path.name for path in stopped.iterdir()] == ["learning.npz"]
    assert not kind.is_whole(stopped, settings)
    kind.run(settings, stopped, (), lambda: None)
    assert sorted(path.name for path in stopped.iterdir()) == ["card.json", "recipe.toml", "skill.npz"]
    for path in stopped.iterdir():
        assert path.read_bytes() == (folder / path.name).read_bytes()


GROWING = """
[curriculum]
keys = [{ "world.robot.max_turn_rate_dps" = [60.0, 120.0] }]
raise_when.success.at_least = 1.0
trials = 50
window = 1
patience = 1
grow = ["ball"]
dimension = 1
most_dimensions = 2
"""


def test_a_row_tells_how_far_a_curriculum_came_and_a_stopped_one_ends_alike(study_file, tmp_path):
    path = tmp_path / "quick.toml"
    path.write_text(QUICK + GROWING)
    study_file.write_text(STUDY.replace('"search", ', "").replace("[200, 300]", "[300]"))
    settings, kind = read_plan(str(study_file)).runs[0].settings, SkillRuns()
    row = kind.run(settings, tmp_path / "whole", (), lambda: None)
    told = json.loads((tmp_path / "whole" / "card.json").read_text())["curriculum"]
    assert [row[name] for name in ("trials", "level", "dimension")] == [
        told[n] for n in ("trials", "level", "dimension")
    ]
    assert row["met"] == int(told["met"])
    assert row["states"] == 3 ** row["dimension"] + 2
    assert row["model_steps"] == told["model_steps"] >= 300  # windows

    def unwanted():
        raise LeftError

    for _ in range(3):
        with pytest.raises(LeftError):
            kind.run(settings, tmp_path / "stopped", (), unwanted)
    assert kind.run(settings, tmp_path / "stopped", (), lambda: None) == row
    names = {path.name for path in (tmp_path / "whole").iterdir()}
    assert names == {"card.json", "checks.csv", "levels.csv", "observations.csv", "recipe.toml", "skill.npz"}
    for name in names:
        assert (tmp_path / "stopped" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()

    checked = {"learning.check_every": 100, "learning.check_from": 0.0, "curriculum.at_the_top": "stay"}
    study_file.write_text(study_file.read_text().replace("[vary]", tomli_w.dumps(checked) + "[vary]"))
    settings = read_plan(str(study_file)).runs[0].settings
    kind.run(settings, tmp_path / "checked", (), lambda: None)
    checks = pd.read_csv(tmp_path / "checked" / "checks.csv")
    assert checks["trials"].tolist() == [100, 200, 300, 400, 500]
    assert checks["in-view"].between(0, 1).all()
    kept = checks[checks["kept"] == 1]
    assert kept["trials"].iloc[-1] == load_skill(tmp_path / "checked" / "skill.npz").about["kept_after_trials"]
    assert check_skill(tmp_path / "checked")[-1].state == "sound"
    (tmp_path / "checked" / "checks.csv").write_text("trials,in-view\n100,1.0\n")
    assert "damaged" in {finding.state for finding in check_skill(tmp_path / "checked")}

    path.write_text(QUICK + GROWING.replace("dimension = 1", "dimension = 1\nfirst = 7"))
    with pytest.raises(InputError, match="first: expected a level from 0 to 1"):
        read_plan(str(study_file))
    path.write_text(QUICK + GROWING.replace("success", "sucess"))
    with pytest.raises(InputError, match="nobody measures a rate 'sucess'"):
        read_plan(str(study_file))
