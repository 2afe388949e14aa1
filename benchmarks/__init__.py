"""Measurements that print markdown tables: ``make bench``, or ``python -m benchmarks SECTION``."""
