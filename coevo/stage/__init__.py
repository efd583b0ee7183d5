"""A soccer world with robots on it: what they see, what they do, what happens; for games and for trials alike."""

from coevo.stage.data import Roles, Stage, Venue, make_venue
from coevo.stage.loop import GOING, run_episode
from coevo.stage.roles import CHASER, INFORMED, LEARNER, RANDOM, ROAMER, SKILL, STANDING, TREE
from coevo.stage.tape import Trace

__all__ = [
    "CHASER",
    "GOING",
    "INFORMED",
    "LEARNER",
    "RANDOM",
    "ROAMER",
    "SKILL",
    "STANDING",
    "TREE",
    "Roles",
    "Stage",
    "Trace",
    "Venue",
    "make_venue",
    "run_episode",
]
