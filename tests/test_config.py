"""Settings: what goes out comes back, what is wrong is named with its remedy, and presets have the source's players."""

from __future__ import annotations

import copy
import re
import tomllib

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coevo.config import GPSettings, RunSettings, check, override, read_toml, to_toml
from coevo.errors import InputError

PRESETS = ("two-learners", "stationary-opponent", "three-learners", "smoke")


def refused(data):
    """Return the message with which a recipe is refused."""
    with pytest.raises(InputError) as caught:
        check(RunSettings, data, "recipe.toml")
    message = str(caught.value)
    assert message.startswith("recipe.toml: ")
    assert "\n" not in message
    return message


# --------------------------------------------------------------------------------------------------- round trips


@pytest.mark.parametrize("preset", PRESETS)
def test_every_setting_of_a_preset_reads_back(preset, recipe):
    settings = check(RunSettings, recipe(preset), preset)
    again = check(RunSettings, tomllib.loads(to_toml(settings)), preset)
    assert again == settings
    assert to_toml(again) == to_toml(settings)


def test_every_setting_is_written_out(recipe):
    written = tomllib.loads(to_toml(check(RunSettings, recipe("smoke"), "smoke")))

    def compare(kind, data):
        names = {field.encode_name for field in msgspec.structs.fields(kind) if field.default is not None}
        assert set(data) == names  # TOML has no word for None
        for field in msgspec.structs.fields(kind):
            if isinstance(field.type, type) and issubclass(field.type, msgspec.Struct):
                compare(field.type, data[field.encode_name])

    compare(RunSettings, written)


@given(
    seed=st.integers(0, 2**63 - 1),
    name=st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", fullmatch=True),
    speed=st.floats(0.0, 3.0, exclude_min=True),
    noise=st.floats(0.0, 1.0),
)
def test_any_values_read_back_exactly(seed, name, speed, noise, recipe):
    data = override(recipe("smoke"), [])
    data |= {"seed": seed, "name": name, "world": {"robot": {"max_speed_mps": speed, "actuator_noise": noise}}}
    settings = check(RunSettings, data, "drawn")
    again = check(RunSettings, tomllib.loads(to_toml(settings)), "drawn")
    assert again == settings
    assert (again.seed, again.name, again.world.robot.max_speed_mps) == (seed, name, speed)


# ------------------------------------------------------------------------------------------------ the source's values


@pytest.mark.parametrize(
    ("preset", "players"),
    [
        ("two-learners", [(0, "evolve"), (0, "evolve")]),
        ("stationary-opponent", [(0, "evolve"), (0, "evolve"), (1, "stationary")]),
        ("three-learners", [(0, "evolve"), (0, "evolve"), (1, "evolve")]),
        ("smoke", [(0, "evolve"), (0, "evolve"), (1, "evolve")]),
    ],
)
def test_presets_have_the_players_of_section_6_4(preset, players, recipe):
    settings = check(RunSettings, recipe(preset), preset)
    assert [(player.team, player.control) for player in settings.players] == players
    assert settings.name == preset


