"""coevo learn, coevo skills, coevo skills evaluate."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from coevo.console import Progress, emit, note, output_options, table
from coevo.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from behaviors.recipe import Recipe
    from coevo.skill import Skill

__all__ = ["learn", "skills"]


@click.command()
@click.argument("source", metavar="SKILL|RECIPE.toml")
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), help="Replaces the recipe's seed.")
@click.option("--trials", type=click.IntRange(min=1), help="Replaces the recipe's number of trials.")
@click.option("--drive", type=click.Choice(["pws", "4ws"]), help="Replaces the recipe's drive.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of the learned skill; by default runs/skills/NAME-seedN.",
)
@click.option(
    "--games",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    help="How many trials measure the result.",
)
@output_options
def learn(
    *,
    source: str,
    seed: int | None,
    trials: int | None,
    drive: str | None,
    out: Path | None,
    games: int,
    as_json: bool,
    quiet: bool,
) -> None:
    """Learn a skill, measure it, and write it with its recipe and its card.

    It is learned from nothing; by a recipe with [coordination] from skills that are learned already.

    \b
    Example: coevo learn shoot --seed 5
             coevo learn runs/chapter3/shoot-avoiding.toml
    """
    from behaviors.recipe import is_recipe_of, read_recipe
    from behaviors.relearning import learn_recipe
    from coevo.config import to_toml

    recipe = read_recipe(source)
    if drive is not None:
        robot = msgspec.structs.replace(recipe.world.robot, drive=drive)
        recipe = msgspec.structs.replace(recipe, world=msgspec.structs.replace(recipe.world, robot=robot))
    changes = {
        "seed": seed if seed is not None else recipe.seed,
        "trials": trials if trials is not None else recipe.trials,
    }
    recipe = msgspec.structs.replace(recipe, **changes)
    folder = out if out is not None else Path("runs") / "skills" / f"{recipe.name}-seed{recipe.seed}"
    if (folder / "skill.npz").exists() and out is None:
        note(f"{folder} is replaced.", quiet=quiet)
    _prepare(folder)
    _tell_compiling(recipe, quiet=quiet)
    with Progress(recipe.trials, quiet=quiet) as progress:

        def report(done: int, total: int, share: float) -> None:
            if done == total or done % max(250, total // 20 // 250 * 250) == 0:
                progress.step(
                    f"{recipe.name}: {done} of {total} trials, {share:.0%} of the last block succeeded",
                    done=done,
                )

        skill = learn_recipe(recipe, report=report)
    card = make_card(recipe, skill, games=games, seed=_CARD_SEED)
    with _writing(folder):
        skill.save(folder / "skill.npz")
        if not is_recipe_of(source, folder):
            (folder / "recipe.toml").write_text(to_toml(recipe), encoding="utf-8")
        (folder / "card.json").write_bytes(msgspec.json.format(msgspec.json.encode(card), indent=2) + b"\n")
    if as_json:
        emit({"folder": str(folder), **card})
    else:
        for line in _describe(card):
            click.echo(line)
        click.echo(f"Written: {folder}")


_CARD_SEED = 1_000_000  # of the starts that cards are measured on


class _writing:  # noqa: N801 - reads as a statement
    """Turn failures of writing into messages for the user."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, OSError):
            raise InputError(
                f"cannot write into {self._folder}: {error.strerror or error}; choose another --out"
            ) from None


def _prepare(folder: Path) -> None:
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / "skill.npz.partial"
        probe.touch()
        probe.unlink()


def _tell_compiling(learned: Recipe | None, *, quiet: bool) -> None:
    """Say so if the kernels that learning a recipe, or else only measuring, takes must be compiled first."""
    from behaviors.composite import relearn_trials
    from behaviors.trials import gather, run_trials
    from coevo.compiled import is_compiled

    needed: list[Callable[..., Any]] = [run_trials]
    if learned is not None:
        needed.append(gather if learned.coordination is msgspec.UNSET else relearn_trials)
    if not all(is_compiled(kernel) for kernel in needed):
        note("Compiling the trials for this machine, once: about 20 s ...", quiet=quiet)


def make_card(recipe: Recipe, skill: Skill, *, games: int, seed: int) -> dict[str, Any]:
    """Measure a skill on unseen starts and return its card: plain data."""
    measured = {starts: measure(recipe, skill, games=games, seed=seed, starts=starts) for starts in _starts(recipe)}
    return {
        "name": skill.name,
        "task": recipe.task,
        "drive": skill.drive,
        "learned_with": {"seed": recipe.seed, "trials": recipe.trials},
        "digest": skill.digest,
        "states": int(skill.values.shape[0]),
        "orders": {model.kind: model.order for model in skill.objects},
        "history_lengths": {model.kind: model.history_length for model in skill.objects},
        "measured": measured,
        "random_actions": measure(recipe, None, games=games, seed=seed, starts=_starts(recipe)[0]),
    }


def _starts(recipe: Recipe) -> list[str]:
    return ["in-view"] if recipe.task in ("search", "avoid") else ["in-view", "anywhere"]


