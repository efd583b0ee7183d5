"""How skills are learned: local prediction models, tabular Q learning, recipes."""
