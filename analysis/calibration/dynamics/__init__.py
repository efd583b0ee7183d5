"""Matrices of wins whose dynamics are known, to choose the limits of the diagnosis and to say how often it errs."""