# ------------------------------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        pytest.param("gp.populatoin=4", "unknown setting 'gp.populatoin'. Did you mean 'population'?", id="misspelt"),
        pytest.param("populations=4", "unknown setting 'populations'.", id="unknown at the top"),
        pytest.param("gp.zzz=4", "unknown setting 'gp.zzz'. Known here: population, generations", id="nothing near"),
        pytest.param("world.robot.drve='pws'", "'world.robot.drve'. Did you mean 'drive'?", id="deep"),
        pytest.param("players.1.taem=0", "unknown setting 'players.1.taem'. Did you mean 'team'?", id="in a list"),
        pytest.param(
            "skills.IF_kick=shoot", "and do not begin with IF_; got 'IF_kick'", id="a terminal like a function"
        ),
        pytest.param("skills.2nd=shoot", "1 to 32 letters, digits and _ that begin with a letter", id="a digit first"),
        pytest.param("skills.strike=3", "skills.strike: expected bool | str, got int", id="a number for a skill"),
        pytest.param("skills.strike=true", 'expected a skill, or "" to take the terminal away', id="true for a skill"),
        pytest.param(
            "skills={shoot='', pass='', avoid=false, search=''}", "expected 1 to 32 that are not taken", id="no skill"
        ),
        pytest.param(
            "conditions.near={objects=['bal'], expression='lost'}",
            "conditions.near.objects.0: expected one of 'ball', 'own_goal', 'opponent_goal', 'robot', got 'bal'",
            id="unknown object",
        ),
        pytest.param(
            "conditions.near={objects=['ball']}", "conditions.near: Object missing required", id="no expression"
        ),
        pytest.param(
            "conditions.near={object=['ball']}",
            "'conditions.near.object'. Did you mean 'objects'?",
            id="in a dictionary",
        ),
        pytest.param(
            "conditions.left={objects=['ball'], expression='x < 3'}",
            "conditions.left: Table 6.1 has a condition of this name",
            id="a condition of Table 6.1",
        ),
        pytest.param(
            "conditions.x_is_y={objects=['ball'], expression='x < 3'}", "and do not hold _is_", id="ambiguous name"
        ),
        pytest.param(
            "conditions.near={objects=['ball', 'ball'], expression='x < 3'}", "expected each object once", id="twice"
        ),
        pytest.param("gp.population=1", "gp.population: expected int >= 2, got 1", id="too small"),
        pytest.param("gp.population=2.5", "gp.population: expected int, got float", id="a share of one"),
        pytest.param("gp.population='many'", "gp.population: expected int, got str", id="text for a number"),
        pytest.param("gp.population=true", "gp.population: expected int, got bool", id="true for a number"),
        pytest.param("gp.population=[80]", "gp.population: expected int, got array", id="a list for a number"),
        pytest.param("gp=80", "gp: expected a table, got int", id="a number for a table"),
        pytest.param("name=7", "name: expected str, got int", id="a number for text"),
        pytest.param("seed=-1", "seed: expected int >= 0, got -1", id="negative"),
        pytest.param(
            "seed=9223372036854775808", "seed: expected int <= 9223372036854775807, got 9223372036854775808", id="2^63"
        ),
        pytest.param("gp.mutation=1.5", "gp.mutation: expected float <= 1.0, got 1.5", id="a share above 1"),
        pytest.param("gp.mutation=nan", "gp.mutation: expected a finite number, got nan", id="not a number"),
        pytest.param("world.ball.mass_kg=inf", "world.ball.mass_kg: expected a finite number, got inf", id="infinite"),
        pytest.param("world.ball.mass_kg=0", "world.ball.mass_kg: expected float >= 1e-06, got 0", id="no mass"),
        pytest.param(
            "world.robot.drive='car'", "world.robot.drive: expected one of 'pws', '4ws', got 'car'", id="unknown choice"
        ),
        pytest.param(
            "fitness.kind=vary",
            "fitness: kind must be 'fixed', 'varying' or module:function of your own, got 'vary'",
            id="word",
        ),
        pytest.param("gp.mutation=0.2", "crossover + reproduction + mutation must be 1, got 1.1", id="shares"),
        pytest.param("gp.elite=12", "elite must be smaller than population 12, got 12", id="all survive"),
        pytest.param("gp.creation_depth_min=7", "creation_depth_min must be at most creation_depth_max", id="depths"),
        pytest.param("players=[]", "players: expected array of length >= 1, got []", id="nobody plays"),
        pytest.param(
            "game.ball_start.x_m=[2.0]", "game.ball_start.x_m: expected array of length 2, got 1", id="one limit"
        ),
        pytest.param("game.ball_start.x_m=[5.0, 4.0]", "x_m must be [low, high] with low <= high, got [5", id="order"),
        pytest.param(
            "game.ball_start.x_m=[0.05, 4.0]",
            "game.ball_start.x_m must lie within [0.1025, 8.1175] on this field, got [0.05, 4]",
            id="ball in the wall",
        ),
        pytest.param(
            "players.2.start.y_m=[4.0, 4.5]",
            "players.2.start.y_m must lie within [0.2, 4.375] on this field, got [4, 4.5]",
            id="robot in the wall",
        ),
        pytest.param("world.field.goal_width_m=4.5", "goal_width_m must be at most 4.11642, so that walls", id="goal"),
    ],
)
def test_a_wrong_setting_is_named_with_what_was_expected_and_what_came(assignment, message, recipe):
    assert message in refused(override(recipe("smoke"), [assignment]))


