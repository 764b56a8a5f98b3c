"""Runs a batch of softrig on Dask, on Ray or on this machine, and says what failed where.

    python many.py cases.csv out --engine dask --workers 2
    python many.py cases.csv out --engine ray --address auto

Every machine needs `softrig` and the same files under the same paths. SOFTRIG names another program.
"""

import argparse
import csv
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

Result = dict[str, Any]


def run(job: int, jobs: int, manifest: str, out: str, threads: int) -> Result:
    """One share of the batch, on the machine where this is called."""
    rig = os.environ.get("SOFTRIG", "softrig")
    share = ["--batch", manifest, "-o", out, "--share", f"{job}/{jobs}"]
    result: Result = {"job": job, "host": socket.gethostname(), "failed": {}}
    try:
        done = subprocess.run(
            [rig, "diagnose", *share],
            capture_output=True,
            text=True,
            env={**os.environ, "RAYON_NUM_THREADS": str(threads)},
        )
    except OSError as error:
        return {**result, "code": 127, "said": f"{rig}: {error.strerror}"}
    said = done.stderr.strip().splitlines()
    with open(manifest, newline="") as file:
        for number, row in enumerate(csv.DictReader(file)):
            error_file = Path(out) / row["case"].strip() / "error.txt"
            if number % jobs == job and error_file.exists():
                result["failed"][row["case"]] = error_file.read_text().strip()
    return {**result, "code": done.returncode, "said": said[-1] if said else ""}


def lost(job: int, error: BaseException) -> Result:
    """A job of which the engine has no result: its worker was killed, or never was."""
    what = (str(error) or type(error).__name__).strip().splitlines()[0]
    return {"job": job, "host": "?", "failed": {}, "code": None, "said": what}


def on_this_machine(workers: int, address: str | None, jobs: int, *rest: Any) -> Iterator[Result]:
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(lambda job: run(job, jobs, *rest), range(jobs))


def on_dask(workers: int, address: str | None, jobs: int, *rest: Any) -> Iterator[Result]:
    from dask.distributed import Client

    options = {"address": address} if address else {"n_workers": workers, "threads_per_worker": 1}
    with Client(**options) as client:
        futures = [client.submit(run, job, jobs, *rest, pure=False) for job in range(jobs)]
        for job, future in enumerate(futures):
            try:
                yield future.result()
            except Exception as error:
                yield lost(job, error)


def on_ray(workers: int, address: str | None, jobs: int, *rest: Any) -> Iterator[Result]:
    import ray

    threads = rest[-1]
    if address:
        ray.init(address=address)
    else:
        ray.init(num_cpus=workers * threads, include_dashboard=False)
    remote = ray.remote(num_cpus=threads, max_retries=0)(run)
    futures = [remote.remote(job, jobs, *rest) for job in range(jobs)]
    for job, future in enumerate(futures):
        try:
            yield ray.get(future)
        except Exception as error:
            yield lost(job, error)
    ray.shutdown()


ENGINES = {"local": on_this_machine, "dask": on_dask, "ray": on_ray}


def main() -> int:
    parser = argparse.ArgumentParser(description="Runs a batch of softrig, and says what failed where.")
    parser.add_argument("manifest")
    parser.add_argument("out")
    parser.add_argument("--engine", choices=ENGINES, default="local")
    parser.add_argument("--address", help="of a cluster that runs; without it, workers start here")
    parser.add_argument("--workers", type=int, default=2, help="how many start here")
    parser.add_argument("--threads", type=int, default=1, help="of each diagnosis")
    parser.add_argument("--jobs", type=int, help="shares of the batch; default: four a worker")
    args = parser.parse_args()

    manifest, out = os.path.abspath(args.manifest), os.path.abspath(args.out)
    with open(manifest, newline="") as file:
        cases = sum(1 for _ in csv.DictReader(file))
    jobs = max(1, min(cases, args.jobs or 4 * args.workers))
    failed = wrong = 0
    start = ENGINES[args.engine]
    for result in start(args.workers, args.address, jobs, manifest, out, args.threads):
        place = f"job {result['job']} of {jobs} on {result['host']}"
        for case, error in result["failed"].items():
            print(f"{place}: {case}: {error}")
        failed += len(result["failed"])
        # A share of which a case fails ends with 1: that is said above.
        if result["code"] not in (0, 1) or (result["code"] == 1 and not result["failed"]):
            wrong += 1
            print(f"{place}: exit {result['code']}: {result['said']}")
    print(f"{cases} cases, {failed} failed; {jobs} jobs, {wrong} without all of their results")
    if wrong == jobs:
        return 1
    # Everything that is done is skipped; the table is written.
    rig = os.environ.get("SOFTRIG", "softrig")
    table = subprocess.run([rig, "diagnose", "--batch", manifest, "-o", out])
    return 1 if failed or wrong else table.returncode


if __name__ == "__main__":
    sys.exit(main())
