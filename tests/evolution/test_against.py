"""Teams frozen from a finished run: who is met, that it needs that run no more, and what is refused."""

from __future__ import annotations

import shutil

import msgspec
import numpy as np
import pytest

from coevo.config import read_toml
from coevo.evolution.grouping import FROZEN, groups_of
from coevo.evolution.opponents import with_opponents
from coevo.game import Arena, programs_of
from coevo.run import create_run, open_run
from coevo.tree import parse

COUNTS = ["goals", "lost", "kicks", "collisions", "steps", "passes", "own_goals"]


@pytest.fixture(scope="module")
def meeting(small_settings, small_run):
    """Return settings in which half of the games are against the champions of the small run."""
    half = ("evaluation.grouping=partners", "evaluation.partners=2", "evaluation.against_share=0.5")
    return small_settings(*half, f"evaluation.against={small_run.path}", "seed=5")


@pytest.fixture(scope="module")
def run(meeting, go_on, tmp_path_factory):
    return go_on(create_run(tmp_path_factory.mktemp("against") / "run", with_opponents(meeting)))


def test_every_individual_meets_the_champions_of_the_other_team_in_games_of_its_own(run, small_run):
    """Each game is played again alone: members from the run folder, opponents from the other one."""
    champions = [small_run.tree(f"r{role}", 2) for role in range(3)]
    arena, total = Arena(run.config), {}
    for generation in range(3):
        trees = {
            f"r{role}": dict(zip(rows["index"], [run.tree(f"r{role}", generation, k) for k in range(6)], strict=True))
            for role in range(3)
            for rows in [run.record(generation, f"r{role}")]
        }
        groups = groups_of(run.config, run.game.roles, generation)
        assert len(groups) == 6 + 2 * 6
        for group in range(len(groups)):
            members = groups.members[group].tolist()
            team = [trees[f"r{k}"][m] if m >= 0 else champions[k] for k, m in enumerate(members)]
            assert [m < 0 for m in members] == (groups.guests[group] == FROZEN).tolist()
            for seed in groups.seeds(5, generation, group):
                counts = run.game.played(arena.play(programs_of(run.game, team), np.array([seed]))).counts
                for role in np.flatnonzero(groups.counts[group]):
                    one = total.setdefault((generation, f"r{role}", members[role]), dict.fromkeys(COUNTS, 0))
                    for name in COUNTS:
                        one[name] += int(counts[name][0, role])
    table = run.individuals.set_index(["generation", "robot", "index"])
    assert {key: table.loc[key, COUNTS].to_dict() for key in table.index} == total


def test_a_stopped_run_goes_on_and_is_repeated_without_the_other_folder(
    run, meeting, small_run, go_on, results_of, coevo, tmp_path
):
    other = shutil.copytree(small_run.path, tmp_path / "other")
    evaluation = msgspec.structs.replace(meeting.evaluation, against=str(other))
    settings = msgspec.structs.replace(meeting, evaluation=evaluation)
    stopped = create_run(tmp_path / "stopped", with_opponents(settings))
    shutil.rmtree(other)

    def kill(report):
        if report.generation == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        go_on(stopped, report=kill)
    (stopped.path / "checkpoint.npz").unlink()
    go_on(open_run(stopped.path), workers=2)
    assert results_of(stopped.path) == results_of(run.path)
    champions = {f"r{role}": str(small_run.tree(f"r{role}", 2)) for role in range(3)}
    assert read_toml(run.path / "config.toml")["evaluation"]["against"] == champions
    again = coevo("evolve", run.path / "config.toml", "--out", tmp_path / "again", "--unseen", 0)
    assert again.code == 0, again.err
    assert results_of(tmp_path / "again") == results_of(run.path)
    shown = coevo("play", run.path, "--generation", 2, "--group", 17, "--json")
    assert shown.code == 0, shown.err


def test_the_command_takes_a_folder(coevo, copied_run, small_run, tmp_path):
    words = ["evolve", small_run.path / "config.toml", "--set", f"evaluation.against={copied_run}"]
    said = coevo(*words, "--generations", 1, "--unseen", 0, "--out", tmp_path / "run")
    assert said.code == 0, said.err
    made = open_run(tmp_path / "run")
    assert parse(made.config.evaluation.against["r2"], made.game.function_set(2)) == small_run.tree("r2", 2)
    groups = groups_of(made.config, made.game.roles, 0)
    assert ((groups.guests == FROZEN).any(axis=1)).all()  # without a share all games are against them


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (("evaluation.against=absent",), ["evaluation.against: expected the folder of a finished run", "absent"]),
        (("evaluation.against=UNFINISHED",), ["is not finished; bring it to its end with 'coevo resume"]),
        (("evaluation.against=OTHER", "players.2.control=stationary"), ["two teams evolve, but only r0, r1 do"]),
        (("evaluation.against=OTHER", "skills.shoot=", "skills.pass="), ["evaluation.against.r", "unknown name"]),
        (("evaluation.against={ r0 = 'shoot', r2 = 'shoot' }",), ["for each robot that evolves (r0, r1, r2)"]),
        (("evaluation.against={ r0 = 'shoot', r1 = 'shout', r2 = 'shoot' }",), ["against.r1: unknown name 'shout'"]),
        (("evaluation.against=3",), ["evaluation.against"]),
        (("evaluation.against_share=1.5",), ["evaluation.against_share"]),
    ],
)
def test_opponents_that_cannot_be_met_are_refused_before_anything_is_made(
    change, parts, coevo, copied_run, small_run, tmp_path
):
    unfinished = shutil.copytree(copied_run, tmp_path / "unfinished")
    (unfinished / "individuals.parquet" / "part-00002.parquet").unlink()
    (unfinished / "checkpoint.npz").unlink()
    sets = [word.replace("OTHER", str(copied_run)).replace("UNFINISHED", str(unfinished)) for word in change]
    options = [part for word in sets for part in ("--set", word)]
    said = coevo("evolve", small_run.path / "config.toml", *options, "--out", tmp_path / "run")
    assert (said.code, said.out) == (2, "")
    assert "Traceback" not in said.err
    for part in parts:
        assert part in said.err
    assert not (tmp_path / "run").exists()
