"""Rows of a long benchmark in a file, as they come: what was measured once is not measured again, or lost.

A line is one row in JSON, with its `settings`: what else its numbers depend on. Processes may share a file, for a line
is appended whole; then each measures a part, and one more run finds all of it there.
"""

from __future__ import annotations

import json


def read_rows(file, settings):
    """Return the rows in a file that were measured with these settings; none where there is no file yet.

    Raises
    ------
    ValueError
        If a line is no row.
    """
    if file is None or not file.exists():
        return []
    lines = file.read_text(encoding="utf-8").splitlines()
    try:
        rows = [json.loads(line) for line in lines]
        return [row["row"] for row in rows if row["settings"] == json.loads(json.dumps(settings))]
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(f"{file}: expected a row of a benchmark in each line: {error!r}") from None


def keep_row(file, settings, row):
    """Append a row to a file, if there is one."""
    if file is not None:
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps({"settings": settings, "row": row}) + "\n")
