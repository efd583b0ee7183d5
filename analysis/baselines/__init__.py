"""What champions are measured by: single skills, all small trees, hand-typed teams, random search.

All functions take a ``game`` (``coevo.game.make_game(settings)``) and an ``evaluator`` (``Evaluator(settings,
workers=2, backend="threads")``, used as a context). A *team* is ``{role number: Tree}``; a *line-up* is the same with
programs (``team_line_up(game, team)``), as ``coevo.contest`` has it. Opponents (``others``) are line-ups, each of all
other roles that evolve; nothing where nobody else does.

- ``small_trees(functions, depth, limit)``: all trees of a role that behave differently; ``neighbours(tree, functions,
  depth)``: those that are one change away.
- ``best_answer(game, evaluator, team, others, candidates, games=, seed=)``: the team of small trees that does best
  against opponents, within a budget of games, as an ``Answer`` (``trees``, ``line_up(game)``, ``worth``, ``games``).
  ``depth=2`` or 3 lets it grow the best trees; ``keep`` restricts teams (``lambda team: any("pass" in tree.names for
  tree in team.values())``); ``lost_weight`` is what a lost game costs; ``starts`` are teams of one's own to begin from.
- ``best_single_skills(...)``: the same among the teams of one skill for each robot.
- ``measure(game, evaluator, team, parts, others, games=, seed=)``: line-ups in the same fresh games, as ``Measured``
  (``won``, ``lost`` a game; ``share``, ``lost_share``, ``time_out``); ``gain(after, before)`` with its interval.
- ``best_answers(game, evaluator, rounds, games=, seed=)``: alternating best answers from the best single skills, a
  ``Round`` each, and ``moves(rounds)``: in how many of them the answer was better.
- ``table(run, evaluator, games=, search_games=, hand=, beside=, met=)``: the champions of a run beside all of these;
  ``over_runs(tables)``: the same of many runs, which are the unit then.

docs/how-to/baselines.md has an example.
"""

from analysis.baselines.compare import over_runs, table
from analysis.baselines.hand_typed import HandTyped, hand_typed_of, read_hand_typed, shipped_hand_typed
from analysis.baselines.rounds import Round, best_answers, last_met, moves, single_skill_teams
from analysis.baselines.search import (
    Answer,
    Measured,
    Team,
    best_answer,
    best_of,
    best_single_skills,
    gain,
    in_text,
    measure,
    team_line_up,
)
from analysis.baselines.trees import behaviour, distinct, neighbours, small_trees

__all__ = [
    "Answer",
    "HandTyped",
    "Measured",
    "Round",
    "Team",
    "behaviour",
    "best_answer",
    "best_answers",
    "best_of",
    "best_single_skills",
    "distinct",
    "gain",
    "hand_typed_of",
    "in_text",
    "last_met",
    "measure",
    "moves",
    "neighbours",
    "over_runs",
    "read_hand_typed",
    "shipped_hand_typed",
    "single_skill_teams",
    "small_trees",
    "table",
    "team_line_up",
]
