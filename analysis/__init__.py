"""Reading runs: curves, tables, comparisons."""
