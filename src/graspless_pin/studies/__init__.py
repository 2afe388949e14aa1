"""Grasp studies: many scenes of one kind, computed on all cores, as one table."""

from graspless_pin.studies.results import read_results, results_parts, results_summary
from graspless_pin.studies.run import compute_study, run_study
from graspless_pin.studies.study import Study, load_study

__all__ = [
    "Study",
    "compute_study",
    "load_study",
    "read_results",
    "results_parts",
    "results_summary",
    "run_study",
]
