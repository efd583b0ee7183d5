"""What behaviors adds to the command line; everything heavy is imported when a command runs."""

from behaviors.commands.learning import learn
from behaviors.commands.skills import skills

__all__ = ["learn", "skills"]
