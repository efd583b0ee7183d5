"""Studies over many seeds and settings; each module is a command, `coevo reproduce NAME`."""
