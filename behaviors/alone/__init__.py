"""One robot learns one skill: its task, what it happens in, its trials."""
