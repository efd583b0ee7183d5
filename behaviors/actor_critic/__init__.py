"""Critic and actor of a vector-valued reward (chapter 5), beside the tables of Q learning."""
