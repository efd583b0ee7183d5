"""Parents and operators: as recorded, and by breeding again."""

from __future__ import annotations

import shutil

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from analysis.ancestry import ancestors, lineage
from coevo.errors import InputError
from coevo.run import create_run, open_run


@pytest.fixture
def copied(busy_run, tmp_path):
    shutil.copytree(busy_run.path, tmp_path / "copy")
    for name in ("digests.txt", "checkpoint.npz"):  # they know the digests of the parts
        (tmp_path / "copy" / name).unlink()
    return open_run(tmp_path / "copy")


def rewrite(run, generation, change):
    """Write a part with other rows or columns."""
    path = run.path / "individuals.parquet" / f"part-{generation:05d}.parquet"
    pq.write_table(change(pq.read_table(path)), path)


@pytest.fixture
def older(copied):
    """Return the run as it was before folders kept parents and operators."""
    for generation in range(copied.finished):
        rewrite(
            copied, generation, lambda table: table.select(table.column_names[: table.column_names.index("tree") + 1])
        )
    assert "operator" not in copied.individuals
    return copied


def test_a_row_for_every_individual(busy_run):
    table, individuals = lineage(busy_run), busy_run.individuals
    assert table.columns.tolist() == ["generation", "robot", "index", "operator", "parent_1", "parent_2", "fitness"]
    assert len(table) == 7 * 3 * 10
    for name in ("generation", "robot", "index", "fitness"):
        assert table[name].tolist() == individuals[name].tolist()
    assert set(table["operator"]) == {"creation", "elite", "reproduction", "crossover", "mutation"}


def test_what_is_recorded_is_what_breeding_again_gives(busy_run, older):
    pd.testing.assert_frame_equal(lineage(older), lineage(busy_run))


def test_an_older_run_has_the_same_ancestry(busy_run, older):
    for robot in busy_run.evolving.values():
        one, other = (ancestors(run, robot, 6, 4) for run in (busy_run, older))
        pd.testing.assert_frame_equal(one.ancestors, other.ancestors)
        pd.testing.assert_frame_equal(one.nodes, other.nodes)


def test_a_run_without_generations_has_no_lineage(small_settings, tmp_path):
    assert lineage(create_run(tmp_path / "run", small_settings())).empty


def turned(table, column):
    """Return the table with a column's first 10 values, which are those of r0, in another order."""
    at = table.column_names.index(column)
    values = table.column(column).combine_chunks()
    return table.set_column(at, column, pa.concat_arrays([values[1:10], values[:1], values[10:]]))


def test_trees_that_were_not_bred_so_are_told(older):
    rewrite(older, 3, lambda table: turned(table, "tree"))
    message = "breeding generation 3 of r0 again gives other individuals than it holds"
    with pytest.raises(InputError, match=message):
        lineage(older)
    with pytest.raises(InputError, match=message):
        ancestors(older, "r0", 5, 0)
    assert ancestors(older, "r1", 5, 0).generation == 5
    assert ancestors(older, "r0", 2, 0).generation == 2


@pytest.mark.parametrize("column", ["operator", "parent_1", "parent_2"])
def test_parents_that_are_not_those_of_the_breeding_are_told(column, copied):
    rewrite(copied, 2, lambda table: turned(table, column))
    with pytest.raises(InputError, match="breeding generation 2 of r0 again gives other individuals than it holds"):
        ancestors(copied, "r0", 4, 0)
