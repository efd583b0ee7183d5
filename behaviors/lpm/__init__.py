"""Local prediction models: the state of an object from what was seen and done (Uchibe 1999, 3.2, appendix A)."""

from behaviors.lpm.model import MAX_HISTORY_LENGTH, LocalPredictionModel, PersistentExcitationWarning, identify

__all__ = ["MAX_HISTORY_LENGTH", "LocalPredictionModel", "PersistentExcitationWarning", "identify"]
