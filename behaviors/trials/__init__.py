"""Trials of one robot or of several that learn, or act by what they have learned: starts, ends, rewards, the loop."""
