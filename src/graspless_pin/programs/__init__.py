"""The linear and quadratic programs of Algorithms 1 and 2, as plain matrices."""
