"""What a report says is what functions give whose results are tested elsewhere, and it is safe to open."""

from __future__ import annotations

import html
import json
import re

import numpy as np
import pytest

from analysis.report import make_report
from analysis.report.page import render
from analysis.report.parts import Code, Figure, Heading, Picture, Player, Points, Section, Short, Table, Text
from analysis.report.several import compare
from analysis.report.words import compared as compared_in_words
from analysis.report.words import percent, who
from analysis.tournament import cross_play, stored_tournaments
from coevo.contest import judge
from coevo.errors import InputError
from coevo.evolution.evaluation import Evaluator
from coevo.run import create_run, open_run
from coevo.statistics import probability_of_improvement
from coevo.usage import used_tree

pytestmark = pytest.mark.slow

HOSTILE = "<script>alert(1)</script>\" onload='alert(2)' </script><!-- &amp;"


def text_of(path):
    """Return what a reader sees of a page, roughly."""
    page = re.sub(r"<(script|style)\b.*?</\1>", " ", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]+>", " ", page))


def test_the_short_paragraph_is_what_was_judged(reported, eight_generations):
    path, told = reported
    run = eight_generations
    with Evaluator(run.config, workers=1, backend="threads") as evaluator:
        judged = list(judge(run, evaluator, games=400))
    assert "8 generations of 6 trees a robot, in 96 games" in told["short"][0]
    for one, said in zip(judged, told["short"][1:], strict=False):
        assert f"the last {who(one.robots)} " in said
        assert percent(one.last) in said
        assert compared_in_words(one.over_first) in said
    text = " ".join(text_of(path).split())
    for said in told["short"]:
        assert said in text


def test_every_chart_has_its_table_and_every_robot_its_tree(reported, eight_generations):
    path, _ = reported
    page = path.read_text(encoding="utf-8")
    charts = re.findall(r'class="chart" data-spec="(\d+)"', page)
    assert charts == [str(number) for number in range(len(charts))]
    assert len(charts) >= 14
    assert page.count("<summary>Table: ") == len(charts)
    specs = re.findall(r'<script type="application/json" id="spec-\d+">(.*?)</script>', page, re.DOTALL)
    assert all("vega-lite" in json.loads(spec)["$schema"] for spec in specs)
    assert len(specs) == len(charts)
    text = text_of(path)
    for robot in eight_generations.evolving.values():
        assert f"The tree of {robot}" in text
        assert str(used_tree(eight_generations, robot).tree) in text


def test_the_page_holds_one_copy_of_the_library_and_three_games(reported):
    page = reported[0].read_text(encoding="utf-8")
    assert page.count("window.vegaEmbed=") == 1
    player = html.unescape(re.search(r'srcdoc="(.*?)"></iframe>', page, re.DOTALL)[1])
    data = json.loads(re.search(r'<script id="data" type="application/json">(.*?)</script>', player, re.DOTALL)[1])
    assert [take["title"] for take in data["games"]] == [f"game {number} of 3" for number in (1, 2, 3)]


def test_what_was_played_is_kept_and_read(eight_generations, reported):
    assert reported
    (kept,) = stored_tournaments(eight_generations)
    assert kept.generations == tuple(range(8))
    again, _ = make_report([open_run(eight_generations.path)], workers=1, backend="threads", tell=lambda _: None)
    assert again == reported[0].read_text(encoding="utf-8")


def test_whatever_comes_from_a_run_is_escaped():
    parts = [
        *(kind(HOSTILE) for kind in (Text, Heading, Code)),
        *(Short([HOSTILE]), Points([HOSTILE]), Table([HOSTILE], [[HOSTILE]], HOSTILE)),
        Figure(HOSTILE, HOSTILE, {"title": HOSTILE}, [HOSTILE], [[HOSTILE]]),
        Picture(HOSTILE, HOSTILE, "<svg></svg>"),
        Player(HOSTILE, HOSTILE, HOSTILE),
    ]
    page = render(HOSTILE, HOSTILE, [Section("one", HOSTILE, HOSTILE, parts)], HOSTILE)
    assert "alert(1)</script>" not in page
    assert "<script>alert" not in page
    assert "onload='alert" not in page
    spec = re.search(r'id="spec-0">(.*?)</script>', page, re.DOTALL)[1]
    assert json.loads(spec)["title"] == HOSTILE
    assert page.count("</script>") == page.count("<script")


def test_a_comparison_tells_groups_apart_by_what_they_played(compared):
    _, told, runs = compared
    names = [run.path.name for run in runs]
    with Evaluator(runs[0].config, workers=1, backend="threads") as evaluator:
        table = cross_play(runs, names, evaluator, games=40)
    for side, part in table.groupby("side"):
        score = part.groupby("run")["share"].mean()
        fixed, varying = ([score[f"{kind}-{seed}"] for seed in (0, 1)] for kind in ("fixed", "varying"))
        probability, low, high = probability_of_improvement(fixed, varying)
        said = next(text for text in told["short"] if text.startswith(f"{side}:") and "probability" in text)
        if probability < 0.5:
            probability, low, high = 1.0 - probability, 1.0 - high, 1.0 - low
        assert f"with probability {probability:.2f} [{low:.2f}, {high:.2f}]" in said


def test_runs_of_different_games_are_judged_apart(small_run, small_settings, go_on, tmp_path):
    other = go_on(create_run(tmp_path / "other", small_settings("game.time_limit_steps=60")))
    found = compare([small_run, other], workers=1, backend="threads", tell=lambda _: None)
    assert found.cross.empty
    assert found.scores.empty
    _, told = make_report([small_run, other], workers=1, backend="threads", tell=lambda _: None)
    assert "their champions cannot meet" in told["short"][1]


def test_a_run_without_a_finished_generation_is_told(small_settings, tmp_path):
    run = create_run(tmp_path / "run", small_settings())
    with pytest.raises(InputError, match="no finished generation"):
        make_report([run], workers=1, backend="threads", tell=lambda _: None)


def test_a_report_of_a_game_of_ones_own(ladder_run):
    page, told = make_report([ladder_run], workers=1, backend="threads", tell=lambda _: None)
    assert "p0 against p1 co-evolved for 4 generations" in told["short"][0]
    assert "<iframe" not in page


def test_differences_are_told_as_far_as_they_are_sure():
    assert compared_in_words((0.2, 0.1, 0.3)) == "20 points [10, 30] more than"
    assert compared_in_words((-0.2, -0.3, -0.1)) == "20 points [10, 30] fewer than"
    assert compared_in_words((0.01, -0.02, 0.04)).startswith("as many, as far as these games can tell (+1 points [-2")
    assert np.all([word not in compared_in_words((0.0, -0.001, 0.001)) for word in ("-0", "more", "fewer")])
