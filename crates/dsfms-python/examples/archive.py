"""An archive of videos on a Ray cluster; the same call goes on where it was."""

import sys

from dsfms import batch

report = batch.run(sys.argv[1], sys.argv[2], address=sys.argv[3] if len(sys.argv) > 3 else None)
print(report.overview, report.statuses)
for failure in report.failures:
    print("failed:", failure.task, failure.error)
