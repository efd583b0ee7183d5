"""Who plays with whom: equal games for all, every partner as likely, no guest from the future."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from coevo.config import EvaluationSettings, EvolutionSettings, GPSettings, check
from coevo.errors import InputError
from coevo.evolution.evaluation import group_seeds
from coevo.evolution.grouping import FROZEN, games_of_run, groups_again, groups_of, line_ups
from coevo.game import Role
from coevo.seeds import RunStream, generator

GROUPINGS = ("random", "partners", "best", "hall-of-fame")


def settings_of(grouping, *, population=5, partners=1, games=1, seed=0, hall=0.5, starts="own", against=0.0):
    evaluation = EvaluationSettings(
        games=games * partners,
        grouping=grouping,
        partners=partners,
        hall_share=hall,
        starts=starts,
        against={"p0": "shoot"} if against else "",
        against_share=against,
    )
    gp = GPSettings(population=population, elite=0)
    return EvolutionSettings(seed=seed, gp=gp, evaluation=evaluation)


@st.composite
def cases(draw):
    """Return settings and roles: of any number of teams, and with roles that do not evolve."""
    grouping = draw(st.sampled_from(GROUPINGS))
    partners = 1 if grouping == "random" else draw(st.integers(1, 6))
    hall, against = (draw(st.integers(0, partners)) / partners for _ in range(2))
    teams = draw(st.lists(st.integers(0, 3), min_size=1, max_size=6))
    evolves = draw(st.lists(st.booleans(), min_size=len(teams), max_size=len(teams)).filter(any))
    roles = [Role(f"p{n}", team, one) for n, (team, one) in enumerate(zip(teams, evolves, strict=True))]
    settings = settings_of(
        grouping,
        population=draw(st.integers(2, 12)),
        partners=partners,
        games=draw(st.integers(1, 3)),
        seed=draw(st.integers(0, 2**63 - 1)),
        hall=hall,
        starts=draw(st.sampled_from(["own", "common"])),
        against=against,
    )
    return settings, roles, draw(st.integers(0, 50))


@given(case=cases())
def test_each_individual_has_one_group_a_round_and_as_many_games_as_any_other(case):
    settings, roles, generation = case
    evaluation, size = settings.evaluation, settings.gp.population
    groups = groups_of(settings, roles, generation)
    for role, of in enumerate(roles):
        played = Counter(groups.members[groups.counts[:, role], role].tolist())
        expected = dict.fromkeys(range(size), evaluation.rounds) if of.evolves else {}
        assert dict(played) == expected
        if of.evolves:
            own = groups.of(role)
            assert own.shape == (size, evaluation.rounds)
            assert (groups.members[own, role] == np.arange(size)[:, None]).all()
            assert groups.counts[own, role].all()
            assert (np.diff(own, axis=1) > 0).all()
    assert groups.games * evaluation.rounds == evaluation.games


@given(case=cases())
def test_every_role_that_evolves_plays_in_every_group_as_a_member_or_a_guest_of_the_past(case):
    settings, roles, generation = case
    groups = groups_of(settings, roles, generation)
    evolves = np.array([role.evolves for role in roles])
    plays = (groups.members >= 0).astype(int) + (groups.guests != -1)
    assert (plays == evolves).all()
    assert (groups.guests < generation).all()
    assert groups.guests.min() >= (FROZEN if settings.evaluation.against else 0 if (groups.guests >= 0).all() else -1)
    assert (groups.counts <= (groups.members >= 0)).all()
    assert groups.members.max() < settings.gp.population


@given(case=cases())
def test_starts_are_common_in_a_round_and_never_twice(case):
    settings, roles, generation = case
    groups = groups_of(settings, roles, generation)
    seeds = np.array([groups.seeds(settings.seed, generation, group) for group in range(len(groups))])
    assert (np.array(groups.seeds_of_all(settings.seed, generation)) == seeds).all()
    role = next(number for number, of in enumerate(roles) if of.evolves)
    rounds = groups.of(role)
    if settings.evaluation.starts == "own":
        assert len(np.unique(seeds)) == seeds.size
        return
    for number in range(rounds.shape[1]):
        assert (seeds[rounds[:, number]] == seeds[rounds[0, number]]).all()
    assert len(np.unique(seeds)) == settings.evaluation.games
    assert len(np.unique(seeds[rounds[0]])) == settings.evaluation.games
    for other in (number for number, of in enumerate(roles) if of.evolves):
        assert (seeds[groups.of(other)[:, 0]] == seeds[0]).all()


@given(case=cases(), generations=st.integers(1, 6))
def test_the_games_of_a_run_are_those_of_its_groups(case, generations):
    settings, roles, _ = case
    each = [groups_of(settings, roles, generation) for generation in range(generations)]
    assert games_of_run(settings, roles, generations) == sum(len(groups) * groups.games for groups in each)


@given(case=cases(), seed=st.integers(0, 2**32 - 1))
def test_again_is_like_a_generation_for_one_individual(case, seed):
    settings, roles, generation = case
    role = [number for number, of in enumerate(roles) if of.evolves][-1]
    groups = groups_of(settings, roles, generation)
    again = groups_again(settings, roles, generation, (role, 1), np.random.default_rng(seed))
    assert len(again) == settings.evaluation.rounds
    assert again.games == groups.games
    assert (again.members[:, role] == 1).all()
    own = groups.of(role)[1]
    assert (groups.counts[own] == again.counts).all()  # the same kind of games, round by round
    assert (np.minimum(groups.guests[own], 0) == np.minimum(again.guests, 0)).all()
    assert (again.guests < generation).all()


def reference(settings, roles, generation):
    """Return the dissertation's groups, written from its sentence: who is in each, without replacement."""
    random = generator(settings.seed, RunStream.GROUPING, generation)
    orders = [random.permutation(settings.gp.population) for role in roles if role.evolves]
    return np.stack(orders, axis=1)


