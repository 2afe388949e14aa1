"""Evaluators in the terms of other programs, a module and an optional extra for each."""
