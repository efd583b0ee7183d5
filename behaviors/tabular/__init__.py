"""Tabular Q learning, compiled: the table, the decisions of a trial, the update (Uchibe 1999, appendix B.1)."""
