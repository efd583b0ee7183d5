"""Studies: many runs, of evolution or of learning, and the folders that they are kept in.

``plan`` reads a study file, ``folder`` keeps what comes of it, ``task`` is one run of it in a worker, ``cores`` and
``cluster`` are where workers are. ``kinds`` says what can be run, ``evolving`` is evolution; learning comes by an entry
point. ``sets`` writes and reads the folders of chapter 3.
"""

from coevo.study.sets import StoredSet, StudyMethod, open_method, read_set, read_sets, table_bytes, write_set

__all__ = ["StoredSet", "StudyMethod", "open_method", "read_set", "read_sets", "table_bytes", "write_set"]
