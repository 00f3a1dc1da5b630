"""Command line of the Python package: ``dsfms batch``. Everything else is the Rust program's."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns the exit code: 0 all done, 1 nothing, 2 some videos failed, 64 wrong usage."""
    parser = argparse.ArgumentParser(prog="dsfms", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    batch = commands.add_parser("batch", help="many videos on many machines (extra ray)")
    batch.add_argument("manifest", help="CSV or Parquet: one row a video")
    batch.add_argument("--to", required=True, metavar="OUT", help="folder or fsspec URL of the results")
    batch.add_argument("--address", help="of a running Ray cluster; default a local one")
    batch.add_argument("--stretch", type=int, default=500, help="frames of a stretch (default 500)")
    batch.add_argument("--overlap", type=int, default=25, help="frames before it (default 25)")
    batch.add_argument("--retries", type=int, default=2, help="further tries of a task (default 2)")
    batch.add_argument("--cpus", type=int, default=1, help="cores of a task (default 1)")
    options = parser.parse_args(arguments)
    from . import batch as module

    try:
        report = module.run(
            options.manifest,
            options.to,
            address=options.address,
            stretch=options.stretch,
            overlap=options.overlap,
            retries=options.retries,
            cpus=options.cpus,
            progress=module.terminal_line(),
        )
    except (ValueError, FileNotFoundError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 64
    for failure in report.failures:
        print(f"failed: {failure.task}: {failure.error}", file=sys.stderr)
    print(f"{report.overview}", file=sys.stderr)
    if not report.failures:
        return 0
    return 2 if report.parts else 1


if __name__ == "__main__":
    sys.exit(main())