TWO_TEAMS = [Role("r0", 0), Role("r1", 0), Role("r2", 1)]


@pytest.mark.parametrize("generation", [0, 3])
def test_random_groups_and_their_seeds_are_those_of_always(generation):
    settings = settings_of("random", population=7, games=4, seed=11)
    groups = groups_of(settings, TWO_TEAMS, generation)
    assert (groups.members == reference(settings, TWO_TEAMS, generation)).all()
    for group in range(7):
        assert (groups.seeds(11, generation, group) == group_seeds(11, generation, group, 4)).all()


def test_one_partner_is_the_random_grouping():
    one, other = (groups_of(settings_of(name, games=4), TWO_TEAMS, 2) for name in ("random", "partners"))
    for field in ("members", "guests", "counts", "starts"):
        assert (getattr(one, field) == getattr(other, field)).all()


def test_groups_are_drawn_anew_for_every_generation_seed_and_round():
    drawn = {
        part.tobytes()
        for seed in range(5)
        for generation in range(5)
        for part in np.split(
            groups_of(settings_of("partners", population=20, partners=4, seed=seed), TWO_TEAMS, generation).members, 4
        )
    }
    assert len(drawn) == 100


def test_every_partner_is_as_likely_in_every_pair_of_robots():
    settings = settings_of("partners", partners=4, seed=7)
    times = np.zeros((3, 3, 5, 5), np.int64)
    for generation in range(500):
        members = groups_of(settings, TWO_TEAMS, generation).members
        for one, two in itertools.combinations(range(3), 2):
            np.add.at(times[one, two], (members[:, one], members[:, two]), 1)
    for one, two in itertools.combinations(range(3), 2):
        for individual in range(5):
            assert stats.chisquare(times[one, two, individual]).pvalue > 1e-4


def test_with_the_best_everybody_plays_for_itself_among_the_best_of_the_generation_before():
    groups = groups_of(settings_of("best", population=4), TWO_TEAMS, 9)
    assert len(groups) == 12
    assert (groups.counts.sum(axis=1) == 1).all()
    assert (groups.guests[groups.members < 0] == 8).all()
    assert groups_of(settings_of("best", population=4), TWO_TEAMS, 0).counts.all()  # nobody was best before


THREE_TEAMS = [
    Role("a0", 0),
    Role("b0", 1),
    Role("a1", 0),
    Role("stands", 1, evolves=False),
    Role("c0", 2),
    Role("c1", 2),
]


def test_the_hall_sends_whole_teams_each_of_one_generation_drawn_from_all():
    seen = np.zeros(10, np.int64)
    for seed in range(50):
        settings = settings_of("hall-of-fame", population=6, partners=4, hall=0.5, seed=seed)
        groups = groups_of(settings, THREE_TEAMS, 10)
        assert groups.counts[:12][:, [0, 1, 2, 4, 5]].all()  # two rounds of partners
        for counts, guests in zip(groups.counts[12:], groups.guests[12:], strict=True):
            (own,) = {THREE_TEAMS[role].team for role in np.flatnonzero(counts)}
            assert counts.tolist() == [role.team == own and role.evolves for role in THREE_TEAMS]
            for team in {0, 1, 2} - {own}:
                (past,) = {int(guests[r]) for r, role in enumerate(THREE_TEAMS) if role.team == team and role.evolves}
                seen[past] += 1
    assert seen.sum() == 50 * 2 * 3 * 6 * 2  # rounds, teams, individuals, opponents
    assert stats.chisquare(seen).pvalue > 1e-4