@pytest.mark.parametrize(
    ("old", "new", "value"),
    [
        ("game.pass_window_s", "world.rules.pass_window_s", 2.0),
        ("game.collision_release_m", "world.rules.collision_release_m", 0.1),
    ],
)
def test_a_setting_that_has_moved_is_refused_with_where_it_is(old, new, value, recipe):
    said = refused(override(recipe("smoke"), [f"{old}={value}"]))
    assert f"there is no setting {old!r}; it is {new!r} now" in said
    settings = check(RunSettings, override(recipe("smoke"), [f"{new}={value}"]), "")
    assert getattr(settings.world.rules, new.rpartition(".")[2]) == value


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("skill", "recipe.toml is the recipe of a skill, not an experiment of evolution: 'coevo learn' takes it"),
        ("schedule", "recipe.toml is a schedule of two robots, not an experiment of evolution: 'coevo reproduce ch"),
        ("evolutoin", "recipe.toml: kind: expected 'evolution', got 'evolutoin'"),
        (7, "recipe.toml: kind: expected 'evolution', got 7"),
        (["evolution"], "recipe.toml: kind: expected 'evolution', got ['evolution']"),
        ("simultaneous", "got 'simultaneous'; write periods = 'simultaneous' for what was kind = 'simultaneous'"),
    ],
)
def test_a_file_of_another_kind_is_refused_whatever_else_it_holds(kind, message):
    with pytest.raises(InputError) as caught:
        check(RunSettings, {"kind": kind, "passer": 1}, "recipe.toml")
    assert message in str(caught.value)


def test_a_file_that_does_not_say_its_kind_is_taken_for_what_is_wanted(recipe):
    told = recipe("smoke")
    assert told.pop("kind") == "evolution"
    assert check(RunSettings, told, "") == check(RunSettings, recipe("smoke"), "")
    assert to_toml(check(RunSettings, told, "")).startswith('kind = "evolution"\n')


def test_somebody_must_evolve(recipe):
    still = [f"players.{i}.control=stationary" for i in range(3)]
    assert 'players: at least one must have control = "evolve"' in refused(override(recipe("smoke"), still))


def test_what_has_no_default_must_be_given():
    assert "missing required field game" in refused({"players": [{"start": {"x_m": [2.0, 3.0], "y_m": [2.0, 3.0]}}]})


junk = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.dates()
    | st.times()
    | st.sampled_from([10**400, -(10**30), 2**64]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["x_m", "team", "?"]), inner, max_size=2)
    ),
    max_leaves=4,
)


@given(data=st.data(), value=junk)
def test_anything_in_the_place_of_a_setting_is_taken_or_refused(data, value, recipe):
    more = ['conditions.near={objects=["ball"], expression="area >= 9"}', "skills.strike=shoot"]
    more += ['levels={keys=[{"world.ball.mass_kg"=[0.3, 0.4]}], raise_when={decided={at_least=0.5}}}']
    settings = tomllib.loads(to_toml(check(RunSettings, override(recipe("smoke"), more), "smoke")))
    node = settings
    while True:
        key = data.draw(st.sampled_from(sorted(node) if isinstance(node, dict) else range(len(node))))
        if not isinstance(node[key], dict | list) or not node[key] or data.draw(st.integers(0, 3)) == 0:
            break
        node = node[key]
    node[key] = value
    try:
        taken = check(RunSettings, settings, "recipe.toml")
    except InputError as error:
        assert str(error).startswith("recipe.toml: ")  # noqa: PT017 - the other way is no error at all
    else:
        assert check(RunSettings, tomllib.loads(to_toml(taken)), "again") == taken


