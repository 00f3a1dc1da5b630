"""The driver: tasks to workers, faults, progress."""

from __future__ import annotations

import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

from ..bridges import _extra
from ._manifest import Job, read_manifest
from ._report import Failure, Report, overview, seams, statuses
from ._store import Store
from ._tasks import Stretch, build, count, described, template_name, track

Progress = Callable[[int, int, int], object]


def terminal_line() -> Progress:
    """Progress as one line of standard error that overwrites itself."""

    def show(done: int, total: int, failed: int) -> None:
        end = "\n" if done + failed == total else ""
        text = f"\rdsfms batch: {done} of {total} tasks, {failed} failed "
        print(text, end=end, file=sys.stderr, flush=True)

    return show


def run(
    manifest: str | Path | Iterable[Mapping[str, Any]],
    to: str | Path,
    *,
    address: str | None = None,
    stretch: int = 500,
    overlap: int = 25,
    retries: int = 2,
    cpus: int = 1,
    progress: Progress | None = None,
) -> Report:
    """Track every video of a manifest.

    Parameters
    ----------
    manifest : path or iterable of dict
        CSV, Parquet or rows with the columns of `Job`: video, and template or exploration with camera.
    to : path or fsspec URL
        Where the results go: ``frames/`` (Parquet, partitioned by video), ``vertices/`` (npz),
        ``templates/``, ``index.html``, ``report.json``. Parts that lie there are kept.
    address : str, optional
        Of a running Ray cluster ("auto" for the one of this machine); default the one that `ray` is
        connected to, else a local one that ends with this call.
    stretch, overlap : int
        Frames of a stretch, and frames before it that only bring the tracker in and check the seam.
    retries : int
        Further tries of a task that failed or whose worker died.
    cpus : int
        Cores of a task.
    progress : callable (done, total, failed), optional
        Called whenever a task ends.

    Returns
    -------
    Report
        Failures are in it; nothing is raised for a video that cannot be done.

    Raises
    ------
    ValueError
        A manifest or argument that makes no sense, or a place that holds a run with other stretches.
    """
    for name, value, least in [("stretch", stretch, 1), ("overlap", overlap, 0), ("cpus", cpus, 1)]:
        if value < least:
            raise ValueError(f"{name}: expected {least} or more, found {value}")
    ray = _extra("ray")
    jobs = [_absolute(job) for job in read_manifest(manifest)]
    store = Store(str(to))
    _claim(store, jobs, stretch, overlap)
    own = not ray.is_initialized()
    if own:
        ray.init(address=address, log_to_driver=False)
    try:
        driver = _Driver(ray, store, (stretch, overlap), retries, cpus, progress)
        return driver.run(jobs)
    finally:
        if own:
            ray.shutdown()


def _absolute(job: Job) -> Job:
    """Local paths as every worker of a shared file system sees them."""
    names = ("video", "camera", "template", "exploration", "organ_masks")
    paths = {n: getattr(job, n) for n in names}
    return replace(job, **{n: str(Path(p).absolute()) if p and "://" not in p else p for n, p in paths.items()})


def _claim(store: Store, jobs: list[Job], stretch: int, overlap: int) -> None:
    """A place belongs to one run; other stretches would mix with its parts."""
    plan = {"jobs": [described(job) for job in jobs], "stretch": stretch, "overlap": overlap}
    if store.exists("plan.json"):
        if store.read_json("plan.json") != plan:
            raise ValueError(
                f"to: {store.url} holds another run (see plan.json in it); choose another place or remove it"
            )
        return
    store.write_json("plan.json", plan)


class _Task:
    """Something a worker is to do."""

    def __init__(self, kind: str, job: Job, stretch: Stretch | None = None) -> None:
        self.kind, self.job, self.stretch = kind, job, stretch
        self.attempts = 0

    @property
    def label(self) -> str:
        """As reports name it, the video first."""
        if self.stretch is not None:
            return self.stretch.label
        return f"{self.job.name} {self.kind}"


