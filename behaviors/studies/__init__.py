"""Studies over many seeds and settings; each module is a command, `python -m behaviors.studies.NAME`."""
