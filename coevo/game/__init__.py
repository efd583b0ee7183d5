"""Games that trees play."""

from coevo.game.soccer import Arena, Outcome, StartsDoNotFitError, Trace, load_bank, warm_up

__all__ = ["Arena", "Outcome", "StartsDoNotFitError", "Trace", "load_bank", "warm_up"]