def test_settings_are_frozen():
    with pytest.raises(AttributeError, match="immutable"):
        GPSettings().population = 3


# ------------------------------------------------------------------------------------------------------- --set


@pytest.mark.parametrize(
    ("assignment", "path", "value"),
    [
        ("gp.population=40", ("gp", "population"), 40),
        ("gp.mutation=0.5", ("gp", "mutation"), 0.5),
        ("name='a b'", ("name",), "a b"),
        ("name=plain text", ("name",), "plain text"),
        ("name=a=b", ("name",), "a=b"),
        ("name=", ("name",), ""),
        (" seed = 5 ", ("seed",), 5),
        ("fitness.kind=varying", ("fitness", "kind"), "varying"),
        ("world.field.corner_panels=false", ("world", "field", "corner_panels"), False),
        ("game.ball_start.x_m=[1.0, 2]", ("game", "ball_start", "x_m"), [1.0, 2]),
        ("players.1.team=1", ("players", 1, "team"), 1),
        ("players.1={team = 1}", ("players", 1), {"team": 1}),
        ("skills.pass=my/pass.npz", ("skills", "pass"), "my/pass.npz"),
    ],
)
def test_set_puts_a_value_in_its_place_and_leaves_the_rest(assignment, path, value, recipe):
    before = recipe("smoke")
    untouched = copy.deepcopy(before)
    after = override(before, [assignment])
    assert before == untouched
    expected = copy.deepcopy(before)
    node = expected
    for part in path[:-1]:
        node = node[part] if isinstance(node, list) else node.setdefault(part, {})
    node[path[-1]] = value
    assert after == expected


def test_the_last_of_several_wins(recipe):
    assert override(recipe("smoke"), ["seed=1", "gp.elite=0", "seed=2"])["seed"] == 2


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("gp.population", "--set expects KEY=VALUE, such as gp.population=40; got 'gp.population'"),
        ("=40", "--set expects KEY=VALUE"),
        ("", "--set expects KEY=VALUE"),
        ("players.3.team=1", "expected an index from 0 to 2, got '3'"),
        ("players.x.team=1", "expected an index from 0 to 2, got 'x'"),
        ("players.3={}", "expected an index from 0 to 2, got '3'"),
        ("name.first=1", "name is a single value and has no parts"),
        ("name.first.second=1", "'first' lies below a single value"),
    ],
)
def test_set_refuses_what_it_cannot_place(assignment, message, recipe):
    with pytest.raises(InputError, match=re.escape(message)):
        override(recipe("smoke"), [assignment])


# ------------------------------------------------------------------------------------------------------ reading


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param(b"[gp\npopulation = 3", r"is not valid TOML: .*line 1", id="broken"),
        pytest.param(b"seed = 1\nseed = 2", "is not valid TOML: Cannot overwrite a value", id="twice"),
        pytest.param(b'name = "\xff\xfe"', r"cannot read .*: it is not UTF-8 text", id="not text"),
        pytest.param(b"\x00\x01", r"is not valid TOML: .*line 1", id="binary"),
    ],
)
def test_a_broken_file_is_named_with_the_place(content, message, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read_toml(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_and_a_folder_are_named(tmp_path):
    with pytest.raises(InputError, match=re.escape(f"cannot read {tmp_path / 'none.toml'}: No such file")):
        read_toml(tmp_path / "none.toml")
    with pytest.raises(InputError, match=re.escape(f"cannot read {tmp_path}: Is a directory")):
        read_toml(tmp_path)