class _Driver:
    def __init__(
        self,
        ray: Any,
        store: Store,
        cut: tuple[int, int],
        retries: int,
        cpus: int,
        progress: Progress | None,
    ) -> None:
        self.ray, self.store, self.retries = ray, store, retries
        self.stretch, self.overlap = cut
        self.progress = progress or (lambda done, total, failed: None)
        # Tries are counted here; results do not depend on the number of threads.
        options = {
            "num_cpus": cpus,
            "max_retries": 0,
            "scheduling_strategy": "SPREAD",
            "runtime_env": {"env_vars": {"RAYON_NUM_THREADS": str(cpus)}},
        }
        remote = ray.remote(**options)
        self.functions = {"count": remote(count), "template": remote(build), "track": remote(track)}
        self.waiting: deque[_Task] = deque()
        self.running: dict[Any, _Task] = {}
        self.failures: list[Failure] = []
        self.stretches: list[Stretch] = []
        self.blocked: dict[str, list[_Task]] = {}
        self.done = self.total = self.computed = self.retried = 0
        self.seconds = 0.0

    def run(self, jobs: list[Job]) -> Report:
        """All tasks to their end, then the report."""
        begin = time.monotonic()
        for job in jobs:
            key = job.template_key
            if key and not self.store.exists(template_name(job)) and key not in self.blocked:
                self.blocked[key] = []
                self._add(_Task("template", job))
            self._add(_Task("count", job))
        while self.waiting or self.running:
            self._submit()
            ready, _ = self.ray.wait(list(self.running), timeout=1.0)
            for reference in ready:
                self._take(reference)
        return self._report(jobs, begin)

    def _add(self, task: _Task) -> None:
        self.total += 1
        self.waiting.append(task)

    def _submit(self) -> None:
        """Keep every core busy and a few tasks queued; the rest waits here, not in Ray."""
        room = 2 * int(self.ray.cluster_resources().get("CPU", 1)) + 2
        while self.waiting and len(self.running) < room:
            task = self.waiting.popleft()
            task.attempts += 1
            function = self.functions[task.kind]
            what = f"dsfms {task.label}"
            if task.kind == "count":
                reference = function.options(name=what).remote(task.job)
            else:
                subject = task.stretch if task.kind == "track" else task.job
                reference = function.options(name=what).remote(subject, self.store.url)
            self.running[reference] = task

    def _take(self, reference: Any) -> None:
        task = self.running.pop(reference)
        try:
            result = self.ray.get(reference)
        except self.ray.exceptions.RayError as error:
            self._failed(task, error)
        else:
            self.done += 1
            self._succeeded(task, result)
        self.progress(self.done, self.total, len(self.failures))

    def _failed(self, task: _Task, error: Exception) -> None:
        if task.attempts <= self.retries:
            self.retried += 1
            self.waiting.append(task)
            return
        cause = getattr(error, "cause", None) or error
        text = f"{type(cause).__name__}: {str(cause).strip().splitlines()[0] if str(cause).strip() else ''}"
        self.failures.append(Failure(task.label, text, task.attempts))
        if task.kind == "template":
            for waiting in self.blocked.pop(task.job.template_key, []):
                self.failures.append(Failure(waiting.label, "its template could not be built", 0))

    def _succeeded(self, task: _Task, result: Any) -> None:
        if task.kind == "count":
            self._cut(task.job, int(result))
            return
        self.seconds += result["seconds"]
        if task.kind == "template":
            self.waiting.extend(self.blocked.pop(task.job.template_key, []))
        else:
            self.computed += 1

    def _cut(self, job: Job, frames: int) -> None:
        for start in range(0, frames, self.stretch):
            stop = min(start + self.stretch, frames)
            stretch = Stretch(job, start, stop, self.overlap if start else 0)
            self.stretches.append(stretch)
            if self.store.exists(stretch.part):
                continue
            task = _Task("track", job, stretch)
            self.total += 1
            key = job.template_key
            if key in self.blocked:
                self.blocked[key].append(task)
            elif key and not self.store.exists(template_name(job)):
                self.failures.append(Failure(task.label, "its template could not be built", 0))
            else:
                self.waiting.append(task)

    def _report(self, jobs: list[Job], begin: float) -> Report:
        done = {s: statuses(self.store, s) for s in self.stretches if self.store.exists(s.part)}
        counts = Counter(chain.from_iterable(done.values()))
        report = Report(
            parts=len(done),
            computed=self.computed,
            retried=self.retried,
            failures=sorted(self.failures, key=lambda f: f.task),
            seams=seams(self.store, done),
            statuses=dict(sorted(counts.items())),
            task_seconds=self.seconds,
            seconds=time.monotonic() - begin,
        )
        report = replace(report, overview=overview(self.store, jobs, self.stretches, done, report))
        self.store.write_json("report.json", report.plain())
        return report
