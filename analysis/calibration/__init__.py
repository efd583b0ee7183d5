"""How numbers of ours were chosen: where bodies start, time limits, limits of size categories."""
