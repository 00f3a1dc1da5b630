"""Efficiency of `dsfms.batch` on one and on two workers of one core.

    python scripts/batch_scaling.py clip [stretches]

CLIP is one of `dsfms synth --video`. Prints wall time, time within tasks, overhead of a task and the
efficiency at two workers: T1 / (2 T2).
"""

import sys
import tempfile

import ray
from ray.cluster_utils import Cluster

from dsfms import batch

clip = sys.argv[1]
stretches = int(sys.argv[2]) if len(sys.argv) > 2 else 8
job = {"camera": f"{clip}/camera.json", "template": f"{clip}/organ.template", "video": f"{clip}/frames"}
rows = [{**job, "name": f"copy_{i}"} for i in range(stretches)]
walls = []
for workers in (1, 2):
    nodes = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    for _ in range(workers - 1):
        nodes.add_node(num_cpus=1)
    ray.init(address=nodes.address, log_to_driver=False)
    with tempfile.TemporaryDirectory() as warm, tempfile.TemporaryDirectory() as to:
        # Workers start and import once.
        batch.run(rows[: 2 * workers], warm, stretch=10**6, overlap=0)
        report = batch.run(rows, to, stretch=10**6, overlap=0)
    walls.append(report.seconds)
    idle = (workers * report.seconds - report.task_seconds) / stretches
    print(
        f"{workers} workers: {report.seconds:.1f} s wall, {report.task_seconds:.1f} s in {report.parts} tasks, "
        f"{idle:.2f} s of a worker beside every task, {report.failures}"
    )
    ray.shutdown()
    nodes.shutdown()
print(f"efficiency at 2 workers {walls[0] / (2 * walls[1]):.2f}")