def test_a_team_without_opponents_that_evolve_plays_among_itself():
    roles = [Role("r0", 0), Role("r1", 0), Role("r2", 1, evolves=False)]
    groups = groups_of(settings_of("hall-of-fame", partners=2), roles, 5)
    assert (groups.guests == -1).all()
    assert len(groups) == 10


@pytest.mark.parametrize("grouping", ["partners", "best", "hall-of-fame"])
@pytest.mark.parametrize("generation", [0, 3])
def test_the_last_rounds_are_against_whole_teams_that_do_not_evolve(grouping, generation):
    settings = settings_of(grouping, population=6, partners=4, hall=0.5, against=0.5)
    plain = settings_of(grouping, population=6, partners=4, hall=0.25)
    groups, before = (groups_of(one, THREE_TEAMS, generation) for one in (settings, plain))
    assert settings.evaluation.against_rounds == 2
    against = (groups.guests == FROZEN).any(axis=1)
    assert against.sum() == 2 * 3 * 6  # rounds, teams, individuals
    assert (np.diff(against.astype(int)) >= 0).all()  # they are the last
    parts = [part[against] for part in (groups.counts, groups.guests, groups.members)]
    for counts, guests, members in zip(*parts, strict=True):
        (own,) = {THREE_TEAMS[role].team for role in np.flatnonzero(counts)}
        for number, role in enumerate(THREE_TEAMS):
            mine = role.evolves and role.team == own
            assert (counts[number], members[number] >= 0) == (mine, mine)
            assert guests[number] == (-1 if mine or not role.evolves else FROZEN)
    if grouping == "partners":  # the rounds before are those of always
        first = np.flatnonzero(~against)
        assert (groups.members[first] == before.members[: len(first)]).all()
    if grouping == "hall-of-fame" and generation:
        assert (groups.guests >= 0).any(axis=1).sum() == 1 * 3 * 6  # half of the other rounds


def test_line_ups_put_members_and_guests_into_their_places():
    settings = settings_of("best", population=3)
    groups = groups_of(settings, TWO_TEAMS, 2)
    names = {role: [f"{role}/{one}" for one in range(3)] for role in range(3)}
    teams = list(line_ups(groups, names, lambda role, generation: f"best {role} of {generation}", {}))
    assert teams[4] == ["best 0 of 1", f"1/{groups.members[4, 1]}", "best 2 of 1"]
    assert list(line_ups(groups, names, lambda *_: "best", {}, [4, 8]))[1] == [
        "best",
        "best",
        f"2/{groups.members[8, 2]}",
    ]
    groups = groups_of(settings_of("random", population=3, against=1.0), TWO_TEAMS, 0)
    frozen = ["frozen 0", "frozen 1", "frozen 2"]
    first, *_, last = line_ups(groups, names, None, dict(enumerate(frozen)))
    assert first == [f"0/{groups.members[0, 0]}", f"1/{groups.members[0, 1]}", "frozen 2"]
    assert last == ["frozen 0", "frozen 1", f"2/{groups.members[-1, 2]}"]


@pytest.mark.parametrize(
    ("games", "partners", "rounds"),
    [(20, 5, 5), (20, 1, 1), (20, 6, 5), (20, 100, 20), (2, 5, 2), (7, 5, 1), (9, 5, 3)],
)
def test_there_are_as_many_rounds_as_divide_the_games_and_no_more_than_partners(games, partners, rounds):
    assert EvaluationSettings(games=games, grouping="partners", partners=partners).rounds == rounds
    assert EvaluationSettings(games=games, partners=partners).rounds == 1  # at random: one group, as in the source


@pytest.mark.parametrize(
    ("partners", "share", "of_hall"), [(4, 0.5, 2), (5, 0.5, 3), (5, 0.2, 1), (1, 0.5, 1), (1, 0.4, 0)]
)
def test_the_share_of_the_hall_is_rounded(partners, share, of_hall):
    given = {"grouping": "hall-of-fame", "partners": partners, "hall_share": share}
    assert EvaluationSettings(**given).hall_rounds == of_hall
    assert EvaluationSettings(**{**given, "grouping": "partners"}).hall_rounds == 0


def test_champions_are_judged_by_whole_blocks_of_games():
    blocks = [EvaluationSettings(games=20, champion_games=games).champion_blocks for games in (0, 1, 20, 21, 100)]
    assert blocks == [0, 1, 1, 2, 5]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"partners": 0}, "expected int >= 1"),
        ({"champion_games": -1}, "expected int >= 0"),
        ({"grouping": "everybody"}, "expected one of 'random', 'partners', 'best', 'hall-of-fame', got 'everybody'"),
    ],
)
def test_what_cannot_be_grouped_is_refused_in_words(given, said):
    with pytest.raises(InputError) as refused:
        check(EvolutionSettings, {"evaluation": given}, "mine")
    assert said in str(refused.value)
    assert str(refused.value).startswith("mine: evaluation")
