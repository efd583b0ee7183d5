"""The check of the documentation finds what is wrong with a page."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[1] / "tools"
LONG = "*Takes about an hour on two cores; not run by the tests, as shorter ones say nothing.*"


@pytest.fixture(scope="module")
def tool():
    """Return the script as a module."""
    sys.path.insert(0, str(TOOLS))
    try:
        import documented_commands  # noqa: PLC0415 - it is no package
    finally:
        sys.path.remove(str(TOOLS))
    return documented_commands


@pytest.fixture
def check(tool):
    """Return a function that checks a page of these lines, and returns how many commands it has."""
    return lambda *lines, name="page.md": tool.check_page(tool.read_page(name, "\n".join(lines)))


def console(*lines):
    return "```console", *lines, "```"


def test_commands_are_lines_that_begin_with_a_dollar_and_go_on_after_a_backslash(tool):
    page = tool.read_page(
        "page.md", "\n".join(console("$ coevo evolve smoke \\", "    --seed 3", "Run folder: x", "$ ls"))
    )
    assert list(page.blocks[0].commands()) == [(2, "coevo evolve smoke --seed 3"), (5, "ls")]
    assert not page.blocks[0].is_long


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("coevo evolv smoke", "Did you mean 'evolve'?"),
        ("coevo reproduce abaltion", "Did you mean 'ablation'?"),
        ("coevo evolve smoke --sede 3", "--sede"),
        ("coevo evolve smokey", "Did you mean 'smoke'?"),
        ("coevo evolve smoke --set gp.popolation=3", "gp.popolation"),
        ("coevo evolve smoke --seed minus", "minus"),
        ("coevo learn shooot", "Did you mean 'shoot'?"),
        ("coevo reproduce chapter3 chapter3/shedule", "Did you mean 'chapter3/schedule'?"),
        ("coevo reproduce chapter3", "Missing argument"),
        ("coevo skills evaluate shot", "Did you mean 'shoot'?"),
        ("coevo skills watch shot", "Did you mean 'shoot'?"),
        ("coevo skills | coevo bensh", "Did you mean 'bench'?"),
        ("make tests", "there is no target 'tests'"),
        ("make bench", ".ci/run does not run 'make bench'"),
    ],
)
def test_a_command_that_cannot_be_is_refused_with_its_place(tool, check, command, said):
    with pytest.raises(tool.LieError) as refused:
        check("Words.", "", *console(f"$ {command}"))
    assert str(refused.value).startswith("page.md:4: ")
    assert said in str(refused.value)


@pytest.mark.parametrize(
    "command",
    [
        "coevo evolve smoke --seed 3 --set fitness.kind=varying",
        "coevo skills --json > skills.json",
        "coevo learn RECIPE.toml",
        "coevo evolve PRESET --seed 0   # and 1",
        "coevo reproduce --help",
        """coevo evolve smoke --set 'conditions.near={objects=["ball"], expression="x >= 20 and x < 44"}'""",
        "make lint",
        "ls -l | head",
    ],
)
def test_a_command_that_can_be_is_not(check, command):
    assert check(*console(f"$ {command}")) == 1


def test_a_block_that_says_how_long_it_takes_is_parsed_and_not_run(tool, check):
    page = tool.read_page("page.md", "\n".join([LONG, "", *console("$ make bench", "$ coevo bench")]))
    assert page.blocks[0].is_long
    assert check(LONG, "", *console("$ make bench", "$ coevo bench")) == 2
    with pytest.raises(tool.LieError, match="bensh"):
        check(LONG, "", *console("$ coevo bensh"))


@pytest.mark.parametrize(
    "mark",
    [
        "*Takes about an hour; not run by the tests.*",  # why?
        "*Takes long; not run by the tests, as it is long.*",  # how long?
        "*Takes a learner's patience; not run by the tests, as it is long.*",
        "Takes about an hour; not run by the tests, as it is long.",
        f"{LONG}\n\nOther words.",
    ],
)
def test_what_does_not_say_how_long_and_why_is_run(tool, mark):
    page = tool.read_page("page.md", "\n".join([mark, "", *console("$ coevo bench")]))
    assert not page.blocks[0].is_long


def test_what_is_run_instead_needs_a_block_that_says_how_long_it_takes(tool, check):
    instead = "<!-- instead: coevo bench --games 5 -->"
    page = tool.read_page("page.md", "\n".join([LONG, "", instead, *console("$ coevo bench")]))
    assert page.blocks[0].instead == [(3, "coevo bench --games 5")]
    assert check(LONG, "", instead, *console("$ coevo bench")) == 2
    for lines in ([instead, *console("$ coevo bench")], [*console("$ coevo bench"), instead]):
        with pytest.raises(tool.LieError):
            check(*lines)
    with pytest.raises(tool.LieError, match="gams"):
        check(LONG, "<!-- instead: coevo bench --gams 5 -->", *console("$ coevo bench"))


@pytest.mark.parametrize(
    "lines", [["```", "coevo bench", "```"], ["```text", "$ make test", "```"], ["    coevo bench"]]
)
def test_commands_outside_a_block_of_commands_are_refused(tool, check, lines):
    with pytest.raises(tool.LieError, match="```console"):
        check("Words.", "", *lines)


def test_commands_within_a_sentence_are_parsed_over_the_end_of_a_line(tool, check):
    assert check("Say `coevo skills", "evaluate NAME` and `make test`, or `coevo learn`.") == 3
    with pytest.raises(tool.LieError, match=r"page.md:2: .*evaluated"):
        check("First, and then", "`coevo skills", "evaluated NAME`")


def test_a_how_to_is_followed_by_its_test(tool, check):
    assert check(*console("$ coevo bench"), name="docs/how-to/game.md") == 1
    with pytest.raises(tool.LieError, match="does not follow"):
        check(*console("$ coevo bench"), name="docs/how-to/other.md")


def test_the_time_of_every_study_is_told(tool):
    names = tool.reproduce.list_commands(None)
    assert "ablation" in names

    def told(name):
        return [tool.read_page("page.md", f"`coevo reproduce {one}`, about 2 minutes") for one in names if one != name]

    tool.check_studies(told(None))
    with pytest.raises(tool.LieError, match="how long 'coevo reproduce ablation' takes"):
        tool.check_studies(told("ablation"))


def test_the_pages_of_this_checkout_hold(tool, capsys):
    assert tool.main(["--parse"]) == 0
    assert "pages are there" in capsys.readouterr().out


def test_blocks_run_in_order_in_one_folder_and_a_failure_is_told_with_its_place(tool, capsys):
    lines = [*console("$ echo 7 > seven"), "", "```python", 'print(6 * int(open("seven").read()))', "```"]
    good = tool.read_page("good.md", "\n".join(lines))
    bad = tool.read_page("bad.md", "\n".join(console("$ echo seen", "$ cat seven", "$ echo unseen")))
    with pytest.raises(tool.LieError, match=r"bad\.md:3: cat seven exited with 1"):
        tool.run_pages([good, bad])
    told = capsys.readouterr().out
    assert re.findall(r"^[a-z0-9]+$", told, re.MULTILINE) == ["42", "seen"]
    assert "good.md:2: $ echo 7" in told
    assert "cat: seven" in told


@pytest.mark.parametrize(
    "words",
    [
        "[a](architecture.md), [b](decisions), [c](../README.md#use), [d](how-to/skill.md)",
        "`coevo/compiled.py`, `coevo/compiled.py: entry`, `behaviors/pretrained/NAME/recipe.toml`",
        "`coevo.game.Game`, `coevo.evolution.loop: evolve`, `behaviors.lpm.identify(segments)`, `coevo.commands`",
    ],
)
def test_names_that_are_there(tool, words):
    page = tool.read_page("docs/page.md", words)
    assert tool.check_names(page, tool.ROOT) == words.count(", ") + 1 - words.count("NAME")


@pytest.mark.parametrize(
    "wrong",
    [
        "[a](architectur.md)",
        "[a](docs/architecture.md)",
        "`behaviors/alone/task.py`",
        "`coevo/compiled.py: exit`",
        "`behaviors.alone`",
        "`coevo.game.Gmae`",
        "`coevo.evolution.loop: evolv`",
    ],
)
def test_names_that_are_not_there_are_refused_with_their_place(tool, wrong):
    page = tool.read_page("docs/page.md", f"Words\nand {wrong}.")
    with pytest.raises(tool.LieError, match=r"docs/page\.md:2: "):
        tool.check_names(page, tool.ROOT)


def test_git_checks_before_a_commit_what_must_hold_anyway_and_downloads_nothing(tool):
    text = (tool.ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    makefile = (tool.ROOT / "Makefile").read_text(encoding="utf-8")
    entries = re.findall(r"entry: (.*)", text)
    assert len(entries) == text.count("language: system") == text.count("pass_filenames: false") == 5
    for entry in entries:
        assert f"\t@{entry.replace('.venv/bin', '$(BIN)')}" in makefile
    assert re.findall(r"repo: (.*)", text) == ["local"]
