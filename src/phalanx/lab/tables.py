"""Convert tables of a `Result` to pandas and to Parquet files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from phalanx.errors import Unavailable
from phalanx.world.scenarios.result import Result, Table

RESEARCH_HINT = "pip install '.[research]' in a clone"


def to_pandas(result: Result, table: Table = "robots") -> Any:
    """Return a table of `Result.columns` as a `pandas.DataFrame`.

    Raises: Unavailable: pandas is not installed. UsageError: no such table.
    """
    columns = result.columns(table)
    try:
        import pandas as pd  # noqa: PLC0415 - optional
    except ImportError as error:
        raise Unavailable("pandas is not installed", RESEARCH_HINT) from error
    return pd.DataFrame(columns)


def to_parquet(result: Result, path: str | Path, table: Table = "robots") -> Path:
    """Write the table of `to_pandas` to a file, and return its path.

    Raises: Unavailable: pandas or pyarrow is not installed, or the file cannot be written. UsageError: no such
        table.
    """
    frame = to_pandas(result, table)
    try:
        frame.to_parquet(path, index=False)
    except ImportError as error:
        raise Unavailable("pyarrow is not installed", RESEARCH_HINT) from error
    except OSError as error:
        raise Unavailable(f"cannot write {path}: {error.strerror or error}", "use an existing folder") from error
    return Path(path)
