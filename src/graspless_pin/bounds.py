"""The largest and smallest numbers that are accepted, from any input.

They are far beyond physical values, and small enough that products of a few of them do not
overflow: with larger numbers, the libraries below this package fail unpredictably.
"""

LARGEST = 1e30
"""Any number of a problem: forces (N), moments, torques, masses (kg)."""
SMALLEST = 1e-30
"""A mass, density or force limit that must be above zero."""
SMALLEST_LOAD = 1e-40
"""The largest entry of a nonzero wrench, N or N m; shares of less are not representable."""
LARGEST_LENGTH = 1e12
"""Any length, position, velocity or acceleration, SI."""
SMALLEST_LENGTH = 1e-12
"""A size that must be above zero, m."""
LARGEST_FRICTION = 1e4
"""A coefficient of friction; its cone is flat to a ten-thousandth."""
LARGEST_REGULARIZATION = 1e9
"""The weight epsilon of the forces in an objective."""
LONGEST_TIME = 1e6
"""A time limit, s: eleven days."""
LARGEST_LOAD_OVER_LIMIT = 1e12
"""The load over the largest normal force; beyond, double precision cannot hold both."""
MOST_CONE_EDGES = 1024
"""Edges of a friction cone."""
MOST_SAMPLES = 10_000_000
"""Samples of a study."""
DEEPEST_HALVINGS = 16
"""Halvings of the grid of an adaptive study."""
LONGEST_NAME = 200
"""Characters of a name: of a link, joint, body, material, variable or scene."""
MOST_CONTACTS = 4096
"""Contacts, and joints, of a solution document."""
MOST_COEFFICIENTS = 30_000_000
"""Rows times columns of the program of a solution document: 240 MB; 950 contacts with cones of 8
edges, or 98 with cones of 1024."""
LARGEST_STATED = 1e60
"""Any number of a solution document: products of three of them are doubles."""
