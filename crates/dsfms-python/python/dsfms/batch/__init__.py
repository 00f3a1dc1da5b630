"""Many videos on many machines, by Ray (extra ``ray``).

`run` turns a manifest into one task a template and one a stretch of video, and writes a partitioned Parquet
data set, compressed vertices and an overview to a folder or any fsspec location. The same call again goes
on where it was.
"""

from ._driver import run, terminal_line
from ._manifest import Job, read_manifest
from ._report import Failure, Report, Seam

__all__ = ["Failure", "Job", "Report", "Seam", "read_manifest", "run", "terminal_line"]
