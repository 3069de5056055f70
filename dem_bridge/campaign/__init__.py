"""Many cases on all cores or on a cluster: cases in, trajectories or the reasons why there are none out, in order."""

from dem_bridge.campaign.results import Crashed, Progress, Result, run_case
from dem_bridge.campaign.run import Jobs, jobs_of, run_cases, run_groups, threads_for

__all__ = [
    "Crashed",
    "Jobs",
    "Progress",
    "Result",
    "jobs_of",
    "run_case",
    "run_cases",
    "run_groups",
    "threads_for",
]
