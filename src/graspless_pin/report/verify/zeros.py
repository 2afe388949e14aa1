"""What counts as zero in the data of a problem: smaller figures are rounding."""

AT_REST = 1e-12
"""Sliding that is slower is none, m/s."""
LEAST_LEVER = 1e-12
"""Of the longest lever of all joints: shorter ones count as that long."""
LEAST_MARGIN = 1e-20
"""Of the smallest limit of normal forces: smaller required margins count as zero."""
NO_ARM = 1e-12
"""Of what makes them: distances and moments below are rounding."""
