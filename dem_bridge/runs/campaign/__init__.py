"""Many cases on all cores or on a cluster: cases in, trajectories or the reasons why there are none out, in order."""

from dem_bridge.runs.campaign.executors import Away, Jobs, fingerprint_of, map_in_threads, workers_of
from dem_bridge.runs.campaign.identity import for_workers
from dem_bridge.runs.campaign.results import Crashed, Progress, Result, run_case
from dem_bridge.runs.campaign.run import jobs_of, run_cases, run_groups

__all__ = [
    "Away",
    "Crashed",
    "Jobs",
    "Progress",
    "Result",
    "fingerprint_of",
    "for_workers",
    "jobs_of",
    "map_in_threads",
    "run_case",
    "run_cases",
    "run_groups",
    "workers_of",
]
