"""Read files that may be hostile: bounded bytes, then YAML, JSON or XML with bounds of its own.

Every part that opens a file of a user's opens it here.
"""
