"""Grasp studies: many scenes of one kind, computed on all cores, as one table."""

from graspless_pin.studies.run import run_study
from graspless_pin.studies.study import Study, load_study
from graspless_pin.studies.tables import read_results, results_summary

__all__ = ["Study", "load_study", "read_results", "results_summary", "run_study"]