def measure(recipe: Recipe, skill: Skill | None, *, games: int, seed: int, starts: str) -> dict[str, Any]:
    """Return what a skill (None: random actions) does from unseen starts, with the 95 % confidence interval."""
    from behaviors.learning import evaluate, wilson_interval
    from behaviors.recipe import MoverSettings

    # Success of avoid is defined against a robot that moves at random.
    mover = MoverSettings(kind="random") if recipe.task == "avoid" else None
    result = evaluate(recipe, skill, games=games, seed=seed, starts=starts, mover=mover)
    data: dict[str, Any] = {
        "starts": starts,
        "games": games,
        "seed": seed,
        "success_rate": result.success_rate,
        "ci95": list(wilson_interval(int(result.success.sum()), games)),
        "mean_steps": float(result.steps.mean()),
        "collision_rate": result.collision_rate,
    }
    if recipe.task == "avoid":
        chaser = MoverSettings(kind="chaser", speed=0.3)
        chased = evaluate(recipe, skill, games=games, seed=seed, starts=starts, mover=chaser)
        data["collision_rate_chaser"] = chased.collision_rate
        data["ci95_chaser"] = list(wilson_interval(int((~chased.success).sum()), games))
    return data


def _describe(card: dict[str, Any]) -> list[str]:
    lines = [f"{card['name']} ({card['drive']}, {card['states']} states)"]
    for data in [*card["measured"].values(), {**card["random_actions"], "label": "random actions"}]:
        low, high = data["ci95"]
        lines.append(
            f"  {data.get('label', data['starts']):14s}  success {data['success_rate']:.3f} [{low:.3f}, {high:.3f}]"
            f"  collisions {data['collision_rate']:.3f}  mean {data['mean_steps']:.0f} steps  ({data['games']} trials)"
        )
        if "collision_rate_chaser" in data:
            low, high = data["ci95_chaser"]
            chased = data["collision_rate_chaser"]
            lines.append(f"{'':18s}collisions with a chaser at 0.3 speed {chased:.3f} [{low:.3f}, {high:.3f}]")
    return lines


@click.group(invoke_without_command=True)
@output_options
@click.pass_context
def skills(context: click.Context, *, as_json: bool, quiet: bool) -> None:
    """List the installed skills with their measured success.

    \b
    Example: coevo skills
             coevo skills evaluate shoot --games 1000 --seed 7
    """
    del quiet
    if context.invoked_subcommand is not None:
        return
    from coevo.skill import installed_skills, load_skill, read_card

    rows, data = [], []
    for name in installed_skills():
        skill, card = load_skill(name), read_card(name)
        if card.get("digest") != skill.digest:
            raise InputError(
                f"the card of {name} belongs to another skill file; make both with 'coevo learn {name} --out FOLDER'"
            )
        best = card["measured"]["in-view"]
        low, high = best["ci95"]
        anywhere = card["measured"].get("anywhere")
        rows.append(
            [
                name,
                card["drive"],
                str(card["states"]),
                " ".join(f"{kind}:{order}/{card['history_lengths'][kind]}" for kind, order in card["orders"].items()),
                f"{best['success_rate']:.3f} [{low:.3f}, {high:.3f}]",
                "" if anywhere is None else f"{anywhere['success_rate']:.3f}",
                f"{best['collision_rate']:.3f}",
                str(best["games"]),
            ]
        )
        data.append(
            {
                "name": name,
                "success_rate": best["success_rate"],
                "ci95": best["ci95"],
                "games": best["games"],
                "drive": card["drive"],
                "states": card["states"],
                "orders": card["orders"],
                "history_lengths": card["history_lengths"],
                "card": card,
            }
        )
    if as_json:
        emit(data)
        return
    header = [
        "skill",
        "drive",
        "states",
        "object:order/history",
        "success in view [95 %]",
        "anywhere",
        "collisions",
        "trials",
    ]
    click.echo(table(header, rows) if rows else "No skills are installed; learn one with 'coevo learn shoot'.")
    click.echo("search starts with the ball out of view; avoid counts 10 s without collision against a random mover")


@skills.command()
@click.argument("skill")
@click.option("--games", type=click.IntRange(min=1), default=1000, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**63 - 1), default=7, show_default=True)
@click.option("--starts", type=click.Choice(["in-view", "anywhere"]), default="in-view", show_default=True)
@output_options
def evaluate(*, skill: str, games: int, seed: int, starts: str, as_json: bool, quiet: bool) -> None:
    """Measure a skill anew, from unseen starts; SKILL is the name of an installed skill or the path of a skill file.

    \b
    Example: coevo skills evaluate shoot --games 1000 --seed 7 --starts anywhere
    """
    from behaviors.recipe import Recipe
    from coevo.config import check
    from coevo.skill import load_skill

    loaded = load_skill(skill)
    recipe = check(Recipe, dict(loaded.about.get("recipe", {})), f"the recipe in {skill}")
    _tell_compiling(None, quiet=quiet)
    data = {"name": loaded.name, **measure(recipe, loaded, games=games, seed=seed, starts=starts)}
    if as_json:
        emit(data)
        return
    low, high = data["ci95"]
    click.echo(
        f"{loaded.name}, starts {starts}: success {data['success_rate']:.3f} [{low:.3f}, {high:.3f}] of {games} trials,"
        f" collisions {data['collision_rate']:.3f}, mean {data['mean_steps']:.0f} steps"
    )
    if "collision_rate_chaser" in data:
        low, high = data["ci95_chaser"]
        click.echo(f"collisions with a chaser at 0.3 speed {data['collision_rate_chaser']:.3f} [{low:.3f}, {high:.3f}]")
