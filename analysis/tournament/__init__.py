"""Generations of a run against each other, against outsiders, and once more: is it progress, or luck?"""

from analysis.tournament.against import (
    Against,
    Outsider,
    play_against,
    read_outsider,
    single_skill_outsiders,
)
from analysis.tournament.cross import cross_play, same_game
from analysis.tournament.dynamics import diagnoses, in_words
from analysis.tournament.play import (
    INDIVIDUALS,
    Tournament,
    chosen_generations,
    largest_tournament,
    play_tournament,
    stored_tournaments,
)
from analysis.tournament.ratings import Ratings, can_rate, rate
from analysis.tournament.repeats import Left, left_over, play_again

__all__ = [
    "INDIVIDUALS",
    "Against",
    "Left",
    "Outsider",
    "Ratings",
    "Tournament",
    "can_rate",
    "chosen_generations",
    "cross_play",
    "diagnoses",
    "in_words",
    "largest_tournament",
    "left_over",
    "play_again",
    "play_against",
    "play_tournament",
    "rate",
    "read_outsider",
    "same_game",
    "single_skill_outsiders",
    "stored_tournaments",
]
